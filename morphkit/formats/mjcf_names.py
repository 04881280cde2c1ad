"""Names for the elements of an MJCF model that have none, the same in every copy and variant of the model."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import mujoco

from morphkit.formats.mjcf_locations import Places
from morphkit.morphology import Origin
from morphkit.naming.unique import TakenNames, give_names

Row = tuple[str | None, int | None, str | None]
"""Of a body: its name, the index of its parent among the rows, and the name of its first joint that has one."""

_WORLD = "world"


def body_names(rows: Sequence[Row]) -> list[str]:
    """Names of the bodies in `rows`, parents before children: their own, else the given ones.

    A body without a name is called `<joint>_body` after its first joint that has one, else `<parent>_body`; a number is
    added where that is taken. So the name does not depend on what hangs elsewhere in the robot.
    """
    names = TakenNames(name for name, _, _ in rows if name)
    found: list[str] = []
    for name, parent, joint in rows:
        above = _WORLD if parent is None else found[parent]
        found.append(name or names.give(f"{joint or above}_body"))
    return found


def name_elements(spec: mujoco.MjSpec) -> None:
    """Give every body, joint, actuator and sensor of `spec` that has no name its deterministic one, in place.

    Bodies: see `body_names`. A joint is called `<body>_joint`, an actuator after what it drives, a sensor after its
    kind and what it is attached to; a number is added where the name is taken.
    """
    bodies = list(_bodies(spec))
    if not all(body.name for body, _ in bodies):
        for (body, _), name in zip(bodies, body_names(list(_rows(bodies))), strict=True):
            if not body.name:
                body.name = name
    _fill(_joints(spec), lambda joint: f"{joint.parent.name}_joint")
    _fill(spec.actuators, lambda actuator: actuator.target or "actuator")
    _fill(spec.sensors, lambda sensor: "_".join(part for part in (sensor_kind(sensor), sensor.objname) if part))


def name_with_origins(spec: mujoco.MjSpec, places: Places) -> tuple[Origin, ...]:
    """Do what `name_elements` does, and say where each body, joint, actuator and sensor comes from."""
    kinds = {"body": spec.bodies[1:], "joint": _joints(spec), "actuator": spec.actuators, "sensor": spec.sensors}
    found = {kind: [places.find(element, kind) for element in elements] for kind, elements in kinds.items()}
    name_elements(spec)
    return tuple(
        Origin(element.name, kind, *place, id=number)
        for kind, elements in kinds.items()
        for number, (element, place) in enumerate(zip(elements, found[kind], strict=True), start=kind == "body")
    )


def sensor_kind(sensor: Any) -> str:
    """Kind of an `MjSpec` sensor as MJCF writes it, such as `framepos`."""
    return str(sensor.type.name).removeprefix("mjSENS_").lower()


def _bodies(spec: mujoco.MjSpec) -> Iterator[tuple[Any, int | None]]:
    """Yield every body and the number of its parent among them, depth first in file order, as MuJoCo numbers them."""
    pending: list[tuple[Any, int | None]] = [(body, None) for body in reversed(spec.worldbody.bodies)]
    count = 0
    while pending:
        body, parent = pending.pop()
        yield body, parent
        pending += [(child, count) for child in reversed(body.bodies)]
        count += 1


def _joints(spec: mujoco.MjSpec) -> list[Any]:
    """All joints in MuJoCo's order; `spec.joints` takes time with the square of their number."""
    return [joint for body in spec.bodies for joint in body.joints]


def _rows(bodies: Iterable[tuple[Any, int | None]]) -> Iterator[Row]:
    for body, parent in bodies:
        yield body.name or None, parent, next((joint.name for joint in body.joints if joint.name), None)


def _fill(elements: Sequence[Any], call: Callable[[Any], str]) -> None:
    originals = [element.name or None for element in elements]
    if None in originals:
        for element, name in zip(elements, give_names(originals, [call(each) for each in elements]), strict=True):
            if not element.name:
                element.name = name
