"""MJCF `<include>`: replaced by what is in the included file."""

from __future__ import annotations

import contextlib
import os
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Literal, NoReturn

from lxml import etree

from morphkit.errors import AssetError, DescriptionError, MorphkitError
from morphkit.formats.assets import point_beside_includes
from morphkit.formats.document import Document
from morphkit.formats.mjcf_schema import FILE_FOLDERS
from morphkit.formats.resolve import resolve_asset

MAX_INCLUDES = 1000
_NO_PACKAGES: Mapping[str, Path] = MappingProxyType({})


@dataclass(frozen=True)
class IncludeProblem:
    """Why an include cannot be followed.

    Attributes:
        kind: The file is `missing` or cannot be read, is included `repeated`ly, or is no XML (`malformed`).
        element: The `<include>`.
        path: The included file; None where it is not known.
        reason: What is wrong, without the place of the include.
        error: The same as an error, with the place.
    """

    kind: Literal["missing", "repeated", "malformed"]
    element: etree._Element
    path: Path | None
    reason: str
    error: MorphkitError


def _refuse(problem: IncludeProblem) -> NoReturn:
    raise problem.error from None


def flatten_includes(
    tree: etree._ElementTree,
    folder: Path | None,
    *,
    file: str = "model",
    packages: Mapping[str, Path] = _NO_PACKAGES,
    part: Callable[[Path], etree._ElementTree] | None = None,
    read: Callable[[etree._Element, Path], None] | None = None,
    problem: Callable[[IncludeProblem], None] = _refuse,
) -> etree._ElementTree:
    """Replace every MJCF `<include file="..."/>` by what is in that file, in place.

    File names start in `folder`, else in the folder of the including file. As in MuJoCo, a file can be included once,
    and what it names is looked for beside it where it is not found otherwise.

    Args:
        tree: The parsed MJCF; it is edited.
        folder: The folder of the main file.
        file: What the main file is called in messages.
        packages: Further folders that included files may lie in.
        part: Gives the parsed tree of an included file, to be edited; by default the file is read.
        read: Is told the root element and the path of each included file, before its elements move.
        problem: Is told of each include that cannot be followed, which then is taken out; by default its error is
            raised.

    Returns:
        `tree`, without includes.

    Raises:
        AssetError: An included file is missing or lies outside `folder`.
        DescriptionError: An included file is not XML, or is included twice.
    """
    origin: dict[Path, str] = {}
    included: list[tuple[etree._Element, Path]] = []
    pending = deque((element, folder, file) for element in tree.iter("include"))
    while pending:
        element, base, owner = pending.popleft()
        where = f"{owner}:{element.sourceline}"
        found = _follow(element, where, folder, base, packages, origin, part or _read)
        if isinstance(found, IncludeProblem):
            problem(found)
            _replace(element, [])
            continue
        path, root = found
        own = _folder_of(path, element.get("file") or "", folder, base)
        included += [(each, own) for each in root.iter(*FILE_FOLDERS, "model")]
        if read is not None:
            read(root, path)
        children = list(root)
        _replace(element, children)
        for child in children:
            if isinstance(child.tag, str):
                pending += [(nested, own, path.name) for nested in child.iter("include")]
    if folder is not None:
        point_beside_includes(tree.getroot(), included, folder)
    return tree


def flattened(
    document: Document,
    folder: Path | None,
    *,
    file: str,
    packages: Mapping[str, Path],
    read: Callable[[etree._Element, Path], None] | None = None,
) -> etree._ElementTree:
    """A copy of a document's tree, to be edited, without includes; every included file is parsed once.

    Args and Raises as in `flatten_includes`.
    """
    return flatten_includes(
        document.copy(), folder, file=file, packages=packages, part=lambda path: document.part(path).copy(), read=read
    )


def _read(path: Path) -> etree._ElementTree:
    return Document.open(path).tree


def _follow(
    element: etree._Element,
    where: str,
    folder: Path | None,
    base: Path | None,
    packages: Mapping[str, Path],
    origin: dict[Path, str],
    part: Callable[[Path], etree._ElementTree],
) -> tuple[Path, etree._Element] | IncludeProblem:
    """The included file and its root element."""
    reference = element.get("file")
    if reference is None:
        reason = '<include> without file; write <include file="part.xml"/>'
        return IncludeProblem("missing", element, None, reason, DescriptionError(f"{where}: {reason}"))
    if folder is None or base is None:
        reason = f"<include file={reference!r}> cannot be followed without a folder"
        return IncludeProblem("missing", element, None, reason, DescriptionError(f"{where}: {reason}"))
    try:
        path = _locate(reference, folder, base, packages)
    except AssetError as error:
        return IncludeProblem("missing", element, None, str(error), AssetError(f"{where}: {error}"))
    if path in origin or len(origin) >= MAX_INCLUDES:
        reason = f"{reference!r} is included again (first by {origin.get(path, 'many')}); a file can be included once"
        return IncludeProblem("repeated", element, path, reason, DescriptionError(f"{where}: {reason}"))
    origin[path] = where
    try:
        return path, part(path).getroot()
    except DescriptionError as error:
        return IncludeProblem("malformed", element, path, str(error), error)
    except OSError as error:
        reason = f"{reference!r} cannot be read: {error.strerror}"
        return IncludeProblem("missing", element, path, reason, AssetError(f"{where}: {reason}"))


def _locate(reference: str, folder: Path, base: Path, packages: Mapping[str, Path]) -> Path:
    try:
        return resolve_asset(reference, folder, packages=packages)
    except AssetError:
        if base == folder:
            raise
        try:
            return resolve_asset(str(base / reference), folder, packages=packages)
        except AssetError:
            pass
        raise


def _folder_of(path: Path, reference: str, folder: Path | None, base: Path | None) -> Path:
    """The folder that an included file lies in as it was named, which links may lead to."""
    for start in (folder, base):
        named = Path(os.path.normpath(start / reference)) if start is not None else path
        with contextlib.suppress(OSError, RuntimeError, ValueError):  # Another file that cannot be read.
            if named.samefile(path):
                return named.parent
    return path.parent


def _replace(element: etree._Element, children: list[etree._Element]) -> None:
    parent = element.getparent()
    if parent is None:
        raise DescriptionError("<include> cannot be the root element")
    at, tail = parent.index(element), element.tail
    parent.remove(element)
    for offset, child in enumerate(children):
        parent.insert(at + offset, child)
    if children:
        children[-1].tail = tail
