"""What URDFs carry that means nothing and that MuJoCo refuses: shapes without extent, colours that are none."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

_SIZES = ("size", "radius", "length")
_THIN = "1e-6"  # m


def mend(robot: Any) -> Iterator[str]:
    """Take out what can be done without, in place; yield a sentence for each thing.

    A shape goes where it has no extent at all, or is flat and only decorates; a flat one that things touch gets a
    thickness of 1 micrometre.

    Args:
        robot: The root element of a URDF.
    """
    for tag in ("visual", "collision"):
        for part in list(robot.iter(tag)):
            yield from _mend_shape(part)
    for colour in list(robot.iter("color")):
        rgba = colour.get("rgba")
        if rgba is not None and not _is_colour(rgba):
            yield f"colour {rgba!r} is no red, green, blue and opacity; it was left out"
            colour.getparent().remove(colour)


def _mend_shape(part: Any) -> Iterator[str]:
    shape = next((each for each in part.iterfind("geometry/*") if isinstance(each.tag, str)), None)
    if shape is None:
        return
    found = {key: shape.get(key).split() for key in _SIZES if shape.get(key) is not None}
    flat = [_is_zero(word) for words in found.values() for word in words]
    if not any(flat):
        return
    what = f"a {part.tag} of link {part.getparent().get('name')!r}"
    if all(flat) or part.tag == "visual":
        yield f"{what} has no extent and was left out"
        part.getparent().remove(part)
        return
    for key, words in found.items():
        shape.set(key, " ".join(_THIN if _is_zero(word) else word for word in words))
    yield f"{what} is flat and got a thickness of {_THIN} m"


def _is_zero(word: str) -> bool:
    try:
        return float(word) == 0
    except ValueError:
        return False


def _is_colour(rgba: str) -> bool:
    try:
        numbers = [float(word) for word in rgba.split()]
    except ValueError:
        return False
    return len(numbers) == 4 and all(map(math.isfinite, numbers))
