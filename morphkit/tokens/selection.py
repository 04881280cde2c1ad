"""Observations of less than everything: some quantities out of a robot's tokens."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from morphkit.errors import ConfigError, UnknownNameError
from morphkit.tokens.quantities import quantity_names
from morphkit.tokens.spec import TokenSpec
from morphkit.utils.suggest import did_you_mean

NO_LTV = "no_ltv"
"""Stands for every quantity but `type`, the limb-type vector."""


def take_quantities(spec: TokenSpec, names: Sequence[str]) -> TokenSpec:
    """Leave out the sensor tokens of other quantities than those named.

    Args:
        spec: The tokens of a robot.
        names: Quantities, such as `position`, or `no_ltv` for all of them but `type`; nothing is left out where there
            are no names.

    Returns:
        The tokens that are left, in their order and with their names and texts, `index` counted anew.

    Raises:
        UnknownNameError: There is no such quantity; the message offers the nearest.
        ConfigError: No sensor token is left.
    """
    if not names:
        return spec
    present = {sensor.quantity for sensor in spec.sensors}
    known = (*quantity_names(), *sorted(present - set(quantity_names())), NO_LTV)
    for name in names:
        if name not in known:
            raise UnknownNameError(
                f"{spec.morphology}: there is no quantity {name!r}{did_you_mean(name, known)}\n"
                f"  quantities: {', '.join(known)}"
            )
    wanted = set(names) | (present - {"type"} if NO_LTV in names else set())
    sensors = [sensor for sensor in spec.sensors if sensor.quantity in wanted]
    if not sensors:
        raise ConfigError(f"{spec.morphology}: no token measures {', '.join(names)}")
    return replace(spec, sensors=tuple(replace(sensor, index=i) for i, sensor in enumerate(sensors)))
