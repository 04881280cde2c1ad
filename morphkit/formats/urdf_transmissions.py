"""Which joints a URDF transmission drives, whatever its elements are called."""

from __future__ import annotations

from typing import Any

_PASSIVE = ("passive", "simulated")


def driven_joints(transmission: Any) -> list[tuple[Any, str]]:
    """The elements that name driven joints, and those names.

    URDF has `<joint name=...>`; those of PR2 and others say `flexJoint`, `gap_joint` and the like.
    """
    found = []
    for element in transmission.iterchildren("*"):
        tag = str(element.tag).rpartition("}")[2].lower()
        name = (element.get("name") or element.text or "").strip()
        if tag.endswith("joint") and not tag.startswith(_PASSIVE) and name:
            found.append((element, name))
    return found
