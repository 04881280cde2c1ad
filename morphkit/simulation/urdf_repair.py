"""What URDFs carry that means nothing and that MuJoCo refuses, such as shapes without extent."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from morphkit.formats.poses import numbers
from morphkit.formats.urdf_names import WORLD
from morphkit.morphology import Morphology
from morphkit.naming.unique import TakenNames

_SIZES = ("size", "radius", "length", "scale")
_THIN = "1e-6"  # m, or as a factor


def mend(robot: Any) -> Iterator[str]:
    """Take out what can be done without, in place; yield a sentence for each thing.

    A shape goes where it has no extent at all, and one that only decorates also where it is flat, has sizes that are no
    numbers, or is none that URDF knows. A flat one that things touch gets a thickness of 1 micrometer.

    Args:
        robot: The root element of a URDF.
    """
    for tag in ("visual", "collision"):
        for part in list(robot.iter(tag)):
            yield from _mend_shape(part)
    for color in list(robot.iter("color")):
        rgba = color.get("rgba", "")
        if not (len(rgba.split()) == 4 and all(map(_is_finite, rgba.split()))):
            yield f"color {rgba!r} is no red, green, blue and opacity; it was left out"
            color.getparent().remove(color)
    names = TakenNames(material.get("name") for material in robot.iter("material") if material.get("name"))
    for material in robot.iter("material"):
        if not material.get("name"):
            material.set("name", names.give("material"))
    seen: set[str] = set()
    for part in robot.iterfind("link/*[@name]"):
        if part.get("name") in seen:  # URDF allows that, MuJoCo does not
            del part.attrib["name"]
        else:
            seen.add(part.get("name"))
    for dynamics in robot.iterfind("joint/dynamics"):
        for key in ("damping", "friction"):
            if _is_finite(dynamics.get(key, "")) and float(dynamics.get(key)) < 0:
                joint = dynamics.getparent().get("name")
                yield f"{key} {dynamics.get(key)} of joint {joint!r} is negative: it counts as none"
                dynamics.set(key, "0")


def leave_out_strays(robot: Any, morphology: Morphology) -> Iterator[str]:
    """Leave out links and joints that are no part of the robot, in place; yield a sentence for each link."""
    wanted = {member for limb in morphology.limbs for member in limb.members}
    for joint in list(robot.iterchildren("joint")):
        if joint.find("child").get("link") not in wanted:
            robot.remove(joint)
    carried = robot.find(f"joint/parent[@link='{WORLD}']") is not None
    for link in list(robot.iterchildren("link")):
        name = link.get("name")
        if name not in wanted and not (name == WORLD and carried):
            robot.remove(link)
            yield f"link {name!r} is no part of the tree below {morphology.root.name!r} and was left out"


def _mend_shape(part: Any) -> Iterator[str]:
    shape: Any = next((each for each in part.iterfind("geometry/*") if isinstance(each.tag, str)), None)
    found = {key: shape.get(key).split() for key in _SIZES if shape.get(key) is not None} if shape is not None else {}
    words = [word for each in found.values() for word in each]
    problem = _problem(shape, words, decorates=part.tag == "visual")
    what = f"a {part.tag} of link {part.getparent().get('name')!r}"
    if problem:
        yield f"{what} {problem} and was left out"
        part.getparent().remove(part)
        return
    if any(map(_is_zero, words)):
        yield f"{what} is flat and got a thickness of 1 micrometer"
        for key, each in found.items():
            shape.set(key, " ".join(_THIN if _is_zero(word) else word for word in each))
    if len(found.get("scale", ())) == 1:  # which some readers take for all three
        shape.set("scale", " ".join(found["scale"] * 3))


def _problem(shape: Any, words: Sequence[str], *, decorates: bool) -> str:
    """Why a shape can be left out; empty where it cannot."""
    if words and all(map(_is_zero, words)):
        return "has no extent"
    if not decorates:
        return ""
    if shape is None or shape.tag not in ("mesh", "box", "sphere", "cylinder", "capsule"):
        return "has no shape that URDF knows"
    if not all(map(_is_finite, words)):
        return "has a size that is no number"
    return "has no extent" if any(map(_is_zero, words)) else ""


def _is_zero(word: str) -> bool:
    return _is_finite(word) and float(word) == 0


def _is_finite(word: str) -> bool:
    try:
        found = numbers(word)
    except ValueError:
        return False
    return found.size == 1 and bool(np.isfinite(found[0]))
