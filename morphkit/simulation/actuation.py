"""How motors are driven: by torques, by target positions, or as the file says."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Any, NamedTuple

import mujoco
import numpy as np

from morphkit.description import Actuation, RobotInfo
from morphkit.errors import ConfigError
from morphkit.morphology import Actuator, Base
from morphkit.simulation.ground import can_touch

EFFORT_DEFLECTION_RAD = 0.5
"""How far a joint has to be from its target for the whole effort limit."""
EFFORT_DEFLECTION_M = 0.1
"""The same of a slide without limits; one with limits: a quarter of its travel."""
FREE_FREQUENCY_HZ = 10.0
"""Natural frequency of a joint without an effort limit."""
MOST_LOADS = 2.0
"""Loads, see `Drive.load`, that an effort limit counts up to; some files give limits that no motor of that size has."""
MOST_STEPS = 0.5
"""Natural frequency times time step, rad, that no servo goes beyond."""

_GRAVITY = 9.81  # m/s^2
_HINGE, _SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
_LINEAR = int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE)


class Gains(NamedTuple):
    """Stiffness, N*m/rad (N/m), and damping, N*m*s/rad (N*s/m), of a joint's servo."""

    stiffness: float
    damping: float


@dataclass(frozen=True, slots=True)
class Drive:
    """What is known of an actuator that drives one hinge or slide.

    Attributes:
        index: Its place among the model's actuators.
        joint: Name of the joint.
        dof: The joint's degree of freedom.
        start: Where the joint starts, rad (m).
        effort: Largest torque, N*m (N), at the joint; inf without a limit.
        load: Torque, N*m, of the robot's weight at its full extent, or its weight, N, for a slide.
        deflection: Distance from the target at which the whole effort is reached, rad (m); targets go as far.
        gear: Length of the actuator over the coordinate of the joint.
        own: Gains of a servo that the file has there; None where it has a motor.
        unit: Unit of the joint's coordinate.
    """

    index: int
    joint: str
    dof: int
    start: float
    effort: float
    load: float
    deflection: float
    gear: float
    own: Gains | None
    unit: str


def choose(asked: Actuation | None, info: RobotInfo, base: Base, *, own_actuators: bool) -> Actuation:
    """What is asked for, else what `robot.toml` says, else `position` on a free base whose file has no actuators."""
    default: Actuation = "position" if base == "free" and not own_actuators else "as-file"
    return asked or info.actuation or default


def drive(
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    start: np.ndarray,
    actuators: Sequence[Actuator],
    kind: Actuation,
    info: RobotInfo,
) -> tuple[tuple[Actuator, ...], dict[str, Gains]]:
    """Make motors or position servos of the actuators that drive a single hinge or slide; others stay as they are.

    A servo is MuJoCo's own position actuator: torque = stiffness * (target - angle) - damping * speed, within the
    effort limit, with targets within `action_scale` of the start pose. Its gains are those that `robot.toml` gives;
    else those of the file's position actuator; else

        stiffness = effort limit / 0.5 rad, without a limit inertia * (2 pi 10 Hz)^2,
        damping = 2 sqrt(stiffness * inertia),

    where inertia is that of the joint space, armature included (diagonal of the mass matrix at the reference pose); an
    effort limit counts up to twice the torque of the robot's weight at its full extent (for a slide, twice its weight);
    stiffness stays below what turns by half a radian of its natural frequency within a time step.

    Args:
        spec: Changed in place.
        model: `spec` compiled.
        start: The start pose, (nq,).
        actuators: Its actuators, as they were read.
        kind: `torque` or `position`; `as-file` changes nothing.
        info: What `robot.toml` says.

    Returns:
        The actuators with their new ranges and units, and the gains of each joint that has a servo now.

    Raises:
        ConfigError: Torques are asked for of an actuator without any limit of its force.
    """
    if kind == "as-file":
        return tuple(actuators), {}
    made, gains = list(actuators), {}
    for own in drives(model, actuators, start):
        actuator = spec.actuators[own.index]
        if kind == "torque":
            if own.own is not None:
                made[own.index] = _to_motor(actuator, made[own.index], own)
            continue
        gains[own.joint] = chosen_gains(model, own, info.gains)
        made[own.index] = _to_servo(actuator, made[own.index], own, gains[own.joint], info.action_scale)
    return tuple(made), gains


def drives(model: mujoco.MjModel, actuators: Sequence[Actuator], start: np.ndarray) -> list[Drive]:
    """The actuators that drive one hinge or slide by a force that is linear in control and joint; `start` is (nq,)."""
    found, loads = [], _loads(model, start)
    for index, actuator in enumerate(actuators):
        plain = model.actuator_dyntype[index] == mujoco.mjtDyn.mjDYN_NONE
        plain &= model.actuator_gaintype[index] == mujoco.mjtGain.mjGAIN_FIXED
        plain &= model.actuator_biastype[index] in _LINEAR
        plain &= model.actuator_trntype[index] == mujoco.mjtTrn.mjTRN_JOINT
        joint = int(model.actuator_trnid[index, 0])
        if plain and actuator.joint is not None and model.jnt_type[joint] in (_HINGE, _SLIDE):
            place = float(start[model.jnt_qposadr[joint]])
            load = loads[model.body_rootid[model.jnt_bodyid[joint]]]
            found.append(_drive(model, index, actuator.joint, joint, place, load))
    return found


def chosen_gains(model: mujoco.MjModel, own: Drive, given: Mapping[str, Sequence[float]]) -> Gains:
    """Gains of a joint's servo; see `drive`."""
    stated = gains_of(own.joint, given)
    if stated is not None:
        return stated
    if own.own is not None:
        return own.own
    inertia = max(float(model.dof_M0[own.dof]), 1e-9)
    frequency = 2 * math.pi * FREE_FREQUENCY_HZ
    effort = min(own.effort, MOST_LOADS * own.load)
    stiffness = effort / own.deflection if math.isfinite(own.effort) else inertia * frequency**2
    stiffness = min(stiffness, inertia * (MOST_STEPS / model.opt.timestep) ** 2)
    return Gains(stiffness, 2 * math.sqrt(stiffness * inertia))


def gains_of(joint: str, given: Mapping[str, Sequence[float]]) -> Gains | None:
    """The gains that are given for a joint, those of the first name or pattern that matches; None without any."""
    found = (Gains(*values) for pattern, values in given.items() if pattern == joint or fnmatchcase(joint, pattern))
    return next(found, None)


def _loads(model: mujoco.MjModel, start: np.ndarray) -> dict[int, tuple[float, float]]:
    """Of each robot, by its root: its weight, N, and the torque of that at its full extent, N*m, in a pose.

    The extent is that of its centers of mass and of the geoms that can touch something; where none can, of all geoms.
    """
    data = mujoco.MjData(model)
    data.qpos[:] = start
    mujoco.mj_kinematics(model, data)
    loads, touching = {}, can_touch(model)
    for root in np.flatnonzero(model.body_parentid == 0)[1:]:
        own, bodies = model.body_rootid[model.geom_bodyid] == root, model.body_rootid == root
        counted = own & touching if (own & touching).any() else own
        away = np.linalg.norm(data.geom_xpos[counted] - data.xpos[root], axis=1) + model.geom_rbound[counted]
        massive = bodies & (model.body_mass > 0)
        mass_away = np.linalg.norm(data.xipos[massive] - data.xpos[root], axis=1)
        weight = _GRAVITY * float(model.body_subtreemass[root])
        loads[int(root)] = weight, weight * float(max(away.max(initial=0.0), mass_away.max(initial=0.0)))
    return loads


def _drive(model: mujoco.MjModel, index: int, name: str, joint: int, start: float, loads: tuple[float, float]) -> Drive:
    gear = float(model.actuator_gear[index, 0])
    gain, bias = float(model.actuator_gainprm[index, 0]), model.actuator_biasprm[index]
    servo = model.actuator_biastype[index] == mujoco.mjtBias.mjBIAS_AFFINE and bias[1] != 0
    limits = [math.inf]
    if model.actuator_forcelimited[index]:
        limits.append(float(np.abs(model.actuator_forcerange[index]).max()) * abs(gear))
    if model.jnt_actfrclimited[joint]:
        limits.append(float(np.abs(model.jnt_actfrcrange[joint]).max()))
    if model.actuator_ctrllimited[index] and model.actuator_biastype[index] == mujoco.mjtBias.mjBIAS_NONE:
        limits.append(float(np.abs(model.actuator_ctrlrange[index]).max()) * abs(gain * gear))
    slide = model.jnt_type[joint] == _SLIDE
    low, high = model.jnt_range[joint]
    travel = (high - low) / 4 if model.jnt_limited[joint] and high > low else EFFORT_DEFLECTION_M
    return Drive(
        index=index,
        joint=name,
        dof=int(model.jnt_dofadr[joint]),
        start=start,
        effort=min(limits),
        load=loads[0] if slide else loads[1],
        deflection=float(travel) if slide else EFFORT_DEFLECTION_RAD,
        gear=gear,
        own=Gains(gain * gear**2, -float(bias[2]) * gear**2) if servo else None,
        unit="m" if slide else "rad",
    )


def _to_servo(actuator: Any, read: Actuator, own: Drive, gains: Gains, scale: float | None) -> Actuator:
    reach = own.deflection * (1.0 if scale is None else scale)
    actuator.set_to_position(kp=gains.stiffness, kv=gains.damping)
    _limit_force(actuator, own.effort)
    actuator.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE
    actuator.ctrlrange = [own.start - reach, own.start + reach]
    return replace(read, low=own.start - reach, high=own.start + reach, unit=own.unit)


def _to_motor(actuator: Any, read: Actuator, own: Drive) -> Actuator:
    if not math.isfinite(own.effort):
        raise ConfigError(
            f"actuator {read.name!r} has no limit of its force, so that it cannot be driven by torques; give it a"
            " forcerange, or take another actuation"
        )
    actuator.set_to_motor()
    _limit_force(actuator, own.effort)
    actuator.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE
    actuator.ctrlrange = [-own.effort, own.effort]
    return replace(read, low=-own.effort, high=own.effort, unit="N*m" if own.unit == "rad" else "N")


def _limit_force(actuator: Any, effort: float) -> None:
    actuator.gear = [1.0, 0, 0, 0, 0, 0]
    limited = math.isfinite(effort)
    actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE if limited else mujoco.mjtLimited.mjLIMITED_FALSE
    actuator.forcerange = [-effort, effort] if limited else [0, 0]
