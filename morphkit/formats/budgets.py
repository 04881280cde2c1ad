"""How much an MJCF file may make MuJoCo allocate in all: pixels, heights, user data, vertices of built-in meshes."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Mapping
from typing import Any

from morphkit.errors import DescriptionError

NUMBERS = 2**26
"""Numbers that the attributes of a file, or one of its images, may make MuJoCo allocate."""
BUILTIN_VERTICES = 2000
"""Vertices of a built-in mesh; MuJoCo's time for the hull of some grows with the square of their number."""

_COUNTS: Mapping[str, tuple[tuple[str, ...], ...]] = {
    "hfield": (("nrow", "ncol"),),
    "texture": (("width", "height"),),
    "numeric": (("size",),),
    "user": (("dim",),),
    "camera": (("resolution",),),
    "contact": (("num",),),
    "size": tuple((key,) for key in ("nuserdata", "nkey", "njmax", "nconmax", "nstack")),
}
_NUSER = "nuser_"
_SIDES = 6
_SUBDIVIDED = ("sphere",)
_GRIDS = ("wedge", "plate")
_SQUARES = ("supersphere", "supertorus", "hemisphere")
_PNG = b"\x89PNG\r\n\x1a\n"
_KTX = b"\xabKTX 11\xbb\r\n\x1a\n"
HEAD_BYTES = 48
"""Of an image, in which its size is."""


def check_numbers(root: Any, *, file: str) -> int:
    """How many numbers all elements below `root` ask for.

    Raises:
        DescriptionError: More than 2^26 in all, or a built-in mesh of more than 2000 vertices; with the line.
    """
    total = 0
    for element in root.iter("mesh", *_COUNTS):
        where = f"{file}:{element.sourceline}"
        if element.tag == "mesh":
            vertices = builtin_vertices(element)
            if vertices > BUILTIN_VERTICES:
                shown = f'builtin="{element.get("builtin")}" params="{element.get("params", "")}"'
                raise DescriptionError(
                    f"{where}: <mesh {shown}> asks for {vertices:,} vertices; the limit is {BUILTIN_VERTICES:,}"
                )
            total += vertices
            continue
        for group in _groups(element):
            numbers = [number for key in group for number in integers(element.get(key))]
            asked = math.prod(numbers) * (_SIDES if _is_cube(element) else 1) if numbers else 0
            if asked > NUMBERS or any(number > 2**31 - 1 for number in numbers):
                shown = " ".join(f'{key}="{element.get(key)}"' for key in dict.fromkeys(group) if key in element.attrib)
                raise DescriptionError(f"{where}: <{element.tag} {shown}> asks for more than {NUMBERS:,} numbers")
            total += asked
            if total > NUMBERS:
                raise DescriptionError(
                    f"{where}: the file asks for more than {NUMBERS:,} numbers in all, up to this <{element.tag}>"
                )
    return total


def _groups(element: Any) -> Iterator[tuple[str, ...]]:
    yield from (("width", "width"),) if _is_cube(element) else _COUNTS[element.tag]
    if element.tag == "size":
        yield from ((key,) for key in element.attrib if key.startswith(_NUSER))


def _is_cube(texture: Any) -> bool:
    """Whether a texture is of six square sides as wide as it says, whatever its height; not of those from files."""
    drawn = texture.get("builtin", "none") != "none"
    return bool(texture.tag == "texture" and drawn and texture.get("type", "cube") != "2d")


def builtin_vertices(mesh: Any) -> int:
    """About how many vertices MuJoCo makes of a `<mesh builtin="...">`; 0 for others."""
    kind, counts = mesh.get("builtin", "none"), integers(mesh.get("params"))
    if kind == "none" or not counts:
        return 0
    if kind in _SUBDIVIDED:
        return 10 * 4 ** min(counts[0], 30)
    if kind in _SQUARES:
        return counts[0] ** 2
    return math.prod(counts[:2]) if kind in _GRIDS else counts[0]


def image_size(head: bytes) -> tuple[int, int] | None:
    """Width and height of a PNG or KTX image that its first 48 bytes state; None for another file."""
    if head.startswith(_PNG) and len(head) >= 24:
        width, height = struct.unpack(">II", head[16:24])
        return width, height
    if head.startswith(_KTX) and len(head) >= 44:
        width, height = struct.unpack("<II" if head[12:16] == b"\x01\x02\x03\x04" else ">II", head[36:44])
        return width, height
    return None


def integers(text: str | None) -> list[int]:
    """The numbers of an attribute, each at least 1 and at most 10^18; what is none is MuJoCo's to complain about."""
    numbers = []
    for word in (text or "").split():
        try:
            value = float(word)
        except ValueError:
            continue
        if math.isfinite(value):
            numbers.append(int(min(max(abs(value), 1.0), 1e18)))
    return numbers
