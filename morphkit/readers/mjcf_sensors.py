"""The sensors that an MJCF file declares: what each reads, with sizes, units, frames and bounds of MuJoCo's manual."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import islice
from typing import Any

import mujoco

from morphkit.formats.limits import READINGS
from morphkit.formats.mjcf_names import sensor_kind
from morphkit.morphology import Reading, Sensor
from morphkit.readers.mjcf_transmissions import along, driven, of_joint, of_tendon

_OBJ = mujoco.mjtObj
_SENSOR = mujoco.mjtSensor
_DATA = mujoco.mjtDataType
XYZ = ("x", "y", "z")
WXYZ = ("w", *XYZ)

# components, unit, frame: `world`, `own` (the object's), `reference` (the world without a reference object) or none
_FIXED: dict[str, tuple[tuple[str | None, ...], str, str | None]] = {
    "touch": ((None,), "N", None),
    "accelerometer": (XYZ, "m/s^2", "own"),
    "velocimeter": (XYZ, "m/s", "own"),
    "gyro": (XYZ, "rad/s", "own"),
    "force": (XYZ, "N", "own"),
    "torque": (XYZ, "N*m", "own"),
    "magnetometer": (XYZ, "1", "own"),
    "camprojection": (("x", "y"), "pixel", "reference"),
    "ballquat": (WXYZ, "1", None),
    "ballangvel": (XYZ, "rad/s", "own"),
    "framepos": (XYZ, "m", "reference"),
    "framequat": (WXYZ, "1", "reference"),
    "framexaxis": (XYZ, "1", "reference"),
    "frameyaxis": (XYZ, "1", "reference"),
    "framezaxis": (XYZ, "1", "reference"),
    "framelinvel": (XYZ, "m/s", "reference"),
    "frameangvel": (XYZ, "rad/s", "reference"),
    "framelinacc": (XYZ, "m/s^2", "world"),
    "frameangacc": (XYZ, "rad/s^2", "world"),
    "subtreecom": (XYZ, "m", "world"),
    "subtreelinvel": (XYZ, "m/s", "world"),
    "subtreeangmom": (XYZ, "kg*m^2/s", "world"),
    "insidesite": ((None,), "1", None),
    "geomdist": ((None,), "m", None),
    "geomnormal": (XYZ, "1", "world"),
    "geomfromto": (tuple(f"{end}_{axis}" for end in ("from", "to") for axis in XYZ), "m", "world"),
    "e_potential": ((None,), "J", None),
    "e_kinetic": ((None,), "J", None),
    "clock": ((None,), "s", None),
}
_ALONG = {"pos": ("rad", "m"), "vel": ("rad/s", "m/s"), "frc": ("N*m", "N")}
_CONTACT = (
    ("found", (None,), "1"),
    ("force", XYZ, "N"),
    ("torque", XYZ, "N*m"),
    ("dist", (None,), "m"),
    ("pos", XYZ, "m"),
    ("normal", XYZ, "1"),
    ("tangent", XYZ, "1"),
    ("linvel", XYZ, "m/s"),
    ("angvel", XYZ, "rad/s"),
)  # in the order of mjtConDataField
_RAY = (
    ("dist", (None,), "m"),
    ("dir", XYZ, "1"),
    ("origin", XYZ, "m"),
    ("point", XYZ, "m"),
    ("normal", XYZ, "1"),
    ("depth", (None,), "m"),
)  # in the order of mjtRayDataField
_NET_FORCE = 3  # `reduce="netforce"`: force and torque of all contacts together, in the world's frame
_POSITIVE = ("touch", "insidesite")
_NEVER_CUT = ("contact", "geomfromto", "ballquat", "framequat", "framexaxis", "frameyaxis", "framezaxis", "geomnormal")


def read_sensors(spec: mujoco.MjSpec, limb_of: Mapping[str, str]) -> tuple[Sensor, ...]:
    """Return the declared sensors in file order, without those of other top-level bodies.

    A sensor whose number of readings only MuJoCo's compiler knows (`plugin`, `tactile`), or that has more than 10,000,
    has none here.

    Args:
        spec: The parsed model; its bodies, joints, actuators and sensors are all named.
        limb_of: Body name -> limb name, for the bodies of the robot.
    """
    found = []
    for sensor in spec.sensors:
        kind = sensor_kind(sensor)
        body = _body_of(spec, sensor.objtype, sensor.objname)
        if body is not None and body not in limb_of and body != "world":
            continue
        limb = limb_of.get(body) if body is not None else None
        readings = tuple(islice(_readings(spec, sensor, kind), READINGS + 1))
        found.append(Sensor(sensor.name, kind, limb, readings if len(readings) <= READINGS else ()))
    return tuple(found)


def _body_of(spec: mujoco.MjSpec, kind: Any, name: str) -> str | None:
    """Name of the body that a sensor's object belongs to; None where it belongs to none, such as a tendon."""
    if kind in (_OBJ.mjOBJ_BODY, _OBJ.mjOBJ_XBODY):
        return name
    if kind == _OBJ.mjOBJ_ACTUATOR:
        actuator = spec.actuator(name)
        found = driven(spec, actuator) if actuator is not None else None
        return found[1] if found is not None else None
    look_up = {
        _OBJ.mjOBJ_JOINT: spec.joint,
        _OBJ.mjOBJ_GEOM: spec.geom,
        _OBJ.mjOBJ_SITE: spec.site,
        _OBJ.mjOBJ_CAMERA: spec.camera,
    }.get(kind)
    element = look_up(name) if look_up is not None else None
    return element.parent.name if element is not None else None


def _readings(spec: mujoco.MjSpec, sensor: Any, kind: str) -> Iterator[Reading]:
    low, high = _bounds(kind, sensor)
    if kind in _FIXED:
        components, unit, where = _FIXED[kind]
        frames = {"own": sensor.objname, "reference": sensor.refname or "world", "world": "world"}
        for component in components:
            yield Reading(kind, component, unit, frames.get(where or ""), low, high)
    elif kind == "contact":
        bits, reduction, slots = (int(value) for value in sensor.intprm)
        for reading in _fields("contact", _CONTACT, bits, slots, low, high):
            local = reduction != _NET_FORCE and (reading.component or "").startswith(("force", "torque"))
            yield replace(reading, frame="contact") if local else reading
    elif kind == "rangefinder":
        rays = 1
        if sensor.objtype == _OBJ.mjOBJ_CAMERA and (camera := spec.camera(sensor.objname)) is not None:
            rays = int(camera.resolution[0]) * int(camera.resolution[1])
        yield from _fields("rangefinder", _RAY, int(sensor.intprm[0]) or 1, rays, low, high)
    elif kind == "user":
        for number in range(int(sensor.dim)):
            yield Reading(kind, str(number) if sensor.dim > 1 else None, "1", None, low, high)
    elif (along := _unit_along(spec, sensor, kind)) is not None:
        yield Reading(kind, None, along, None, low, high)


def _fields(
    kind: str,
    table: tuple[tuple[str, tuple[str | None, ...], str], ...],
    bits: int,
    slots: int,
    low: float | None,
    high: float | None,
) -> Iterator[Reading]:
    """The readings that `bits` chooses from `table`, once for each of `slots` contacts or rays."""
    chosen = [field for bit, field in enumerate(table) if bits >> bit & 1]
    for slot in range(slots):
        for field, components, unit in chosen:
            for axis in components:
                named = len(chosen) > 1 or kind == "contact"
                parts = [field if named else "", axis or "", str(slot) if slots > 1 else ""]
                component = "_".join(part for part in parts if part)
                yield Reading(kind, component or None, unit, "world" if axis else None, low, high)


def _unit_along(spec: mujoco.MjSpec, sensor: Any, kind: str) -> str | None:
    """Unit of what is sensed along a joint, tendon or actuator; None for another kind of sensor."""
    turning, sliding = _ALONG.get(kind[-3:], ("", ""))
    if not turning or not kind.startswith(("joint", "tendon", "actuator")):
        return None
    if kind.startswith("joint"):
        joint = spec.joint(sensor.objname)
        way = of_joint(joint) if joint is not None else None
    elif kind.startswith("tendon"):
        way = of_tendon(spec.tendon(sensor.objname))
    else:
        actuator = spec.actuator(sensor.objname)
        way = along(spec, actuator) if actuator is not None else None
    return "1" if way is None else turning if way == "angle" else sliding


def _bounds(kind: str, sensor: Any) -> tuple[float | None, float | None]:
    """What MuJoCo clips a reading to: a positive `cutoff` bounds it, also from below where it can be negative."""
    cutoff = float(sensor.cutoff)
    if kind in _POSITIVE or (kind == "user" and sensor.datatype == _DATA.mjDATATYPE_POSITIVE):
        return 0.0, cutoff if cutoff > 0 else None
    if cutoff <= 0 or kind in _NEVER_CUT:
        return None, None
    return -cutoff, cutoff
