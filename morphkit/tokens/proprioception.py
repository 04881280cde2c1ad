"""Tokens of what no limb's sensor gives: what a real robot knows of itself, what it was told, and what it did last."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace

from morphkit.errors import ConfigError, UnknownNameError
from morphkit.naming.unique import unique
from morphkit.tokens.quantities import quantity_names
from morphkit.tokens.records import SensorToken
from morphkit.tokens.selection import NO_LTV, take_quantities
from morphkit.tokens.spec import TokenSpec
from morphkit.utils.suggest import did_you_mean

_ROOT = {
    "gravity": (("x", "y", "z"), "1"),
    "body_rotational_velocity": (("x", "y", "z"), "rad/s"),
    "command": (("x", "y", "yaw"), "m/s"),
    "target": (("x", "y", "z"), "m"),
}
"""Components and unit of what belongs to the root limb: the direction of gravity and the rotational velocity in its own
frame, the velocity that it is told (forward, left; turning left, rad/s), and the way from the tip to its target."""
_ORDER = ("gravity", "body_rotational_velocity", "joint_velocity", "previous_action", "command", "target")


_PROPRIOCEPTIVE = (*_ORDER[:2], "angle", *_ORDER[2:])

ALL, PROPRIOCEPTIVE, DECLARED = "all", "proprioceptive", "declared"
"""Sets of quantities: of limbs and joints; what a real robot knows of itself without cameras or a tracking system; what
the file's own sensors read."""


def task_quantities() -> tuple[str, ...]:
    """The quantities, in the order of their tokens."""
    return _ORDER


def observed(spec: TokenSpec, names: Sequence[str], own: Sequence[str]) -> TokenSpec:
    """The tokens of an observation.

    Args:
        spec: The tokens of a robot's limbs and joints, and of its declared sensors where `needs_declared` says so.
        names: Quantities, or sets of them; none for `all`.
        own: Those of the `task_quantities` that the task has; they are observed whatever the names are.

    Raises:
        UnknownNameError: There is no such quantity or set.
        ConfigError: No sensor token is left, or none is declared.
    """
    if not names or tuple(names) == (ALL,):
        return with_quantities(spec, own)
    declared = tuple(dict.fromkeys(s.quantity for s in spec.sensors if s.quantity not in quantity_names()))
    if DECLARED in names and not declared:
        raise ConfigError(f"{spec.morphology}: the file declares no sensors with readings; leave out 'declared'")
    sets = {ALL: quantity_names(), PROPRIOCEPTIVE: _PROPRIOCEPTIVE, DECLARED: declared}
    for name in names:
        known = (*sets, *quantity_names(), *declared, *_ORDER, NO_LTV)
        if name not in known:
            raise UnknownNameError(
                f"{spec.morphology}: there is no quantity {name!r}{did_you_mean(name, known)}\n"
                f"  quantities: {', '.join(known)}"
            )
    wanted = [quantity for name in names for quantity in sets.get(name, (name,))]
    needless = {"command", "target"} - set(own)  # the task has none
    chosen = [name for name in dict.fromkeys((*wanted, *own)) if name not in needless]
    return take_quantities(with_quantities(spec, chosen), chosen)


def needs_declared(names: Sequence[str]) -> bool:
    """Whether some of these quantities and sets can only be those of declared sensors."""
    return any(name not in (*quantity_names(), *_ORDER, ALL, PROPRIOCEPTIVE, NO_LTV) for name in names)


def with_quantities(spec: TokenSpec, names: Collection[str]) -> TokenSpec:
    """Append the tokens of some of the `task_quantities`; names follow those of the limb's own tokens."""
    added = [token for name in _ORDER if name in names for token in _tokens(spec, name)]
    taken = [*(token.name for token in spec.sensors), *(token.name for token in spec.actuators)]
    called = unique((token.name for token in added), taken=taken)
    spaced = not any("_" in text for text in spec.texts)
    first = len(spec.sensors)
    numbered = [
        replace(token, index=first + i, name=name, text=name.replace("_", " ") if spaced else name)
        for i, (token, name) in enumerate(zip(added, called, strict=True))
    ]
    return replace(spec, sensors=(*spec.sensors, *numbered))


def _tokens(spec: TokenSpec, quantity: str) -> Iterator[SensorToken]:
    token = SensorToken(0, "", "", spec.limbs[0].name, quantity, None, "1", None, None, None)
    if quantity == "joint_velocity":
        for angle in (each for each in spec.sensors if each.quantity == "angle" and each.limb != spec.limbs[0].name):
            name = f"{angle.name.removesuffix('_angle')}_joint_velocity"
            unit = "m/s" if angle.unit == "m" else "rad/s"
            yield replace(token, name=name, limb=angle.limb, unit=unit)
    elif quantity == "previous_action":
        for actuator in spec.actuators:
            name = f"{actuator.name.removesuffix('_ctrl')}_previous_action"
            yield replace(token, name=name, limb=actuator.limb)
    else:
        components, unit = _ROOT[quantity]
        label = _label(spec)
        for each in components:
            turning = "rad/s" if each == "yaw" else unit
            frame = "world" if quantity == "target" else spec.limbs[0].name
            yield replace(token, name=f"{label}_{quantity}_{each}", component=each, unit=turning, frame=frame)


def _label(spec: TokenSpec) -> str:
    """What tokens call the root limb."""
    root = spec.limbs[0].name
    for sensor in spec.sensors:
        ending = "_".join(part for part in (sensor.quantity, sensor.component) if part)
        if sensor.limb == root and sensor.name.endswith(f"_{ending}"):
            return sensor.name.removesuffix(f"_{ending}")
    return root
