"""Which of a robot's token values an observation takes, where its specification leaves some out."""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from morphkit.errors import ConfigError
from morphkit.tokens.spec import TokenSpec


def sensor_columns(spec: TokenSpec, full: TokenSpec) -> np.ndarray:
    """Where the sensors of `spec` are in the observation of everything that the robot senses.

    Names and texts do not matter: a token is known by its limb, quantity and component, and among the joints of a limb
    by its place.

    Args:
        spec: All or some of the sensor tokens of a robot, in their order, and all its actuators.
        full: What the simulation senses (`Simulation.tokens`).

    Returns:
        Indices into `full.sensors`, int64 (sensors,).

    Raises:
        ConfigError: `spec` is of another robot, or in another order, or takes some of a limb's joints only.
    """
    if [actuator.joint for actuator in spec.actuators] != [actuator.joint for actuator in full.actuators]:
        raise ConfigError(f"{full.morphology}: the tokens of {spec.morphology!r} have other actuators")
    columns = _places(full)
    places = _places(spec)
    found = np.zeros(len(spec.sensors), np.int64)
    for key, mine in places.items():
        if len(mine) != len(columns.get(key, ())):
            raise ConfigError(
                f"{full.morphology}: there are {len(columns.get(key, ()))} tokens like {spec.sensors[mine[0]].name!r}, "
                f"the specification of {spec.morphology!r} has {len(mine)}; it takes all or none of them"
            )
        found[mine] = columns[key]
    if (np.diff(found) < 0).any():
        raise ConfigError(f"{full.morphology}: the tokens of {spec.morphology!r} are in another order")
    return found


def _places(spec: TokenSpec) -> dict[tuple[str | None, str, str | None], list[int]]:
    """Indices of the sensors of each limb, quantity and component; several where the limb has several joints."""
    places = defaultdict(list)
    for i, sensor in enumerate(spec.sensors):
        places[sensor.limb, sensor.quantity, sensor.component].append(i)
    return places
