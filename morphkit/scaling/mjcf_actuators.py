"""Scale the forces of an MJCF's actuators."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import mujoco
import numpy as np

from morphkit.ablation.limb_scale import SAME
from morphkit.errors import AblationError
from morphkit.scaling.attributes import multiply_values
from morphkit.scaling.mjcf_limbs import Limbs
from morphkit.scaling.mjcf_tendons import tendon_gain

_SERVOS = ("position", "velocity", "intvelocity", "orientation")
_TARGETS = {"joint": "joint", "jointinparent": "joint", "site": "site", "cranksite": "site", "body": "body"}
_GAINS = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtGain.mjGAIN_AFFINE
_BIASES = mujoco.mjtBias.mjBIAS_NONE, mujoco.mjtBias.mjBIAS_AFFINE
_MUSCLE_FORCES = slice(2, 4)

_FORCES: dict[str, Callable[[Any], dict[str, Any]]] = {
    "position": lambda parsed: {"kp": parsed.gainprm[0], "kv": max(-parsed.biasprm[2], 0.0)},
    "velocity": lambda parsed: {"kv": parsed.gainprm[0]},
    "intvelocity": lambda parsed: {"kp": parsed.gainprm[0], "kv": max(-parsed.biasprm[2], 0.0)},
    "damper": lambda parsed: {"kv": -parsed.gainprm[2]},
    "adhesion": lambda parsed: {"gain": parsed.gainprm[0]},
    "cylinder": lambda parsed: {"area": parsed.gainprm[0], "bias": parsed.biasprm[:3]},
    "muscle": lambda parsed: {"force": max(parsed.gainprm[2], 0.0), "scale": parsed.gainprm[3]},
}
"""Kind of actuator -> the attributes that its force is proportional to, read from what MuJoCo makes of it."""


def scale_actuators(limbs: Limbs, tendons: Mapping[str, float]) -> list[float]:
    """Scale all actuators, so that each gives `gain` times the force; return the factors of their controls.

    Args:
        limbs: The bodies.
        tendons: Factor of the length of each tendon, by name.

    Raises:
        AblationError: The gains of an actuator cannot be scaled.
    """
    pairs = zip(limbs.root.iterfind("actuator/*"), limbs.parsed.actuators, strict=True)
    return [_scale_actuator(limbs, drive, parsed, tendons) for drive, parsed in pairs]


def _scale_actuator(limbs: Limbs, drive: Any, parsed: Any, tendons: Mapping[str, float]) -> float:
    gain, travel = _gain_of(limbs, drive), _travel_of(limbs, drive, tendons)
    multiply_values(drive, "lengthrange", travel, parsed.lengthrange)
    servo = drive.tag in _SERVOS or (drive.tag == "general" and bool(parsed.biasprm[1:3].any()))
    control = travel if servo else 1.0
    if servo:
        multiply_values(drive, "actrange", travel, parsed.actrange)
    if gain != 1 and drive.tag == "motor" and _takes_force(parsed):
        control = gain
    elif gain != 1 and drive.tag == "motor":
        multiply_values(drive, "gear", gain, np.trim_zeros(parsed.gear, "b"))
        gain = 1.0
    elif gain != 1:
        _scale_force(drive, parsed, gain)
    multiply_values(drive, "ctrlrange", control, parsed.ctrlrange)
    multiply_values(drive, "forcerange", gain, parsed.forcerange)
    return control


def _takes_force(motor: Any) -> bool:
    """Whether the control of a motor is the force itself, within bounds."""
    return bool(motor.gear[0] == 1 and not motor.gear[1:].any() and motor.ctrlrange.any())


def _scale_force(drive: Any, parsed: Any, gain: float) -> None:
    if drive.tag == "general":
        _scale_general(drive, parsed, gain)
        return
    if drive.tag not in _FORCES:
        raise _refusal(drive, f"a <{drive.tag}>")
    drive.attrib.pop("diameter", None)  # the area says the same
    for attribute, value in _FORCES[drive.tag](parsed).items():
        multiply_values(drive, attribute, gain, value)


def _scale_general(drive: Any, parsed: Any, gain: float) -> None:
    kinds = (
        ("gainprm", parsed.gainprm, parsed.gaintype, _GAINS, mujoco.mjtGain.mjGAIN_MUSCLE),
        ("biasprm", parsed.biasprm, parsed.biastype, _BIASES, mujoco.mjtBias.mjBIAS_MUSCLE),
    )
    for attribute, values, kind, linear, muscle in kinds:
        if kind not in (*linear, muscle):
            raise _refusal(drive, f"a <general> with such a {attribute}")
        factors = np.full(len(values), gain)
        if kind == muscle:
            factors[:] = 1.0
            factors[_MUSCLE_FORCES] = gain
        shown = len(np.trim_zeros(values, "b"))
        multiply_values(drive, attribute, factors[:shown], values[:shown])


def _refusal(drive: Any, what: str) -> AblationError:
    name = f" {drive.get('name')!r}" if drive.get("name") else ""
    return AblationError(
        f"line {drive.sourceline}: actuator{name}: the gains of {what} cannot be scaled; leave the gain of its limb as"
        " it is"
    )


def _gain_of(limbs: Limbs, drive: Any) -> float:
    """Factor of an actuator's forces: that of the limb that it drives; of several the geometric mean."""
    if drive.get("tendon"):
        return tendon_gain(limbs, drive.get("tendon"))
    named = ((kind, drive.get(attribute)) for attribute, kind in _TARGETS.items() if drive.get(attribute))
    return limbs.named.get(next(named, ("", "")), SAME).gain


def _travel_of(limbs: Limbs, drive: Any, tendons: Mapping[str, float]) -> float:
    """Factor of an actuator's length."""
    if drive.get("tendon"):
        return tendons.get(drive.get("tendon"), 1.0)
    return limbs.travel.get(drive.get("joint") or drive.get("jointinparent") or "", 1.0)
