"""What the actuators and tendons of an MJCF model act along: an angle or a length, and in which units."""

from __future__ import annotations

import math
from typing import Any, Literal

import mujoco

Along = Literal["angle", "length"]
UNITS: dict[Along | None, dict[str, str]] = {
    "angle": {"force": "N*m", "position": "rad", "velocity": "rad/s"},
    "length": {"force": "N", "position": "m", "velocity": "m/s", "pressure": "Pa"},
    None: {},
}

_TRN = mujoco.mjtTrn
_JOINT = mujoco.mjtJoint
_ACTUATOR = mujoco.mjtActuator
_DYN = mujoco.mjtDyn
_KINDS = {
    _ACTUATOR.mjACTUATOR_MOTOR: "force",
    _ACTUATOR.mjACTUATOR_POSITION: "position",
    _ACTUATOR.mjACTUATOR_VELOCITY: "velocity",
    _ACTUATOR.mjACTUATOR_INTVELOCITY: "velocity",
    _ACTUATOR.mjACTUATOR_CYLINDER: "pressure",
}
_FOLLOWING = (_DYN.mjDYN_NONE, _DYN.mjDYN_FILTER, _DYN.mjDYN_FILTEREXACT)


def driven(spec: mujoco.MjSpec, actuator: Any) -> tuple[Any | None, str | None] | None:
    """The joint and the name of the body that an actuator drives, each None where it has none.

    None where what it names does not exist.
    """
    kind, name = actuator.trntype, actuator.target
    joints = kind in (_TRN.mjTRN_JOINT, _TRN.mjTRN_JOINTINPARENT, _TRN.mjTRN_SO3)
    if joints and (joint := spec.joint(name)) is not None:
        return joint, joint.parent.name
    if kind == _TRN.mjTRN_TENDON and spec.tendon(name) is not None:
        return None, None
    if kind == _TRN.mjTRN_BODY and spec.body(name) is not None:
        return None, name
    sites = kind in (_TRN.mjTRN_SITE, _TRN.mjTRN_SLIDERCRANK, _TRN.mjTRN_SO3)
    if sites and (site := spec.site(name)) is not None:
        return None, site.parent.name
    return None


def along(spec: mujoco.MjSpec, actuator: Any) -> Along | None:
    """What an actuator's length is; None where its gear scales it, or where it mixes angles and lengths."""
    gear = [float(value) for value in actuator.gear]
    kind = actuator.trntype
    if kind == _TRN.mjTRN_SO3:
        return "angle"
    if kind == _TRN.mjTRN_SITE:
        return _wrench(gear)
    if kind in (_TRN.mjTRN_JOINT, _TRN.mjTRN_JOINTINPARENT):
        joint = spec.joint(actuator.target)
        if joint is None or joint.type == _JOINT.mjJNT_FREE:
            return _wrench(gear)
        if joint.type == _JOINT.mjJNT_BALL:
            return "angle" if _is_unit(gear[:3]) else None
        return of_joint(joint) if _is_unit(gear[:1]) else None
    if kind == _TRN.mjTRN_BODY:
        return "length"
    if not _is_unit(gear[:1]):
        return None
    return of_tendon(spec.tendon(actuator.target)) if kind == _TRN.mjTRN_TENDON else "length"


def of_joint(joint: Any) -> Along:
    """What a hinge, slide or ball turns or moves by."""
    return "length" if joint.type == _JOINT.mjJNT_SLIDE else "angle"


def of_tendon(tendon: Any) -> Along | None:
    """What a tendon's length is; None where it mixes angles and lengths, or scales them."""
    parts = list(tendon.path) if tendon is not None else []
    if not parts or parts[0].type != mujoco.mjtWrap.mjWRAP_JOINT:
        return "length"
    kinds = {of_joint(part.target) for part in parts if part.target is not None}
    plain = all(abs(float(part.coef)) == 1 for part in parts)
    return kinds.pop() if plain and len(kinds) == 1 else None


def quantity(actuator: Any) -> str:
    """What the control input of a simple actuator sets: a `force`, `position`, `velocity` or `pressure`; else empty.

    A `general` actuator counts as what it is a longer word for, such as a servo with a gain and its negative as bias.
    """
    if actuator.type != _ACTUATOR.mjACTUATOR_GENERAL:
        return _KINDS.get(actuator.type, "")
    if actuator.plugin.active or actuator.gaintype != mujoco.mjtGain.mjGAIN_FIXED:
        return ""
    gain, (offset, stiffness, damping) = float(actuator.gainprm[0]), (float(value) for value in actuator.biasprm[:3])
    follows = actuator.dyntype in _FOLLOWING
    if actuator.biastype == mujoco.mjtBias.mjBIAS_NONE:
        return "force" if gain == 1 and follows else ""
    if actuator.biastype != mujoco.mjtBias.mjBIAS_AFFINE or offset != 0 or gain == 0:
        return ""
    if stiffness == -gain:
        return "position" if follows else "velocity" if actuator.dyntype == _DYN.mjDYN_INTEGRATOR else ""
    return "velocity" if stiffness == 0 and damping == -gain and follows else ""


def _wrench(gear: list[float]) -> Along | None:
    """What a gear of a force and a torque acts along."""
    if _is_unit(gear[:3]) and not any(gear[3:]):
        return "length"
    return "angle" if _is_unit(gear[3:]) and not any(gear[:3]) else None


def _is_unit(values: list[float]) -> bool:
    return math.isclose(math.hypot(*values), 1.0)
