"""Checks of the numbers in an MJCF model: ranges, units, keyframes, inertias, and what MuJoCo says of them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from morphkit.formats.mjcf_defaults import Defaults
from morphkit.validation.common import read_numbers
from morphkit.validation.document import CheckedDocument, elements
from morphkit.validation.inertia import check_tensor, symmetric

_MANY = range(1, 1_000_000)
_COUNTS = {
    "pos": range(3, 4),
    "quat": range(4, 5),
    "axisangle": range(4, 5),
    "euler": range(3, 4),
    "xyaxes": range(6, 7),
    "zaxis": range(3, 4),
    "fromto": range(6, 7),
    "axis": range(3, 4),
    "diaginertia": range(3, 4),
    "fullinertia": range(6, 7),
    "range": range(1, 3),
    "ctrlrange": range(1, 3),
    "forcerange": range(1, 3),
    "actuatorfrcrange": range(1, 3),
    "mass": range(1, 2),
    "density": range(1, 2),
    "armature": range(1, 2),
    "frictionloss": range(1, 2),
    "stiffness": _MANY,
    "damping": _MANY,
    "gear": _MANY,
    "friction": _MANY,
}
_PLACED: tuple[str, ...] = (
    "body",
    "geom",
    "site",
    "joint",
    "camera",
    "light",
    "frame",
    "inertial",
    "general",
    "motor",
    "position",
)
_PLACED += (
    "velocity",
    "intvelocity",
    "damper",
    "cylinder",
    "muscle",
    "adhesion",
    "dcmotor",
    "spatial",
    "fixed",
    "pair",
)
_LIMITED_BY = {"range": "limited", "ctrlrange": "ctrllimited", "forcerange": "forcelimited"}
_LIMITED_BY["actuatorfrcrange"] = "actuatorfrclimited"
_TURNS = 6 * math.pi
_KEYS = ("qpos", "qvel", "act", "ctrl", "mpos", "mquat")


def check_numbers(doc: CheckedDocument) -> None:
    """Report numbers that are none, ranges that are inverted and joint axes without length."""
    defaults = Defaults(doc.root)
    for section in elements(doc.root, "worldbody", "default", "actuator", "tendon", "contact"):
        for element in section.iter(*_PLACED):
            owner = f"<{element.tag}>" + (f" {element.get('name')!r}" if element.get("name") else "")
            found = {key: read_numbers(doc, element, key, counts, owner=owner) for key, counts in _COUNTS.items()}
            name = element.get("name") or ""
            axis = found["axis"]
            if element.tag == "joint" and axis is not None and math.hypot(*axis) < 1e-9:
                doc.add("axis-zero", element, f"{owner} has the axis {element.get('axis')}", name=name)
            for key, switch in _LIMITED_BY.items():
                ends = found[key]
                off = element.tag != "default" and defaults.get(element, switch, "auto") == "false"
                if ends is not None and len(ends) == 2 and ends[0] > ends[1] and not off:
                    doc.add("range-inverted", element, f"{owner} has {key} {ends[0]:g} .. {ends[1]:g}", name=name)


def check_inertials(doc: CheckedDocument) -> dict[Any, tuple[float, Any, Any]]:
    """Report impossible masses and inertias.

    Returns:
        `<inertial>` element -> mass, kg, center, m, and tensor, kg*m^2, as far as they make sense (None).
    """
    settings = {key: value for section in elements(doc.root, "compiler") for key, value in section.attrib.items()}
    if settings.get("inertiafromgeom") == "true":
        return {}
    found: dict[Any, tuple[float, Any, Any]] = {}
    for body in (each for world in elements(doc.root, "worldbody") for each in world.iter("body")):
        name = body.get("name") or ""
        owner = f"body {name!r}" if name else "a body"
        for inertial in elements(body, "inertial"):
            mass = _parsed(inertial, "mass", 1)
            if mass is not None and mass[0] < 0:
                doc.add("mass-negative", inertial, f"{owner} has mass {mass[0]:g} kg", name=name)
            if mass is None or mass[0] <= 0:
                continue
            tensor = _tensor(inertial)
            if tensor is not None and not settings.keys() & {"balanceinertia", "boundinertia"}:
                proper = check_tensor(doc, inertial, tensor, mass=mass[0], owner=owner, name=name)
                tensor = tensor if proper else None
            found[inertial] = (mass[0], _parsed(inertial, "pos", 3), tensor)
    return found


def _tensor(inertial: Any) -> Any | None:
    diagonal, full = _parsed(inertial, "diaginertia", 3), _parsed(inertial, "fullinertia", 6)
    if diagonal is not None:
        return symmetric(*diagonal)
    return symmetric(*full) if full is not None else None


def _parsed(element: Any, attribute: str, count: int) -> list[float] | None:
    """Finite numbers of an attribute; None where they are wrong, which is reported elsewhere."""
    try:
        numbers = [float(word) for word in element.get(attribute, "").split()]
    except ValueError:
        return None
    return numbers if len(numbers) == count and all(map(math.isfinite, numbers)) else None


def check_keyframes(doc: CheckedDocument, sizes: Mapping[str, int] | None) -> None:
    """Report keyframes that do not fit; `sizes` are the lengths of the model's vectors."""
    for key in (each for section in elements(doc.root, "keyframe") for each in elements(section, "key")):
        owner = f"keyframe {key.get('name')!r}" if key.get("name") else "a keyframe"
        for attribute in _KEYS:
            numbers = read_numbers(doc, key, attribute, _MANY, owner=owner)
            if numbers is None or sizes is None or len(numbers) == sizes[attribute]:
                continue
            what = f"{owner} has {len(numbers)} numbers in {attribute}, and the model needs {sizes[attribute]}"
            rule = "keyframe-size" if len(numbers) > sizes[attribute] else "keyframe-short"
            doc.add(rule, key, what, name=key.get("name") or "")


def check_model(doc: CheckedDocument, found: Mapping[str, Any], lines: Mapping[int, Any]) -> None:
    """Report what MuJoCo refused, and what only shows once defaults are applied.

    Args:
        doc: The model.
        found: What `simulator.examine` found.
        lines: Line in the text that MuJoCo read -> element.
    """

    def element_at(line: int | None) -> Any:
        return lines.get(line or 0, doc.root)

    refused = found["refused"]
    if refused is not None:
        element = element_at(refused["line"])
        reported = {finding.line for finding in doc.report.findings if finding.severity == "error"}
        if doc.place(element)[1] not in reported and doc.complete:
            doc.add("simulator-refuses", element, f"MuJoCo: {refused['message']}", name=element.get("name") or "")
    if found.get("actuators"):
        for joint in found.get("joints", ()):
            if joint["passive"]:
                what = f"nothing drives joint {joint['name']!r}"
                doc.add("joint-unactuated", element_at(joint["line"]), what, name=joint["name"])
    for actuator in found.get("actuators", ()):
        if not actuator["bounded"]:
            what = f"actuator {actuator['name']!r} has no ctrlrange"
            doc.add("control-unbounded", element_at(actuator["line"]), what, name=actuator["name"])
    _check_units(doc, [each for each in found.get("joints", ()) if each["hinge"] and each["limited"]], element_at)
    lines_of = {each["name"]: each["line"] for each in found.get("joints", ())}
    for name in found.get("outside", ()):
        what = f"the zero pose of joint {name!r} lies outside of its range"
        doc.add("zero-outside", element_at(lines_of.get(name)), what, name=name)
    for touching in found.get("touching", ()):
        first, second = touching["bodies"]
        body = next((each for each in doc.root.iter("body") if each.get("name") == second), doc.root)
        depth = touching["depth"] * 1000
        what = f"bodies {first!r} and {second!r} penetrate each other by {depth:.3g} mm"
        doc.add("self-collision", body, what, name=second)


def _check_units(doc: CheckedDocument, hinges: list[dict[str, Any]], element_at: Any) -> None:
    degrees = [each for each in hinges if each["degree"]]
    largest = max((max(abs(each["low"]), abs(each["high"])) for each in degrees), default=0.0)
    if len(degrees) > 1 and 0 < largest <= 2 * math.pi:
        what = f"no range of the {len(degrees)} limited hinges exceeds {largest:.4g}, and angles are in degrees"
        doc.add("range-units", element_at(degrees[0]["line"]), what, name=degrees[0]["name"])
    for each in hinges:
        if not each["degree"] and max(abs(each["low"]), abs(each["high"])) > _TURNS:
            what = f"joint {each['name']!r} turns from {each['low']:g} to {each['high']:g}, and angles are in radians"
            doc.add("range-units", element_at(each["line"]), what, name=each["name"])
