"""Tasks as data: reward terms, when an episode ends, how it starts."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import mujoco
import numpy as np

from morphkit.errors import ConfigError, UnknownNameError
from morphkit.simulation.build import Simulation
from morphkit.simulation.ground import lowest_point
from morphkit.utils.suggest import did_you_mean

Range = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Task:
    """What a robot is rewarded for and when its episodes end.

    Reward of a step = `forward_weight` * forward speed + `alive_bonus` - `control_cost` * |a|^2
    + `tip_height_weight` * tip height. Forward speed is (x after - x before) / duration of the step, m/s, of the planar
    base's x slide or of a free root's frame.

    Attributes:
        name: Name of the task.
        frame_skip: Simulator steps in a control step; None: as many as come closest to `control_period`.
        control_period: Duration of a control step that is aimed for where `frame_skip` is None, s.
        episode_length: Control steps after which an episode is truncated.
        forward_weight: Weight of the forward speed.
        alive_bonus: Paid every step, the last included.
        control_cost: Weight of |a|^2.
        control_as_share: Whether |a|^2 takes each control as a share of its bound (largest of |low|, |high|), so that
            a 30 N*m motor costs no more than a normalized one; otherwise in its own unit.
        tip_height_weight: Weight of the height of the tip above the root's frame, as a share of its reach. The tip is
            the far end of the last limb of the deepest chain, twice as far from its frame as its center of mass.
        healthy_height: Open interval of the root's height, m, outside which the episode ends; None: no bounds. Measured
            at the z slide's coordinate of a planar base; at the root's frame above the world's origin for a free one
            and where `height_in_world`.
        healthy_share: The same as shares of the start height; `task_for` turns it into `healthy_height`. Where the
            root's frame starts at the ground, as a URDF's `base_footprint` does, or below it, the robot may sink and
            rise by shares of how high its center of mass lies above its lowest point.
        height_in_world: See `healthy_height`.
        healthy_pitch: The episode ends when |pitch| of a planar base, or the tilt of a free one, reaches this, rad.
            Tilt is the angle between world z and the root's axis that pointed along world z at the start.
        healthy_state: The episode ends when any |coordinate| or |velocity| but the first two coordinates reaches this.
        qpos_noise: Start coordinates are uniform within +- this around the model's start, m or rad; slides with limits
            stay within these.
        qvel_noise: Scale of the start velocities, m/s or rad/s.
        qvel_noise_kind: `uniform` within +-scale, or `normal` with that standard deviation.
    """

    name: str
    frame_skip: int | None = 4
    control_period: float = 0.02
    episode_length: int = 1000
    forward_weight: float = 1.0
    alive_bonus: float = 0.0
    control_cost: float = 0.0
    control_as_share: bool = False
    tip_height_weight: float = 0.0
    healthy_height: Range | None = None
    healthy_share: Range | None = None
    height_in_world: bool = False
    healthy_pitch: float | None = None
    healthy_state: float | None = None
    qpos_noise: float = 0.005
    qvel_noise: float = 0.005
    qvel_noise_kind: Literal["uniform", "normal"] = "uniform"


TASKS: dict[str, Task] = {
    task.name: task
    for task in (
        Task("cheetah", control_cost=0.1, qpos_noise=0.1, qvel_noise=0.1, qvel_noise_kind="normal"),
        Task("walker", alive_bonus=1.0, control_cost=0.001, healthy_height=(0.8, 2.0), healthy_pitch=1.0),
        Task("humanoid_2d", alive_bonus=1.0, control_cost=0.001, healthy_height=(0.4, 2.1), healthy_pitch=1.0),
        Task(
            "hopper",
            alive_bonus=1.0,
            control_cost=0.001,
            healthy_height=(0.95, math.inf),
            healthy_pitch=1.0,
            healthy_state=100.0,
        ),
        Task(
            "locomotion",
            frame_skip=None,
            alive_bonus=1.0,
            control_cost=0.05,
            control_as_share=True,
            healthy_share=(0.4, 2.0),
            height_in_world=True,
            healthy_pitch=1.2,
        ),
        Task(
            "raise",
            frame_skip=None,
            forward_weight=0.0,
            control_cost=0.001,
            tip_height_weight=1.0,
            qpos_noise=0.1,
            qvel_noise=0.1,
        ),
    )
}
"""The four benchmark rewards; `locomotion`, forward motion of any robot on a planar or free base; `raise`, for a robot
on a fixed base."""


def task_for(simulation: Simulation, name: str | None = None, control_frequency: float | None = None) -> Task:
    """The task of a robot with everything that depends on the robot filled in.

    Args:
        simulation: The robot.
        name: Name of the task; None takes the robot's own, else `raise` on a fixed base and `locomotion` otherwise.
        control_frequency: Control steps per second that are aimed for, Hz; None takes the robot's own, else what the
            task says. The published tasks keep their frame skip whatever the robot says.

    Returns:
        A task with `frame_skip` and absolute `healthy_height`; the robot's own healthy height goes first.

    Raises:
        UnknownNameError: There is no such task.
        ConfigError: The task needs a base that the robot does not have.
    """
    name = name or simulation.tokens.task or ("raise" if simulation.base == "fixed" else "locomotion")
    if name not in TASKS:
        raise UnknownNameError(f"there is no task {name!r}; tasks are {', '.join(TASKS)}{did_you_mean(name, TASKS)}")
    task = TASKS[name]
    if simulation.base == "fixed" and task.forward_weight:
        raise ConfigError(
            f"{simulation.name}: task {name!r} rewards moving forward, but the base is fixed; take task 'raise', or "
            "--base planar or free"
        )
    skip = _frame_skip(simulation, task, control_frequency)
    own = simulation.description.info.healthy_height
    if own is not None:
        return replace(task, frame_skip=skip, healthy_height=own, healthy_share=None, height_in_world=False)
    if task.healthy_share is not None:
        return replace(
            task, frame_skip=skip, healthy_height=_bounds(simulation, task.healthy_share), healthy_share=None
        )
    return replace(task, frame_skip=skip)


def _frame_skip(simulation: Simulation, task: Task, asked: float | None) -> int:
    frequency = asked or (None if task.frame_skip else simulation.description.info.control_frequency)
    if frequency is None and task.frame_skip:
        return task.frame_skip
    period = 1 / frequency if frequency else task.control_period
    return max(1, round(period / float(simulation.model.opt.timestep)))


def _bounds(simulation: Simulation, share: Range) -> Range | None:
    """Healthy heights of the root's frame, m; None for a robot without any extent."""
    start, stature = float(start_frame(simulation)[2]), _stature(simulation)
    whole = start if start > stature / 2 else stature
    low, high = (start - whole + each * whole for each in share)
    return (low, high) if whole > 0 else None


def _stature(simulation: Simulation) -> float:
    """How high the center of mass lies above the lowest point in the start configuration, m."""
    model, root = simulation.model, simulation.limb_body[0]
    data = mujoco.MjData(model)
    data.qpos[:] = simulation.start
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    return float(data.subtree_com[root, 2]) - lowest_point(model, root, simulation.start)


def start_frame(simulation: Simulation) -> np.ndarray:
    """World position (3, m) and quaternion (4, real part first) of the root's frame in the start configuration."""
    data = mujoco.MjData(simulation.model)
    data.qpos[:] = simulation.start
    mujoco.mj_kinematics(simulation.model, data)
    root = simulation.limb_body[0]
    return np.concatenate([data.xpos[root], data.xquat[root]])
