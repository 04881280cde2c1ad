"""The camera that a viewer starts with, which an MJCF file says by number."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from morphkit.ablation.loss import Loss


def cameras(root: Any) -> list[Any]:
    """All `<camera>` elements in the order in which MuJoCo numbers them: those of the world, then body by body."""
    worlds = list(root.iterfind("worldbody"))
    bodies = [body for world in worlds for body in world.iter("body")]
    return [camera for holder in [*worlds, *bodies] for camera in _own(holder)]


def renumber(root: Any, before: Sequence[Any]) -> Iterator[Loss]:
    """Let `<global cameraid>` name the camera that it named before a cut, or none where that camera went.

    Args:
        root: The `<mujoco>` element after the cut.
        before: `cameras` of it before the cut.
    """
    if next(root.iter("replicate", "attach"), None) is not None:
        return  # only MuJoCo knows the numbers
    left = {id(camera): number for number, camera in enumerate(cameras(root))}
    for view in root.iterfind("visual/global[@cameraid]"):
        number = _number(view.get("cameraid"))
        if number is None or not 0 <= number < len(before):
            continue
        now = left.get(id(before[number]))
        if now is None:
            del view.attrib["cameraid"]
            yield Loss("view", "cameraid", "", f"camera {before[number].get('name', number)} went; views start free")
        elif now != number:
            view.set("cameraid", str(now))


def _number(text: str) -> int | None:
    try:
        return int(text)
    except ValueError:
        return None


def _own(holder: Any) -> Iterator[Any]:
    for child in holder:
        if child.tag == "camera":
            yield child
        elif child.tag == "frame":
            yield from _own(child)
