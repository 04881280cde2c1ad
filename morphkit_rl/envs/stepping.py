"""Buffers of simulated robots, and the threads that advance and sense them through `mujoco.rollout`."""

from __future__ import annotations

import copy
import ctypes
from collections.abc import Collection, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import NamedTuple

import mujoco
import numpy as np
from mujoco import _callbacks
from mujoco.rollout import Rollout

from morphkit.errors import ConfigError, DescriptionError
from morphkit.simulation.build import Simulation
from morphkit.simulation.mujoco_warnings import no_warnings
from morphkit_rl.envs.task_settings import Task

_STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS.value
_RUNGE_KUTTA_COST = 3.2  # Euler steps that take as long as a Runge-Kutta step, measured on the benchmark's bodies


class SteppedRobot:
    """One robot's models and buffers.

    Attributes:
        name: Name of the robot.
        model: The robot.
        models: The model that each environment steps; all of one size.
        state: (n, size): time, qpos, qvel and what else the simulator keeps; a view into all robots' states.
        sensors: (n, 1, 13 * limbs): a view into all robots' limb sensors.
        start: The noise-free start state, (size,).
        ctrl: (n, frame_skip, actuators), the control of every simulator step.
        declared: (n, numbers): what the sensors of the file read, where that is observed.
        bounds: Lower and upper bounds of the controls, (2, actuators).
    """

    state: np.ndarray
    sensors: np.ndarray

    def __init__(self, simulation: Simulation, task: Task, n: int) -> None:
        self.name, self.model = simulation.name, copy.deepcopy(simulation.model)
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_SENSOR  # they are read from `kinematics` alone
        if self.model.ntree == 1:  # looking for groups of bodies that touch changes nothing, but costs 6 % of a step
            self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
        self.model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)  # who sleeps is no part of the state
        self.models, self.kinematics = [self.model] * n, simulation.kinematics
        self.nq, self.nv, self.frame_skip = self.model.nq, self.model.nv, task.frame_skip or 1
        self.start = np.empty(mujoco.mj_stateSize(self.model, _STATE))
        mujoco.mj_getState(self.model, mujoco.MjData(self.model), self.start, _STATE)
        self.start[1 : 1 + self.nq] = simulation.start
        self.ctrl = np.zeros((n, self.frame_skip, self.model.nu))
        self.states = np.zeros((n, self.frame_skip, self.start.size))
        low = [-np.inf if token.low is None else token.low for token in simulation.tokens.actuators]
        high = [np.inf if token.high is None else token.high for token in simulation.tokens.actuators]
        self.bounds = np.array([low, high])
        # Where the file has sensors of its own, those of the limbs are a part of what the simulator writes.
        limb_sensor = simulation.limb_sensor.ravel()
        self.part = None if self.model.nsensordata == limb_sensor.size else limb_sensor
        self.declared, self.declared_part = np.zeros((n, 0)), np.zeros(0, np.intp)
        self._quaternions = [
            int(address) + (3 if kind == mujoco.mjtJoint.mjJNT_FREE else 0)
            for address, kind in zip(self.model.jnt_qposadr, self.model.jnt_type, strict=True)
            if kind in (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL)
        ]
        confined = self._confined(simulation.start)
        self._within = self.model.jnt_qposadr[confined]
        travel, origin = self.model.jnt_range[confined], self.start[1 + self._within]
        self._travel = np.minimum(travel[:, 0], origin), np.maximum(travel[:, 1], origin)

    def _confined(self, start: np.ndarray) -> np.ndarray:
        """Ids of the joints that no noise takes out of their limits."""
        moved = (start != self.model.qpos0)[self.model.jnt_qposadr]
        slide, hinge = (
            self.model.jnt_type == kind for kind in (mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE)
        )
        return np.flatnonzero((slide | (hinge & moved)) & (self.model.jnt_limited != 0))

    @property
    def qpos(self) -> np.ndarray:
        """Coordinates, (n, nq), a view."""
        return self.state[:, 1 : 1 + self.nq]

    @property
    def qvel(self) -> np.ndarray:
        """Velocities, (n, nv), a view."""
        return self.state[:, 1 + self.nq : 1 + self.nq + self.nv]

    def sense_declared(self, simulation: Simulation, quantities: Collection[str]) -> None:
        """Let these quantities of the file's sensors be read. They may depend on forces, so sensing costs as a step.

        Raises:
            ConfigError: MuJoCo does not simulate one of them.
        """
        self.declared_part = declared_addresses(simulation, quantities)
        self.declared = np.zeros((len(self.state), len(self.declared_part)))
        self.kinematics = copy.deepcopy(simulation.model)
        self.kinematics.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
        self.kinematics.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
        self.part = simulation.limb_sensor.ravel()

    def sensed_ctrl(self, which: slice | np.ndarray) -> np.ndarray | None:
        """Controls of environments `which` that declared sensors may depend on, (k, 1, actuators); None without any."""
        return np.ascontiguousarray(self.ctrl[which, -1:]) if len(self.declared_part) else None

    def take_sensors(self, which: slice | np.ndarray, sensordata: np.ndarray) -> None:
        """Take what was sensed of environments `which`, (k, 1, numbers)."""
        self.sensors[which] = sensordata if self.part is None else sensordata[..., self.part]
        if len(self.declared_part):
            self.declared[which] = sensordata[:, 0, self.declared_part]

    @property
    def cost(self) -> float:
        """Roughly what one environment's step costs, to share the work between threads."""
        runge_kutta = self.model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4
        return (self.frame_skip * (_RUNGE_KUTTA_COST if runge_kutta else 1) + 0.5) * (self.nv + 3)

    def draw_start(self, rng: np.random.Generator, task: Task, n: int) -> np.ndarray:
        """Start states (n, size): the model's own with the task's noise.

        Noise is for angles and for free motion; what has limits stays within these where it is a slide, such as a
        finger, or a hinge that starts elsewhere than at its zero.
        """
        state = np.tile(self.start, (n, 1))
        qpos, qvel = state[:, 1 : 1 + self.nq], state[:, 1 + self.nq : 1 + self.nq + self.nv]
        qpos += rng.uniform(-task.qpos_noise, task.qpos_noise, qpos.shape)
        qpos[:, self._within] = qpos[:, self._within].clip(*self._travel)
        uniform = task.qvel_noise_kind == "uniform"
        noise = rng.uniform(-1.0, 1.0, qvel.shape) if uniform else rng.standard_normal(qvel.shape)
        qvel += task.qvel_noise * noise
        for at in self._quaternions:
            qpos[:, at : at + 4] /= np.linalg.norm(qpos[:, at : at + 4], axis=1, keepdims=True)
        return state


def declared_addresses(simulation: Simulation, quantities: Collection[str]) -> np.ndarray:
    """Index in `sensordata` of every reading of such quantities by the sensors that a file declares, int (readings,).

    Raises:
        ConfigError: MuJoCo does not simulate one of them, as those of a URDF.
    """
    model, found = simulation.model, []
    for sensor in simulation.morphology.sensors:
        wanted = [i for i, reading in enumerate(sensor.readings) if reading.quantity in quantities]
        if not wanted:
            continue
        number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SENSOR, sensor.name)
        if number < 0 or model.sensor_dim[number] != len(sensor.readings):
            raise ConfigError(
                f"{simulation.name}: MuJoCo does not simulate the sensor {sensor.name!r} ({sensor.kind}), so that it"
                " cannot be observed; convert the robot to MJCF and declare sensors there"
            )
        found += [int(model.sensor_adr[number]) + i for i in wanted]
    return np.array(found, np.intp)


class _Piece:
    """Some consecutive environments of a robot, which one thread works on; all arrays are views."""

    def __init__(self, robot: SteppedRobot, first: int, last: int) -> None:
        self.robot, n = robot, last - first
        self.models, self.data = robot.models[first:last], [mujoco.MjData(robot.model)]
        self.kinematics, self.kinematics_data = [robot.kinematics] * n, [mujoco.MjData(robot.kinematics)]
        self.state, self.ctrl, self.states = robot.state[first:last], robot.ctrl[first:last], robot.states[first:last]
        self.which = slice(first, last)
        self.sensordata = robot.sensors[first:last] if robot.part is None else np.zeros((n, 1, robot.model.nsensordata))

    def advance(self, pool: Rollout) -> None:
        # No warm start: a step depends on the state alone. Arrays are C-contiguous float64 of the right shapes.
        pool.rollout(
            self.models,
            self.data,
            self.state,
            self.ctrl,
            skip_checks=True,
            nstep=self.robot.frame_skip,
            state=self.states,
        )
        self.state[:] = self.states[:, -1]

    def sense(self, pool: Rollout) -> None:
        pool.rollout(
            self.kinematics,
            self.kinematics_data,
            self.state,
            self.robot.sensed_ctrl(self.which),
            skip_checks=True,
            nstep=1,
            sensordata=self.sensordata,
        )
        if self.robot.part is not None:
            self.robot.take_sensors(self.which, self.sensordata)


class _Share(NamedTuple):
    """What one thread works on."""

    pool: Rollout
    pieces: list[_Piece]

    def advance_and_sense(self) -> None:
        for piece in self.pieces:
            try:
                piece.advance(self.pool)
                piece.sense(self.pool)
            except mujoco.FatalError as error:
                raise DescriptionError(f"{piece.robot.name}: MuJoCo cannot simulate it: {error}") from None

    def sense(self) -> None:
        for piece in self.pieces:
            piece.sense(self.pool)


class Stepper:
    """Shares environments between threads once and for all.

    MuJoCo's own thread pool would have to be waited for once a robot and call; here every thread goes through its share
    of all robots and is waited for once a step. MuJoCo's profiler is switched off for the whole process.

    Args:
        robots: Robots whose `state` and `sensors` are set.
        num_threads: How many threads work, the calling one included.
    """

    def __init__(self, robots: Sequence[SteppedRobot], num_threads: int) -> None:
        _switch_profiler_off()
        total = sum(robot.cost * len(robot.state) for robot in robots)
        self._shares = [_Share(Rollout(nthread=0), []) for _ in range(num_threads)]
        before = 0.0
        for robot in robots:
            n = len(robot.state)
            limits = (np.arange(1, num_threads + 1) * total / num_threads - before) / robot.cost
            cuts = np.clip(np.round(limits), 0, n).astype(int)
            cuts[-1] = n
            for share, first, last in zip(self._shares, [0, *cuts[:-1]], cuts, strict=True):
                if last > first:
                    share.pieces.append(_Piece(robot, int(first), int(last)))
            before += robot.cost * n
        self._shares = [share for share in self._shares if share.pieces]
        self._threads = ThreadPoolExecutor(len(self._shares) - 1, "morphkit-env") if len(self._shares) > 1 else None

    def advance_and_sense(self) -> None:
        """Advance all environments by a control step, then fill in all sensors.

        Raises:
            DescriptionError: MuJoCo cannot go on at all, such as for lack of memory.
        """
        with no_warnings():
            helpers = [self._threads.submit(share.advance_and_sense) for share in self._shares[1:] if self._threads]
            self._shares[0].advance_and_sense()
            for helper in helpers:
                helper.result()

    def sense(self) -> None:
        """Fill in all sensors."""
        with no_warnings():
            for share in self._shares:
                share.sense()

    def sense_some(self, robot: SteppedRobot, which: np.ndarray) -> None:
        """Fill in the sensors of some of a robot's environments."""
        piece = next(piece for share in self._shares for piece in share.pieces if piece.robot is robot)
        out = np.empty((len(which), 1, robot.model.nsensordata))
        with no_warnings():
            self._shares[0].pool.rollout(
                [robot.kinematics] * len(which),
                piece.kinematics_data,
                np.ascontiguousarray(robot.state[which]),
                robot.sensed_ctrl(which),
                skip_checks=True,
                nstep=1,
                sensordata=out,
            )
        robot.take_sensors(which, out)

    def close(self) -> None:
        """Stop the threads."""
        if self._threads is not None:
            self._threads.shutdown()
        for share in self._shares:
            share.pool.close()


def _switch_profiler_off() -> None:
    """Stop MuJoCo from timing every stage of a simulator step, which takes a sixth of the step.

    The library times nothing unless its variable `mjcb_time` is set, as the Python package does when it is imported.
    `MjData.timer` stays empty then; `mujoco.set_mjcb_time(None)` brings the package's clock back.
    """
    with suppress(ValueError, OSError):  # where the variable cannot be reached, the clock goes on running
        ctypes.c_void_p.in_dll(ctypes.CDLL(_callbacks.__file__), "mjcb_time").value = None
