"""The control inputs of an MJCF model: what each drives, its range and its unit."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import mujoco

from morphkit.errors import DescriptionError
from morphkit.morphology import Actuator
from morphkit.readers.mjcf_transmissions import UNITS, along, driven, quantity
from morphkit.utils.suggest import did_you_mean

Where = Callable[[str, str], str]
_TRN = mujoco.mjtTrn
_INPUT = mujoco.mjtCtrlInput
_INPUTS = {
    int(_INPUT.mjINPUT_POS): "position",
    int(_INPUT.mjINPUT_VEL): "velocity",
    int(_INPUT.mjINPUT_FF): "force",
    int(_INPUT.mjINPUT_VOLTAGE): "voltage",
}
_DEFAULT_INPUTS = {
    mujoco.mjtGain.mjGAIN_PID: int(_INPUT.mjINPUT_POS) | int(_INPUT.mjINPUT_VEL),
    mujoco.mjtGain.mjGAIN_DCMOTOR: int(_INPUT.mjINPUT_VOLTAGE),
}


def read_actuators(
    spec: mujoco.MjSpec, limb_of: Mapping[str, str], where: Where
) -> tuple[tuple[Actuator, ...], tuple[str, ...]]:
    """Return the control inputs of a parsed model, in file order, and the name of the actuator that each is of.

    An actuator with several inputs, such as `pid`, counts once an input. Actuators that drive only what lies outside
    the robot (another top-level body) are left out.

    Args:
        spec: The parsed model; its bodies, joints and actuators are all named.
        limb_of: Body name -> limb name, for the bodies of the robot.
        where: Kind and name of an element -> `file:line`, for messages.

    Raises:
        DescriptionError: An actuator drives a joint, site, body or tendon that does not exist.
    """
    found: list[Actuator] = []
    elements: list[str] = []
    for actuator in spec.actuators:
        joint, body = _target(spec, actuator, where)
        if body is not None and body not in limb_of:
            continue
        limb = limb_of[body] if body is not None else None
        units = UNITS[along(spec, actuator)]
        for suffix, measured, (low, high) in _inputs(spec, actuator, joint):
            elements.append(actuator.name)
            found.append(
                Actuator(
                    name=actuator.name + suffix,
                    limb=limb,
                    joint=joint.name if joint is not None else None,
                    low=low,
                    high=high,
                    unit="V" if measured == "voltage" else units.get(measured, "1"),
                )
            )
    return tuple(found), tuple(elements)


def _target(spec: mujoco.MjSpec, actuator: Any, where: Where) -> tuple[Any | None, str | None]:
    """Return the joint and the body name that an actuator drives; None for what it does not have."""
    found = driven(spec, actuator)
    if found is not None:
        return found
    kind, name = actuator.trntype, actuator.target
    what, known = {
        _TRN.mjTRN_TENDON: ("tendon", spec.tendons),
        _TRN.mjTRN_BODY: ("body", spec.bodies),
        _TRN.mjTRN_SITE: ("site", spec.sites),
        _TRN.mjTRN_SLIDERCRANK: ("site", spec.sites),
    }.get(kind, ("joint", spec.joints))
    hint = did_you_mean(name, [element.name for element in known])
    raise DescriptionError(
        f"{where('actuator', actuator.name)}: actuator {actuator.name!r} drives {what} {name!r}, which does not"
        f" exist{hint}"
    )


def _inputs(spec: mujoco.MjSpec, actuator: Any, joint: Any | None) -> Iterator[tuple[str, str, tuple[float, float]]]:
    """Yield name suffix, quantity and range of each control input of an actuator."""
    bounds = _bounds(spec, actuator, joint)
    if actuator.gaintype == mujoco.mjtGain.mjGAIN_SO3:
        quaternion = actuator.ctrlspec == int(mujoco.mjtCtrlChart.mjCHART_QUAT)
        for axis in "wxyz" if quaternion else "xyz":
            yield f"_{axis}", "" if quaternion else "position", bounds
    elif actuator.gaintype in _DEFAULT_INPUTS:
        bits = int(actuator.ctrlspec) or _DEFAULT_INPUTS[actuator.gaintype]
        names = [name for bit, name in _INPUTS.items() if bit & bits]
        for name in names:
            own = {"velocity": actuator.velrange, "force": actuator.ffrange}.get(name)
            yield f"_{name}" if len(names) > 1 else "", name, bounds if own is None else _interval(own)
    else:
        yield "", quantity(actuator), bounds


def _bounds(spec: mujoco.MjSpec, actuator: Any, joint: Any | None) -> tuple[float, float]:
    """Range of an actuator's first control input; `inheritrange` takes that of the joint or tendon."""
    inherited = _inherited(spec, actuator, joint)
    if inherited is not None:
        low, high = inherited
        middle, half = (low + high) / 2, (high - low) / 2 * float(actuator.inheritrange)
        return _interval((middle - half, middle + half))
    low, high = (float(value) for value in actuator.ctrlrange)
    if is_limited(spec, actuator.ctrllimited, low, high):
        return low, high
    muscle = actuator.dyntype == mujoco.mjtDyn.mjDYN_MUSCLE  # which clips its excitation itself (mju_muscleDynamics)
    return (0.0, 1.0) if muscle else (-math.inf, math.inf)


def _inherited(spec: mujoco.MjSpec, actuator: Any, joint: Any | None) -> tuple[float, float] | None:
    """The range that a position-like actuator inherits; as in MuJoCo, another kind (or its filter) ignores the wish."""
    servo = (
        actuator.gaintype == mujoco.mjtGain.mjGAIN_FIXED
        and actuator.biastype == mujoco.mjtBias.mjBIAS_AFFINE
        and actuator.gainprm[0] == -actuator.biasprm[1]
    )
    if not servo or actuator.inheritrange <= 0 or actuator.dyntype == mujoco.mjtDyn.mjDYN_INTEGRATOR:
        return None
    if joint is not None:
        return joint_range(joint)
    tendon = spec.tendon(actuator.target) if actuator.trntype == _TRN.mjTRN_TENDON else None
    return (float(tendon.range[0]), float(tendon.range[1])) if tendon is not None else None


def _interval(limits: Sequence[float]) -> tuple[float, float]:
    low, high = float(limits[0]), float(limits[1])
    return (low, high) if low < high else (-math.inf, math.inf)


def joint_range(joint: Any) -> tuple[float, float]:
    """Range of an MjSpec joint in rad or m, whatever its file's unit."""
    low, high = (float(value) for value in joint.range)
    if joint.compiler.degree and joint.type in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_BALL):
        return math.radians(low), math.radians(high)
    if joint.type == mujoco.mjtJoint.mjJNT_SLIDE:
        factor = _scale(joint)
        return low * factor, high * factor
    return low, high


def _scale(joint: Any) -> float:
    """By how much the frames around a slide joint lengthen its way; MuJoCo does so when it compiles.

    Where they stretch axes differently, the joint has to lie along one of them, and is taken to be written in them.
    """
    factor, axis = 1.0, [float(value) for value in joint.axis]
    body, frame = joint.parent, joint.frame
    while body is not None:
        while frame is not None:
            stretched = math.hypot(*(float(scale) * value for scale, value in zip(frame.scale, axis, strict=True)))
            factor *= stretched / (math.hypot(*axis) or 1.0)
            frame = frame.frame
        frame, body = body.frame, body.parent
    return factor


def is_limited(spec: mujoco.MjSpec, flag: Any, low: float, high: float) -> bool:
    """Whether a range counts, given its `limited` attribute; MuJoCo's rule, `autolimits` included."""
    if flag == mujoco.mjtLimited.mjLIMITED_AUTO:
        return bool(spec.compiler.autolimits) and low < high
    return bool(flag == mujoco.mjtLimited.mjLIMITED_TRUE)
