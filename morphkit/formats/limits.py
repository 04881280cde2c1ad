"""Limits for files from strangers, far above those of real robots: what is larger is refused before it costs time.

MuJoCo allocates what a few attributes ask for, and its parser and compiler follow some of them without end.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from morphkit.errors import DescriptionError
from morphkit.formats.budgets import check_numbers, integers

ELEMENTS = 1_000_000
"""Tags and comments of a file."""
BODIES = 20_000
"""Bodies or links, those that `replicate`, `composite` and `flexcomp` make included."""
ATTRIBUTES = 1000
"""Attributes of a tag; looking at them takes time with the square of their number."""
CHAIN = 250
"""Links that hang one on another in what is simulated; MJCF nests them, and XML readers stop at 256 levels."""
MESH_BYTES = 512 * 2**20
"""Of a mesh file, unpacked; those of real robots have some megabytes."""
STL_FACES = 4_000_000
"""Triangles of a binary STL, which says at its start how many it has; those of real robots have at most a million."""
NAME_LENGTH = 1000
READINGS = 10_000
"""Readings of one declared sensor; one with more is taken for an image."""

_NAMES = ("name", "link", "joint", "body", "class", "childclass", "mesh", "prefix")
_LISTS = {"flex": ("body", "node"), "flexcomp": ("body", "node")}
"""Attributes of names of bodies, of which a piece of cloth has hundreds; the limit holds for each name."""
_FEW_NODES = ("trilinear", "quadratic")
_GMSH_NODES = re.compile(rb"\$Nodes\s+(\d[\d ]{,100})")


def check_size(root: Any, *, file: str) -> None:
    """Refuse a tree with too many attributes in one tag, or too long a name.

    Raises:
        DescriptionError: With the line, and what the limit is.
    """
    for element in root.iter("*"):
        if len(element.attrib) > ATTRIBUTES:
            raise DescriptionError(
                f"{file}:{element.sourceline}: <{element.tag}> has {len(element.attrib):,} attributes;"
                f" the limit is {ATTRIBUTES:,}"
            )
        lists = _LISTS.get(element.tag, ())
        for key in (*_NAMES, *(key for key in lists if key not in _NAMES)):
            value = element.get(key, "")
            length = max(map(len, value.split()), default=0) if key in lists else len(value)
            if length > NAME_LENGTH:
                raise DescriptionError(
                    f"{file}:{element.sourceline}: <{element.tag}> has a {key} of {length:,} characters;"
                    f" the limit is {NAME_LENGTH:,}"
                )


def check_count(root: Any, tag: str, *, file: str) -> None:
    """Refuse more than 20,000 bodies or links; DescriptionError."""
    count = _made(root) if tag == "body" else sum(1 for _ in root.iterchildren(tag))
    if count > BODIES:
        raise DescriptionError(f"{file}: makes {count:,} {tag} elements; the limit is {BODIES:,}")


def check_chain(root: Any, *, file: str) -> None:
    """Refuse a URDF for simulation where more than 250 links hang one on another; DescriptionError.

    The time and memory of a simulation step grow with the square of that number.
    """
    above = {
        child.get("link"): parent.get("link")
        for joint in root.iterchildren("joint")
        if (child := joint.find("child")) is not None and (parent := joint.find("parent")) is not None
    }
    depths: dict[str, int] = {}
    for link in above:
        chain: list[str] = []
        while link in above and link not in depths and len(chain) <= CHAIN:
            chain.append(link)
            link = above[link]
        top = depths.get(link, 0)
        if top + len(chain) > CHAIN:
            raise DescriptionError(
                f"{file}: a chain of more than {CHAIN} links, one on another, such as down to {chain[0]!r}; MuJoCo"
                " would take time and memory with the square of its length"
            )
        depths |= {name: top + number for number, name in enumerate(reversed(chain), start=1)}


def check_mjcf(root: Any, *, file: str) -> None:
    """Refuse an MJCF tree that makes MuJoCo allocate or expand without measure, or that holds undefined numbers.

    Raises:
        DescriptionError: With the line, and what the limit is.
    """
    check_count(root, "body", file=file)
    for element in root.iter("*"):
        for key, value in element.attrib.items():
            if "nan" in value.lower() and _is_undefined(value):
                raise DescriptionError(
                    f'{file}:{element.sourceline}: {key}="{value}" in <{element.tag}>: NaN is no number'
                )
    check_numbers(root, file=file)


def check_flexcomp(flexcomp: Any, content: bytes, path: Path, *, where: str) -> None:
    """Refuse a flexcomp whose shape has so many vertices that it makes more than 20,000 bodies; DescriptionError.

    Args:
        flexcomp: The element.
        content: The bytes of its file.
        path: The file.
        where: The place of the element, for the message.
    """
    if flexcomp.get("rigid") == "true" or flexcomp.get("dof") in _FEW_NODES:
        return
    made = _vertices(content, path) * math.prod(_replicas(flexcomp.iterancestors("replicate")))
    if made > BODIES:
        raise DescriptionError(f"{where}: a flexcomp of {path.name} makes {made:,} bodies; the limit is {BODIES:,}")


def _vertices(content: bytes, path: Path) -> int:
    """How many vertices a mesh file has at most; 0 for what is none, which MuJoCo refuses."""
    if path.suffix.lower() == ".stl":
        return 3 * int.from_bytes(content[80:84], "little")
    if path.suffix.lower() == ".msh":
        nodes = _GMSH_NODES.search(content)
        # Of Gmsh, else of MuJoCo's own format.
        return max(map(int, nodes[1].split()), default=0) if nodes else int.from_bytes(content[:4], "little")
    return content.count(b"\nv ") + content.startswith(b"v ")


def abridged(names: Sequence[str], most: int = 50) -> str:
    """`a, b, c`, or the first `most` of them and how many others there are."""
    shown = ", ".join(names[:most])
    return shown if len(names) <= most else f"{shown} and {len(names) - most:,} others"


def _is_undefined(text: str) -> bool:
    try:
        return any(math.isnan(float(word)) for word in text.split())
    except ValueError:
        return False


def _made(root: Any) -> int:
    """How many bodies the tree makes; `replicate` multiplies, `composite` and `flexcomp` make one a point at most."""
    total = 0
    for element in root.iter("body", "composite", "flexcomp"):
        own = 1 if element.tag == "body" else math.prod(integers(element.get("count")))
        total += own * math.prod(_replicas(element.iterancestors("replicate")))
        if total > BODIES:
            break
    return max(total, *(math.prod(_replicas([leaf])) for leaf in root.iter("replicate")), 0)


def _replicas(elements: Iterable[Any]) -> Iterator[int]:
    for element in elements:
        yield max([1, *integers(element.get("count"))])
