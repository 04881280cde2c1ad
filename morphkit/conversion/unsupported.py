"""What a URDF says that MJCF has no word for."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from morphkit.formats.urdf_transmissions import driven_joints

_KNOWN = ("link", "joint", "material", "transmission", "mujoco")
_JOINT_PARTS = {
    "safety_controller": "soft limits are a matter of the controller",
    "calibration": "MuJoCo's joints need none",
}
_BLOCKS = {
    "gazebo": "it speaks to Gazebo only",
    "ros2_control": "it speaks to ros2_control only",
    "sensor": "sensors of URDF are no MuJoCo sensors; add <sensor> elements by hand",
}


@dataclass(frozen=True, slots=True)
class Missing:
    """Something that has no counterpart in the MJCF.

    Attributes:
        kind: `velocity limit`, `transmission`, `gazebo`, `texture`, ...
        name: Name of the joint, link or block; empty where it has none.
        line: Line in the URDF.
        reason: Why, for people.
    """

    kind: str
    name: str
    line: int | None
    reason: str


def without_counterpart(robot: Any) -> Iterator[Missing]:
    """Yield what is in a URDF and not in the MJCF made of it, in the order of the file.

    Args:
        robot: The root element.
    """
    for element in robot:
        if not isinstance(element.tag, str):
            continue
        name = element.get("name") or element.get("reference") or ""
        if element.tag == "joint":
            yield from _joint(element, name)
        elif element.tag == "transmission":
            yield from _transmission(element, name)
        elif element.tag in ("link", "material"):
            for texture in element.iter("texture"):
                yield Missing("texture", name, texture.sourceline, "MuJoCo's importer takes colors only")
        elif element.tag not in _KNOWN:
            reason = _BLOCKS.get(element.tag, "MuJoCo knows no such element")
            yield Missing(element.tag, name, element.sourceline, reason)


def _joint(joint: Any, name: str) -> Iterator[Missing]:
    for part in joint:
        if not isinstance(part.tag, str):
            continue
        if part.tag in _JOINT_PARTS:
            yield Missing(part.tag.replace("_", " "), name, part.sourceline, _JOINT_PARTS[part.tag])
        elif part.tag == "limit" and joint.get("type") != "fixed" and _number(part, "velocity") != 0:
            if _number(part, "effort") > 0 and not any(_number(each, "damping") for each in joint.iterfind("dynamics")):
                continue  # its damping holds it at that speed
            reason = f"MuJoCo bounds forces, not speeds ({part.get('velocity')})"
            yield Missing("velocity limit", name, part.sourceline, reason)


def _number(element: Any, attribute: str) -> float:
    """A number in an attribute; 0 where there is none."""
    try:
        return float(element.get(attribute, "0"))
    except ValueError:
        return 0.0


def _transmission(transmission: Any, name: str) -> Iterator[Missing]:
    for ratio in transmission.iter("mechanicalReduction"):
        text = (ratio.text or "").strip()
        if text not in ("", "1", "1.0"):
            reason = f"effort limits are those of the joint, so motors have gear 1 ({text})"
            yield Missing("mechanical reduction", name, ratio.sourceline, reason)
    if not driven_joints(transmission):
        yield Missing("transmission", name, transmission.sourceline, "it drives no joint")
