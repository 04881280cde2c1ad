"""Tasks as data: reward terms, when an episode ends, how it starts."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from morphkit.errors import ConfigError, UnknownNameError
from morphkit.simulation.build import Simulation
from morphkit.utils.suggest import did_you_mean
from morphkit_rl.envs.start_frame import start_frame, start_height
from morphkit_rl.envs.task_file import load_task, shipped_tasks
from morphkit_rl.envs.task_settings import Range, Task

__all__ = ["TASKS", "Task", "find_task", "start_frame", "task_for"]

_GRAVITY = 9.81  # m/s^2

TASKS: dict[str, Task] = {
    task.name: task
    for task in (
        *shipped_tasks().values(),
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
on a fixed base; those of `task_files`: `walk` at a speed that is told, and `reach`."""


_DEFAULTS = {"fixed": "raise", "planar": "locomotion", "free": "walk"}
"""The task of a robot that names none, by its base."""


def task_for(simulation: Simulation, task: str | Task | None = None, control_frequency: float | None = None) -> Task:
    """The task of a robot with everything that depends on the robot filled in.

    Args:
        simulation: The robot.
        task: A task, its name, or its TOML file; None takes the robot's own, else `walk` on a free base, `locomotion`
            on a planar and `raise` on a fixed one.
        control_frequency: Control steps per second that are aimed for, Hz; None takes the robot's own, else what the
            task says. The published tasks keep their frame skip whatever the robot says.

    Returns:
        A task with `frame_skip` and absolute `healthy_height`; the robot's own healthy height goes first.

    Raises:
        UnknownNameError: There is no such task.
        ConfigError: The task needs a base that the robot does not have.
    """
    task = find_task(task or simulation.tokens.task or _DEFAULTS[simulation.base])
    if simulation.base == "fixed" and (task.forward_weight or task.commands):
        raise ConfigError(
            f"{simulation.name}: task {task.name!r} rewards moving forward, but the base is fixed; take task 'raise' or"
            " 'reach', or --base planar or free"
        )
    skip = _frame_skip(simulation, task, control_frequency)
    if task.commands is not None and task.commands.froude:
        task = _in_speeds(task, math.sqrt(_GRAVITY * max(start_height(simulation), 1e-6)))
    own = simulation.description.info.healthy_height
    if own is not None:
        return replace(task, frame_skip=skip, healthy_height=own, healthy_share=None, height_in_world=False)
    if task.healthy_share is not None:
        return replace(
            task, frame_skip=skip, healthy_height=_bounds(simulation, task.healthy_share), healthy_share=None
        )
    return replace(task, frame_skip=skip)


def find_task(task: str | Task) -> Task:
    """A task by its name, or from its TOML file.

    Raises:
        UnknownNameError: There is no such task.
        ConfigError: The file makes no sense.
    """
    if isinstance(task, Task):
        return task
    if task.endswith(".toml"):
        return load_task(Path(task))
    if task not in TASKS:
        names = ", ".join(TASKS)
        raise UnknownNameError(
            f"there is no task {task!r}; tasks are {names}, and files that end in .toml{did_you_mean(task, TASKS)}"
        )
    return TASKS[task]


def _in_speeds(task: Task, unit: float) -> Task:
    """A task whose commands are in m/s, with `unit` for what they were in before."""
    assert task.commands is not None
    x, y = ((low * unit, high * unit) for low, high in (task.commands.x, task.commands.y))
    return replace(task, commands=replace(task.commands, x=x, y=y, froude=False), speed_unit=unit)


def _frame_skip(simulation: Simulation, task: Task, asked: float | None) -> int:
    frequency = asked or (None if task.frame_skip else simulation.description.info.control_frequency)
    if frequency is None and task.frame_skip:
        return task.frame_skip
    period = 1 / frequency if frequency else task.control_period
    return max(1, round(period / float(simulation.model.opt.timestep)))


def _bounds(simulation: Simulation, share: Range) -> Range | None:
    """Healthy heights of the root's frame, m; None for a robot without any extent."""
    start, whole = float(start_frame(simulation)[2]), start_height(simulation)
    low, high = (start - whole + each * whole for each in share)
    return (low, high) if whole > 0 else None
