"""Rewards and endings of all environments of many robots in one pass over flat buffers."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from morphkit.simulation.build import Simulation
from morphkit.tokens.quantities import quantity_columns
from morphkit_rl.envs.start_frame import start_frame
from morphkit_rl.envs.task_settings import Task
from morphkit_rl.envs.tip import find_tip


class RewardPass:
    """Computes reward and termination of every environment from where it was and where it is.

    A planar base is judged by its own coordinates, a free one by the sensors of the root limb.

    Args:
        simulations: The robots.
        tasks: Their tasks.
        state_start: Where in the flat state vector each environment of each robot starts, one int (n,) a robot; there
            are time, qpos, qvel and what else the simulator keeps.
        root_row: Row of every environment's root limb in `sensors`, int (environments,).
        sensors: Limb sensors, (rows, 13), which the caller keeps up to date.
    """

    def __init__(
        self,
        simulations: Sequence[Simulation],
        tasks: Sequence[Task],
        state_start: Sequence[np.ndarray],
        root_row: np.ndarray,
        sensors: np.ndarray,
    ) -> None:
        robots = list(zip(simulations, tasks, strict=True))
        num_envs = [len(start) for start in state_start]
        env_start = np.concatenate(state_start)

        def per_env(value: Callable[[Simulation, Task], object]) -> np.ndarray:
            return np.repeat(np.array([value(simulation, task) for simulation, task in robots]), num_envs, axis=0)

        self._sensors, self._root_row = sensors, root_row
        self._position, self._turned = quantity_columns("position").start, quantity_columns("exponential_map")
        address = per_env(lambda simulation, _: _planar_addresses(simulation))
        self._forward, self._height, self._pitch = (env_start[:, None] + address).T
        self._height_offset = per_env(_height_offset)
        self._speed_weight = per_env(lambda s, t: t.forward_weight / ((t.frame_skip or 1) * s.model.opt.timestep))
        self._rate = per_env(lambda s, t: (s.base != "fixed") / ((t.frame_skip or 1) * s.model.opt.timestep))
        self._alive = per_env(lambda _, t: t.alive_bonus)
        self._low, self._high = per_env(lambda s, t: _or_infinite(s, t.healthy_height, -math.inf)).T
        self._max_pitch = per_env(lambda s, t: _or_infinite(s, t.healthy_pitch)[0])
        self._max_state = per_env(lambda _, t: math.inf if t.healthy_state is None else t.healthy_state)
        self._free = np.flatnonzero(per_env(lambda s, _: s.base == "free"))
        self._upright = per_env(lambda s, _: start_frame(s)[3:])[self._free]
        self._bounded = np.flatnonzero(np.isfinite(self._max_state))
        size = per_env(lambda s, _: s.model.nq + s.model.nv)
        self._state_span = np.stack([env_start + 3, env_start + 1 + size], axis=1)[self._bounded].ravel()
        env = np.arange(sum(num_envs))
        self._ctrl_env = np.repeat(env, per_env(lambda s, _: len(s.tokens.actuators)))
        weights = [np.tile(_control_weights(s, t), n) for (s, t), n in zip(robots, num_envs, strict=True)]
        self._ctrl_weight = np.concatenate(weights)
        self._ctrl_rest = np.concatenate(
            [np.tile(_control_rest(s), n) for s, n in zip(simulations, num_envs, strict=True)]
        )
        self._tip_env = np.flatnonzero(per_env(lambda _, t: t.tip_height_weight != 0))
        tips = per_env(lambda s, _: _tip(s))[self._tip_env]
        self._tip_row = root_row[self._tip_env] + tips[:, 0].astype(np.intp)
        self._tip_point = tips[:, 1:4]
        self._tip_scale = per_env(lambda _, t: t.tip_height_weight)[self._tip_env] / tips[:, 4]

    def forward(self, state: np.ndarray) -> np.ndarray:
        """World x of every environment's robot at flat `state`, m, (environments,); meaningless on a fixed base."""
        forward = state.take(self._forward)
        if len(self._free):
            forward[self._free] = self._sensors[self._root_row[self._free], self._position]
        return forward

    def __call__(
        self, forward_before: np.ndarray, state: np.ndarray, ctrl: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Reward, float64 (environments,), and termination, bool (environments,).

        Args:
            forward_before: What `forward` gave before the step.
            state: Flat states after it, which `sensors` belong to.
            ctrl: Flat controls as given to the simulator.
        """
        ctrl = ctrl - self._ctrl_rest
        cost = np.bincount(self._ctrl_env, ctrl * ctrl * self._ctrl_weight, minlength=len(self._alive))
        moved = self.forward(state) - forward_before
        reward = moved * self._speed_weight + self._alive - cost
        tip = np.zeros(0)
        if len(self._tip_env):
            tip = self._tip_scale * self._tip_height()
            reward[self._tip_env] += tip
        self._latest = moved, cost, tip
        height = state.take(self._height) + self._height_offset
        pitch = np.abs(state.take(self._pitch))
        if len(self._free):
            roots = self._sensors[self._root_row[self._free]]
            height[self._free] = roots[:, self._position + 2]
            pitch[self._free] = tilt(roots[:, self._turned], self._upright)
        healthy = (height > self._low) & (height < self._high) & (pitch < self._max_pitch)
        if len(self._bounded):
            padded = np.append(np.abs(state), 0.0)  # reduceat needs an index past the last segment
            largest = np.maximum.reduceat(padded, self._state_span)[::2]
            healthy[self._bounded] &= largest < self._max_state[self._bounded]
        return reward, ~healthy

    def terms(self) -> dict[str, np.ndarray]:
        """What the latest rewards are sums of, and `x_velocity`, forward, m/s; float64 (environments,) each."""
        moved, cost, tips = self._latest
        tip = np.zeros(len(self._alive))
        tip[self._tip_env] = tips
        return {
            "x_velocity": moved * self._rate,
            "reward_forward": moved * self._speed_weight,
            "reward_alive": self._alive.copy(),
            "reward_control": -cost,
            "reward_tip": tip,
        }

    def _tip_height(self) -> np.ndarray:
        """Height of the tips above the root's frame, m."""
        limb = self._sensors[self._tip_row]
        real, x, y, z = limb[:, self._turned].T
        up = np.stack([2 * (x * z - real * y), 2 * (y * z + real * x), 1 - 2 * (x * x + y * y)], axis=1)
        roots = self._sensors[self._root_row[self._tip_env], self._position + 2]
        return limb[:, self._position + 2] + np.einsum("ij,ij->i", up, self._tip_point) - roots


def tilt(quaternion: np.ndarray, upright: np.ndarray) -> np.ndarray:
    """Angle between world z and the body axis that points along world z at `upright`, rad, (n,).

    Args:
        quaternion: Unit quaternions, (n, 4), real part first.
        upright: Unit quaternions, (n, 4).
    """
    w, x, y, z = quaternion.T
    uw, ux, uy, uz = upright.T
    about_x = x * uw - w * ux - y * uz + z * uy
    about_y = y * uw - w * uy + x * uz - z * ux
    return 2 * np.arcsin(np.minimum(np.hypot(about_x, about_y), 1.0))


def _planar_addresses(simulation: Simulation) -> tuple[int, int, int]:
    """Index of x, height and pitch in an environment's state; of anything unless the base is planar."""
    if simulation.base != "planar":
        return 0, 0, 0
    x, z, pitch = (1 + int(simulation.model.jnt_qposadr[joint]) for joint in simulation.base_joints)
    return x, z, pitch


def _height_offset(simulation: Simulation, task: Task) -> float:
    """What to add to the z slide's coordinate."""
    if not task.height_in_world or simulation.base != "planar":
        return 0.0
    address = simulation.model.jnt_qposadr[simulation.base_joints[1]]
    return float(start_frame(simulation)[2] - simulation.start[address])


def _or_infinite(
    simulation: Simulation, bound: tuple[float, float] | float | None, low: float = math.inf
) -> tuple[float, float]:
    """The bound of a robot that can move; infinite where there is none or the base is fixed."""
    if bound is None or simulation.base == "fixed":
        return low, math.inf
    return bound if isinstance(bound, tuple) else (bound, bound)


def _control_rest(simulation: Simulation) -> np.ndarray:
    """The control of each actuator that costs nothing: the start pose of a servo around it, otherwise 0."""
    tokens = simulation.tokens.actuators
    return np.array([((t.low or 0.0) + (t.high or 0.0)) / 2 if t.joint in simulation.gains else 0.0 for t in tokens])


def _control_weights(simulation: Simulation, task: Task) -> np.ndarray:
    """Weight of every squared control."""
    weights = np.full(len(simulation.tokens.actuators), task.control_cost)
    rest = _control_rest(simulation)
    for i, token in enumerate(simulation.tokens.actuators):
        bound = max(abs((token.low or 0.0) - rest[i]), abs((token.high or 0.0) - rest[i]))
        if task.control_as_share and bound > 0:
            weights[i] /= bound**2
    return weights


def _tip(simulation: Simulation) -> tuple[float, ...]:
    """Limb whose tip counts, the tip in the limb's frame (3, m), and the reach from the root's frame to there, m."""
    tip = find_tip(simulation)
    return float(tip.limb), *tip.point.tolist(), tip.reach
