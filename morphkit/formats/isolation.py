"""Work on a file that may cost much, done in a process of its own with limits on memory and processor time.

MuJoCo's parser and compiler and the readers of meshes have no limits of their own. A file that is small, refers to
little, and holds nothing that multiplies is worked on directly, since what it costs is known to be little.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from morphkit.description import Description
from morphkit.errors import AssetError, DescriptionError, MorphkitError
from morphkit.formats.assets import mentions
from morphkit.formats.budgets import check_numbers
from morphkit.formats.document import document_of
from morphkit.formats.limits import MESH_BYTES
from morphkit.formats.mjcf_include import flattened
from morphkit.formats.mjcf_schema import EXPANDERS
from morphkit.formats.resolve import locate
from morphkit.utils.process_limits import Limits

SMALL_BYTES = 2**24
"""Bytes of all meshes of a robot that is worked on directly."""
SMALL_ELEMENTS = 20_000
"""Elements of its file."""
SMALL_NUMBERS = 2**22
"""Numbers that its attributes ask for."""
PLAIN_MESHES = (".stl", ".obj", ".msh")
"""Meshes that take time and memory in proportion to their bytes; other formats can refer to a part many times."""
_COSTLY = ("model", "lengthrange", "muscle", "plugin", *EXPANDERS)
T = TypeVar("T")


def expanding(description: Description) -> Limits | None:
    """Limits for reading a description without its meshes; None where that costs little."""
    root = _whole(description)
    if root.tag == "robot" or (next(root.iter(*_COSTLY), None) is None and _is_short(root)):
        return None
    return Limits.for_meshes(0, 0)


def compiling(description: Description) -> Limits | None:
    """Limits for compiling a description; None where that costs little."""
    root = _whole(description)
    paths = _meshes(description)
    plain = all(path.suffix.lower() in PLAIN_MESHES for path in paths) and sum(_sizes(paths)) <= SMALL_BYTES
    short = expanding(description) is None and _is_short(root)
    if plain and short and check_numbers(root, file=description.file) <= SMALL_NUMBERS:
        return None
    return limits_of(paths)


def working(description: Description) -> Limits:
    """Limits for a worker that compiles a description and its variants."""
    return limits_of(_meshes(description))


def limits_of(meshes: Sequence[Path]) -> Limits:
    """Limits for work on mesh files; those that are too large to be read do not count."""
    sizes = _sizes(meshes)
    return Limits.for_meshes(sum(sizes), max(sizes, default=0))


def _sizes(meshes: Sequence[Path]) -> list[int]:
    sizes = [path.stat().st_size for path in meshes if path.is_file()]
    return [size for size in sizes if size <= MESH_BYTES]


def isolated(call: Callable[..., T], description: Description, limits: Limits | None, **options: Any) -> T:
    """`call(description, **options)`, in a process of its own where there are limits.

    Where this process is a worker itself, its own limits hold.

    Raises:
        DescriptionError: The limits did not suffice, or the process died.
        MorphkitError: As `call`.
    """
    if limits is None:
        return call(description, **options)
    from morphkit.utils.isolation import run_isolated  # which takes long to import, for few files

    sent = replace(description, packages=dict(description.packages))
    sent.keep(morphology=description.morphology)
    return run_isolated(
        partial(call, sent, **options),
        limits,
        problem=lambda reason: DescriptionError(f"{description.file}: cannot be used: {reason}"),
    )


def _whole(description: Description) -> Any:
    """The root element with what the file includes; without that where it cannot be followed."""
    document = document_of(description)
    if description.format == "urdf" or next(document.root.iter("include"), None) is None:
        return document.root
    with contextlib.suppress(MorphkitError):
        tree = flattened(document, description.folder, file=description.file, packages=description.packages)
        return tree.getroot()
    return document.root


def _is_short(root: Any) -> bool:
    return not any(number >= SMALL_ELEMENTS for number, _ in enumerate(root.iter()))


def _meshes(description: Description) -> list[Path]:
    """The mesh files that a description names, once for each scale; those that cannot be found are left out."""
    return [path for path, _ in dict.fromkeys(_located(description))]


def _located(description: Description) -> Iterator[tuple[Path, str | None]]:
    find = partial(locate, description=description)
    for each in mentions(_whole(description), find):
        if each.element.tag in ("mesh", "skin", "hfield"):
            try:
                yield find(each.reference), each.element.get("scale")
            except AssetError:
                continue
