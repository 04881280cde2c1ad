"""The sensors that a URDF declares: those of URDF itself and those in Gazebo's blocks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from lxml import etree

from morphkit.morphology import Origin, Reading, Sensor
from morphkit.naming.unique import give_names

_PLACING = ("parent", "origin")
_AXES = ("x", "y", "z")


def read_sensors(
    tree: etree._ElementTree, limb_of: Mapping[str, str], *, file: str
) -> tuple[tuple[Sensor, ...], tuple[Origin, ...]]:
    """Return the declared sensors in file order, without those of other trees of links, and where they come from.

    Inertial units, force-torque, contact and altitude sensors have readings; cameras and lidars give no scalars.

    Args:
        tree: The parsed URDF.
        limb_of: Link name -> limb name, for the links of the robot.
        file: What the file is called in places.
    """
    root = tree.getroot()
    links = {link.get("name") for link in root.iterchildren("link")}
    child_of = {
        joint.get("name") or "": child.get("link") or ""
        for joint in root.iterchildren("joint")
        if (child := joint.find("child")) is not None
    }
    found = []
    for element, reference in _elements(root):
        link = reference if reference in links else child_of.get(reference, reference)
        if link in links and link not in limb_of:
            continue
        kind = element.get("type") or next(
            (child.tag for child in element if isinstance(child.tag, str) and child.tag not in _PLACING), ""
        )
        found.append((element, kind, link))
    originals = [element.get("name") or None for element, _, _ in found]
    names = give_names(originals, ["sensor"] * len(found))
    sensors, origins = [], []
    for name, original, (element, kind, link) in zip(names, originals, found, strict=True):
        sensors.append(Sensor(name, kind, limb_of.get(link), tuple(_readings(kind, link or None))))
        origins.append(Origin(name, "sensor", original, f"{file}:{element.sourceline}"))
    return tuple(sensors), tuple(origins)


def _elements(root: etree._Element) -> Iterator[tuple[etree._Element, str]]:
    """Yield each sensor element and the link or joint that it is attached to."""
    for element in root.iterchildren("sensor"):
        parent = element.find("parent")
        yield element, (parent.get("link") or "") if parent is not None else ""
    for block in root.iterchildren("gazebo"):
        for element in block.iterchildren("sensor"):
            yield element, block.get("reference") or ""


def _readings(kind: str, link: str | None) -> Iterator[Reading]:
    if kind == "imu":
        yield from (Reading("orientation", axis, "1", "world") for axis in ("w", *_AXES))
        yield from (Reading("angular_velocity", axis, "rad/s", link) for axis in _AXES)
        yield from (Reading("linear_acceleration", axis, "m/s^2", link) for axis in _AXES)
    elif kind in ("force_torque", "ft"):
        yield from (Reading("force", axis, "N", link) for axis in _AXES)
        yield from (Reading("torque", axis, "N*m", link) for axis in _AXES)
    elif kind in ("contact", "bumper"):
        yield Reading("contact", None, "1", None, 0.0, 1.0)
    elif kind == "altimeter":
        yield Reading("altitude", None, "m", "world")
