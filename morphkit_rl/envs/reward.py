"""Rewards and endings of all environments of many robots in one pass over flat buffers."""

from __future__ import annotations

import math
from collections.abc import Sequence

import mujoco
import numpy as np

from morphkit.simulation import Simulation
from morphkit_rl.envs.tasks import Task, start_height


class RewardPass:
    """Computes reward and termination of every environment from the states before and after a step.

    Args:
        simulations: The robots.
        tasks: Their tasks.
        num_envs: Environments of each.
        state_offset: Where in the flat state vector each robot's first environment starts.
        state_size: Length of one environment's state: time, qpos, qvel, ...
        first_row: First row of limb sensors of each robot.
        sensors: Flat buffer of limb sensors of the state after the step; rows of 13 numbers.
    """

    def __init__(
        self,
        simulations: Sequence[Simulation],
        tasks: Sequence[Task],
        num_envs: Sequence[int],
        state_offset: Sequence[int],
        state_size: Sequence[int],
        first_row: np.ndarray,
        sensors: np.ndarray,
    ) -> None:
        def per_env(values: Sequence[float]) -> np.ndarray:
            return np.repeat(np.array(values, dtype=float), num_envs)

        env_start = np.concatenate(
            [o + np.arange(n) * size for o, n, size in zip(state_offset, num_envs, state_size, strict=True)]
        )
        address = [_base_addresses(simulation) for simulation in simulations]
        forward, height, turn = (np.repeat(column, num_envs) for column in np.array(address).T)
        self._forward, self._height, self._pitch = env_start + forward, env_start + height, env_start + turn
        self._height_offset = per_env(
            [
                start_height(s) - s.model.qpos0[a[1] - 1] if task.height_in_world and s.base == "planar" else 0.0
                for s, task, a in zip(simulations, tasks, address, strict=True)
            ]
        )
        moving = [simulation.base != "fixed" for simulation in simulations]
        self._speed_weight = per_env(
            [
                on * task.forward_weight / ((task.frame_skip or 1) * s.model.opt.timestep)
                for s, task, on in zip(simulations, tasks, moving, strict=True)
            ]
        )
        self._alive = per_env([task.alive_bonus for task in tasks])
        ranges = [
            task.healthy_height if task.healthy_height and on else (-math.inf, math.inf)
            for task, on in zip(tasks, moving, strict=True)
        ]
        self._low, self._high = per_env([low for low, _ in ranges]), per_env([high for _, high in ranges])
        self._max_pitch = per_env(
            [
                math.inf if t.healthy_pitch is None or not on else t.healthy_pitch
                for t, on in zip(tasks, moving, strict=True)
            ]
        )
        self._max_state = per_env([math.inf if task.healthy_state is None else task.healthy_state for task in tasks])
        self._bounded = np.flatnonzero(np.isfinite(self._max_state))
        span = np.repeat([s.model.nq + s.model.nv for s in simulations], num_envs)
        self._state_span = np.stack([env_start + 3, env_start + 1 + span], axis=1)[self._bounded].ravel()
        self._free = np.flatnonzero(np.repeat([simulation.base == "free" for simulation in simulations], num_envs))
        upright = [
            s.model.qpos0[a[2] - 1 : a[2] + 3] if s.base == "free" else np.zeros(4)
            for s, a in zip(simulations, address, strict=True)
        ]
        self._upright = np.repeat(np.array(upright), num_envs, axis=0)[self._free]
        self._quaternion = self._pitch[self._free][:, None] + np.arange(4)
        self._prepare_controls(simulations, tasks, num_envs)
        self._prepare_tips(simulations, tasks, num_envs, first_row, sensors)

    def _prepare_controls(
        self, simulations: Sequence[Simulation], tasks: Sequence[Task], num_envs: Sequence[int]
    ) -> None:
        weights, owners, first = [], [], 0
        for simulation, task, n in zip(simulations, tasks, num_envs, strict=True):
            weight = np.full(simulation.model.nu, task.control_cost)
            if task.control_as_share:
                bound = np.abs(simulation.model.actuator_ctrlrange).max(axis=1, initial=0.0)
                limited = simulation.model.actuator_ctrllimited.astype(bool) & (bound > 0)
                weight[limited] /= bound[limited] ** 2
            weights.append(np.tile(weight, n))
            owners.append(np.repeat(np.arange(first, first + n), simulation.model.nu))
            first += n
        self._ctrl_weight, self._ctrl_env = np.concatenate(weights), np.concatenate(owners)

    def _prepare_tips(
        self,
        simulations: Sequence[Simulation],
        tasks: Sequence[Task],
        num_envs: Sequence[int],
        first_row: np.ndarray,
        sensors: np.ndarray,
    ) -> None:
        envs: list[int] = []
        rows: list[int] = []
        roots: list[int] = []
        points: list[np.ndarray] = []
        scales: list[float] = []
        first = 0
        for robot, (simulation, task, n) in enumerate(zip(simulations, tasks, num_envs, strict=True)):
            if task.tip_height_weight:
                limb, point, reach = _tip(simulation)
                root = first_row[robot] + np.arange(n) * len(simulation.limb_body)
                envs += range(first, first + n)
                roots += root.tolist()
                rows += (root + limb).tolist()
                points += [point] * n
                scales += [task.tip_height_weight / reach] * n
            first += n
        self._tip_env, self._tip_scale = np.array(envs, np.intp), np.array(scales)
        self._tip_row, self._tip_root = np.array(rows, np.intp), np.array(roots, np.intp)
        self._tip_point = np.array(points).reshape(-1, 3)
        self._sensors = sensors.reshape(-1, 13)

    def __call__(self, before: np.ndarray, after: np.ndarray, ctrl: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Reward, float64 (environments,), and termination, bool (environments,).

        Args:
            before: Flat states before the step.
            after: Flat states after it.
            ctrl: Flat controls as given to the simulator.
        """
        cost = np.bincount(self._ctrl_env, ctrl * ctrl * self._ctrl_weight, minlength=len(self._alive))
        moved = after.take(self._forward) - before.take(self._forward)
        reward = moved * self._speed_weight + self._alive - cost
        if len(self._tip_env):
            reward[self._tip_env] += self._tip_scale * self._tip_height()
        height = after.take(self._height) + self._height_offset
        pitch = np.abs(after.take(self._pitch))
        if len(self._free):
            pitch[self._free] = tilt(after.take(self._quaternion), self._upright)
        healthy = (height > self._low) & (height < self._high) & (pitch < self._max_pitch)
        if len(self._bounded):
            padded = np.append(np.abs(after), 0.0)  # reduceat needs an index past the last segment
            largest = np.maximum.reduceat(padded, self._state_span)[::2]
            healthy[self._bounded] &= largest < self._max_state[self._bounded]
        return reward, ~healthy

    def _tip_height(self) -> np.ndarray:
        limb = self._sensors[self._tip_row]
        _, x, y, z = limb[:, 9:13].T
        real = limb[:, 9]
        down_row = np.stack([2 * (x * z - real * y), 2 * (y * z + real * x), 1 - 2 * (x * x + y * y)], axis=1)
        return limb[:, 2] + np.einsum("ij,ij->i", down_row, self._tip_point) - self._sensors[self._tip_root, 2]


def tilt(quaternion: np.ndarray, upright: np.ndarray) -> np.ndarray:
    """Angle between world z and the body axis that points along world z at `upright`, rad.

    Args:
        quaternion: (n, 4), real part first, any length but zero.
        upright: (n, 4) or (4,).
    """
    w, x, y, z = np.moveaxis(quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True), -1, 0)
    uw, ux, uy, uz = np.moveaxis(upright / np.linalg.norm(upright, axis=-1, keepdims=True), -1, 0)
    about_x = x * uw - w * ux - y * uz + z * uy
    about_y = y * uw - w * uy + x * uz - z * ux
    return 2 * np.arcsin(np.minimum(np.hypot(about_x, about_y), 1.0))


def _base_addresses(simulation: Simulation) -> tuple[int, int, int]:
    """Index in one environment's state of x, height, and pitch or first quaternion number; 0 on a fixed base."""
    address = [1 + int(simulation.model.jnt_qposadr[joint]) for joint in simulation.base_joints]
    if simulation.base == "free":
        return address[0], address[0] + 2, address[0] + 3
    return (address[0], address[1], address[2]) if simulation.base == "planar" else (0, 0, 0)


def _tip(simulation: Simulation) -> tuple[int, np.ndarray, float]:
    """Limb whose tip counts, its tip in the limb's frame, m, and the reach from the root's frame to there, m."""
    model, limbs = simulation.model, simulation.morphology.limbs
    index = {limb.name: i for i, limb in enumerate(limbs)}
    chains = [[0]]
    for i, limb in enumerate(limbs[1:], 1):
        chains.append([*chains[index[limb.parent or ""]], i])
    chain = max(reversed(chains), key=len)
    point = 2 * model.body_ipos[simulation.limb_body[chain[-1]]]
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    places = data.xpos[simulation.limb_body[chain]]
    reach = float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum() + np.linalg.norm(point))
    return chain[-1], np.array(point), max(reach, 1e-6)
