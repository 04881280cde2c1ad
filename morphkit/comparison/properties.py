"""A robot as flat tables of named facts: what two robots are compared by."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from morphkit.comparison import arrays
from morphkit.description import Description
from morphkit.morphology import Actuator, Morphology
from morphkit.simulation.inspection_model import JOINT_KINDS, Mechanics, load_mechanics
from morphkit.simulation.limb_inertia import limb_masses
from morphkit.simulation.start_pose import couplings
from morphkit.tokens.spec import TokenSpec, token_spec

Value = str | float | tuple[float, ...] | tuple[str, ...] | None
Table = dict[str, dict[str, Value]]
"""Name of a limb, joint, actuator or token -> name of a fact -> its value."""

_UNITS = {
    "mass": "kg",
    "center of mass": "m",
    "inertia": "kg*m^2",
    "position": "m",
    "anchor": "m",
    "start height": "m",
}


_TARGETS = {
    int(mujoco.mjtTrn.mjTRN_TENDON): "tendon",
    int(mujoco.mjtTrn.mjTRN_SITE): "site",
    int(mujoco.mjtTrn.mjTRN_BODY): "body",
    int(mujoco.mjtTrn.mjTRN_SLIDERCRANK): "site",
}


@dataclass(frozen=True)
class Facts:
    """A robot in tables; a fact that its format has no words for is absent.

    Attributes:
        morphology: The robot.
        robot: Facts of the robot as a whole, under the empty name.
        limbs: Parent, place in the parent's frame, masses of every limb.
        joints: Kind, range, axis and passive forces of every moving joint, those of the base included.
        actuators: What every actuator drives and within which bounds.
        sensor_tokens: Every sensor token in order, those of the declared sensors last.
        actuator_tokens: Every actuator token, in order.
        elements: Of an MJCF, what the arrays of the compiled model hold of bodies, sites, cameras, tendons, equalities,
            sensors, geoms, and contact pairs and exclusions: kind -> table.
        mass: Mass of the robot, kg; None where that of a limb is not known.
        notes: One sentence for each thing in the files that could not be used.
    """

    morphology: Morphology
    robot: Table
    limbs: Table
    joints: Table
    actuators: Table
    sensor_tokens: Table
    actuator_tokens: Table
    elements: dict[str, Table]
    mass: float | None
    notes: tuple[str, ...]


def gather_facts(description: Description) -> Facts:
    """The facts of a robot.

    Raises:
        DescriptionError: The file cannot be read or compiled.
        AssetError: An included file is missing. Missing meshes do not matter, but some masses are not known then.
    """
    mechanics = load_mechanics(description, shapes=False)
    morphology = mechanics.morphology
    masses = limb_masses(mechanics)
    known = [mass.mass for mass in masses.values() if mass is not None]
    limbs = _limbs(mechanics)
    for name, mass in masses.items():
        if mass is not None:
            limbs[name] |= {"mass": mass.mass, "center of mass": mass.center, "inertia": mass.moments}
    robot: dict[str, Value] = {"base": morphology.base, "family": morphology.family, "task": morphology.task}
    if mechanics.states_dynamics:
        robot["start height"] = float(mechanics.model.body_pos[mechanics.root, 2])
    spec = token_spec(morphology, source="all")
    joints = _joints(mechanics)
    actuators = {actuator.name: _actuator(mechanics, actuator) for actuator in morphology.actuators}
    elements: dict[str, Table] = {}
    if mechanics.states_dynamics:
        robot |= arrays.options(mechanics.model)
        elements = arrays.rows(mechanics)
        for table, rows in ((joints, elements.pop("joint")), (actuators, elements.pop("actuator"))):
            for name in table.keys() & rows.keys():
                table[name] = {**rows[name], **table[name]}
    return Facts(
        morphology=morphology,
        robot={"": robot},
        limbs=limbs,
        joints=joints,
        actuators=actuators,
        sensor_tokens=_sensor_tokens(spec),
        actuator_tokens=_actuator_tokens(spec),
        elements=elements,
        mass=sum(known) if len(known) == len(masses) else None,
        notes=mechanics.notes,
    )


def unit_of(fact: str, facts: Mapping[str, Value]) -> str:
    """The unit of a fact, empty where it has none."""
    if fact in ("range", "bounds"):
        return str(facts.get("unit") or ("m" if facts.get("kind") == "slide" else "rad"))
    if fact == "velocity limit":
        return "m/s" if facts.get("kind") == "slide" else "rad/s"
    return _UNITS.get(fact, "")


def _limbs(mechanics: Mechanics) -> Table:
    model = mechanics.model
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    table: Table = {}
    for limb in mechanics.morphology.limbs:
        facts: dict[str, Value] = {"parent": limb.parent, "type": limb.type, "fixed to it": limb.members[1:]}
        if limb.parent is not None:
            here, there = model.body(limb.name).id, model.body(limb.parent).id
            turn = data.xmat[there].reshape(3, 3).T
            facts["position"] = _numbers(turn @ (data.xpos[here] - data.xpos[there]))
            facts["orientation"] = _quaternion(turn @ data.xmat[here].reshape(3, 3))
        table[limb.name] = facts
    return table


def _joints(mechanics: Mechanics) -> Table:
    model = mechanics.model
    table: Table = {}
    leaders = {follower: (leader, factors) for follower, leader, factors in couplings(model)}
    for joint in mechanics.joints:
        kind, dof = JOINT_KINDS[int(model.jnt_type[joint])], model.jnt_dofadr[joint]
        limited = bool(model.jnt_limited[joint]) and kind != "free"
        facts: dict[str, Value] = {
            "limb": mechanics.limb_of[int(model.jnt_bodyid[joint])],
            "kind": kind,
            "range": _numbers(model.jnt_range[joint]) if limited else None,
        }
        if kind in ("hinge", "slide"):
            facts["axis"] = _numbers(model.jnt_axis[joint])
        if kind != "free":
            facts |= {"anchor": _numbers(model.jnt_pos[joint]), "damping": float(model.dof_damping[dof])}
            facts["friction loss"] = float(model.dof_frictionloss[dof])
        if mechanics.states_dynamics and kind != "free":
            facts |= {"armature": float(model.dof_armature[dof]), "stiffness": float(model.jnt_stiffness[joint])}
        name = model.joint(joint).name
        leader, factors = leaders.get(joint, (None, ()))
        facts["follows"] = None if leader is None else model.joint(leader).name
        facts["coupling"] = None if leader is None else _numbers(np.trim_zeros(factors, "b"))
        if name in mechanics.velocity_limits:
            facts["velocity limit"] = mechanics.velocity_limits[name]  # MuJoCo knows no such bound
        table[name] = facts
    return table


def _actuator(mechanics: Mechanics, actuator: Actuator) -> dict[str, Value]:
    facts: dict[str, Value] = {
        "limb": actuator.limb,
        "joint": actuator.joint,
        "unit": actuator.unit,
        "bounds": _bounds(actuator.low, actuator.high),
    }
    if mechanics.states_dynamics:
        facts |= _drive(mechanics.model, actuator.name)
    return facts


def _drive(model: mujoco.MjModel, name: str) -> dict[str, Value]:
    """Gear, gains and force limits of an actuator of the file."""
    try:
        number = model.actuator(name).id
    except KeyError:
        return {}
    forces = model.actuator_forcerange[number] if model.actuator_forcelimited[number] else None
    kind = _TARGETS.get(int(model.actuator_trntype[number]))
    target = None if kind is None else getattr(model, kind)(model.actuator_trnid[number, 0]).name
    dynamics = mujoco.mjtDyn(int(model.actuator_dyntype[number]))
    return {
        "drives": None if kind is None else f"{kind} {target}",
        "dynamics": None if dynamics == mujoco.mjtDyn.mjDYN_NONE else dynamics.name.removeprefix("mjDYN_").lower(),
        "time constants": _numbers(np.trim_zeros(model.actuator_dynprm[number], "b")),
        "gear": _numbers(np.trim_zeros(model.actuator_gear[number], "b")),
        "gain": _numbers(np.trim_zeros(model.actuator_gainprm[number], "b")),
        "bias": _numbers(np.trim_zeros(model.actuator_biasprm[number], "b")),
        "force range": None if forces is None else _numbers(forces),
    }


def _sensor_tokens(spec: TokenSpec) -> Table:
    return {
        token.name: {
            "limb": token.limb,
            "scalar": " ".join(filter(None, (token.quantity, token.component))),
            "unit": token.unit,
            "frame": token.frame,
            "bounds": _bounds(token.low, token.high),
        }
        for token in spec.sensors
    }


def _actuator_tokens(spec: TokenSpec) -> Table:
    return {
        token.name: {
            "limb": token.limb,
            "joint": token.joint,
            "unit": token.unit,
            "bounds": _bounds(token.low, token.high),
        }
        for token in spec.actuators
    }


def _bounds(low: float | None, high: float | None) -> tuple[float, ...] | None:
    low, high = -math.inf if low is None else low, math.inf if high is None else high
    return None if math.isinf(low) and math.isinf(high) else (low, high)


def _numbers(values: Any) -> tuple[float, ...]:
    return tuple(float(value) for value in np.atleast_1d(values))


def _quaternion(rotation: np.ndarray) -> tuple[float, ...]:
    """Unit quaternion of a rotation matrix, w first and not negative."""
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(rotation).ravel())
    return _numbers(-quaternion if quaternion[0] < 0 else quaternion)
