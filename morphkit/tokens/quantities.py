"""What every limb senses: one table, from which tokens get their names and simulations their sensors.

A quantity that is added to `LIMB_QUANTITIES` gets tokens, a MuJoCo sensor and a place in observations.
"""

from __future__ import annotations

from dataclasses import dataclass

VELOCITY_LIMIT = 10.0
"""What translational velocities are clipped to, m/s."""


@dataclass(frozen=True)
class LimbQuantity:
    """A quantity that every limb has.

    Attributes:
        name: What tokens call it.
        components: A letter or digit for each scalar.
        unit: Unit of the scalars.
        frame: Frame that they are seen from; None without one.
        limit: What they are clipped to, plus and minus; None where they are not.
        sensor: The MuJoCo sensor of the limb's body frame that they are read from, such as `framepos`; None for what
            does not change with the state.
        width: How many numbers the sensor gives.
        rotation: Whether the sensor gives a quaternion, of which the scalars are the exponential map; else they are
            its numbers, one by one.
    """

    name: str
    components: str
    unit: str
    frame: str | None = None
    limit: float | None = None
    sensor: str | None = None
    width: int = 0
    rotation: bool = False


LIMB_QUANTITIES: tuple[LimbQuantity, ...] = (
    LimbQuantity("position", "xyz", "m", "world", sensor="framepos", width=3),
    LimbQuantity("translational_velocity", "xyz", "m/s", "world", VELOCITY_LIMIT, sensor="framelinvel", width=3),
    LimbQuantity("rotational_velocity", "xyz", "rad/s", "world", sensor="frameangvel", width=3),
    LimbQuantity("exponential_map", "xyz", "rad", "world", sensor="framequat", width=4, rotation=True),
    LimbQuantity("type", "0123", "1"),
)
"""In the order of a limb's tokens and of its sensors. Positions count x from the root limb's x."""

JOINT_QUANTITIES = ("angle", "joint_range_low", "joint_range_high")
"""What each joint of a limb has, after the limb's own quantities; their unit depends on the joint."""


def quantity_names() -> tuple[str, ...]:
    """What sensor tokens of limbs measure, in their order within a limb."""
    return (*(quantity.name for quantity in LIMB_QUANTITIES), *JOINT_QUANTITIES)


def sensed_quantities() -> tuple[LimbQuantity, ...]:
    """The quantities that a sensor is read for, in the order of the sensors."""
    return tuple(quantity for quantity in LIMB_QUANTITIES if quantity.sensor is not None)


def numbers_per_limb() -> int:
    """How many numbers the sensors of a limb give."""
    return sum(quantity.width for quantity in sensed_quantities())


def quantity_columns(name: str) -> slice:
    """Which of a limb's sensor numbers belong to a quantity; KeyError where no sensor is read for it."""
    start = 0
    for quantity in sensed_quantities():
        if quantity.name == name:
            return slice(start, start + quantity.width)
        start += quantity.width
    raise KeyError(name)
