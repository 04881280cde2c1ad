"""What URDFs carry that means nothing and that MuJoCo refuses, such as shapes without extent."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from morphkit.formats.poses import numbers
from morphkit.formats.urdf_names import WORLD
from morphkit.morphology import Morphology
from morphkit.naming.unique import TakenNames
from morphkit.simulation.urdf_shapes import settle_shapes


def mend(robot: Any, *, file: str) -> Iterator[str]:
    """Take out what can be done without, in place; yield a sentence for each thing.

    Args:
        robot: The root element of a URDF.
        file: Its name, for errors.

    Raises:
        DescriptionError: As `settle_shapes`.
    """
    yield from settle_shapes(robot, file=file)
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


def _is_finite(word: str) -> bool:
    try:
        found = numbers(word)
    except ValueError:
        return False
    return found.size == 1 and bool(np.isfinite(found[0]))
