"""Where the files lie that a description refers to: meshes, textures and includes."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from urllib.parse import unquote

from lxml import etree

from morphkit.description import Description
from morphkit.errors import AssetError, DescriptionError
from morphkit.formats.packages import Home, homes, own_package, split_reference
from morphkit.formats.xml import parse, read_limited

_NO_PACKAGES: Mapping[str, Path] = MappingProxyType({})
_SCHEME = re.compile(r"([A-Za-z][A-Za-z0-9+.-]+):/{0,2}(.*)", re.DOTALL)
_MAX_INCLUDES = 1000


def locate(reference: str, description: Description) -> Path:
    """Return the existing file that a description refers to; see `resolve_asset`.

    Raises:
        AssetError: There is no such file, it may not be read, or the description has no folder.
    """
    if description.folder is None:
        raise AssetError(f"{description.file}: {reference!r} cannot be looked for: the description has no folder")
    return resolve_asset(reference, description.folder, packages=description.packages)


def resolve_asset(reference: str, folder: Path, *, packages: Mapping[str, Path] = _NO_PACKAGES) -> Path:
    """Return the existing file that a description refers to.

    `package://name/rest`, `model://name/rest` and `$(find name)/rest` are looked for in the package's folders in the
    order of `packages.homes`, then below `folder` as `name/rest` and `rest`. Relative paths start in `folder`. They,
    `file://` and absolute paths must lie in `folder`, in the package that it is part of, or in one of `packages`.

    Args:
        reference: What the description says.
        folder: The folder of the description file.
        packages: Folder of each ROS package or Gazebo model that may be read, by name.

    Raises:
        AssetError: There is no such file, or it may not be read; the message lists every path tried.
    """
    text = reference.strip().replace("\\", "/")
    if not text or "\0" in text:
        raise AssetError(f"empty or impossible file name {reference!r}")
    folder = folder.resolve()
    own = own_package(folder)
    inside = [Home(folder, "own"), *([Home(own, "own")] if own else []), *(Home(p, "named") for p in packages.values())]
    named = split_reference(text)
    candidates: list[tuple[Path, list[Home]]]
    if named is not None:
        name, rest = unquote(named[0]), unquote(named[1])
        candidates = [(home.path / rest, [home]) for home in homes(name, folder, packages)]
        candidates += [(folder / name / rest, inside), (folder / rest, inside)]
    else:
        scheme = _SCHEME.fullmatch(text)
        if scheme is not None and scheme[1] != "file":
            raise AssetError(f"cannot read {reference!r}: scheme {scheme[1]!r} is not supported; use a relative path")
        candidates = [(folder / (unquote(scheme[2]) if scheme else text), inside)]
    verdicts: dict[Path, str] = {}
    for path, allowed in candidates:
        if path not in verdicts:
            try:
                permitted, there = any(home.allows(path) for home in allowed), path.is_file()
            except (OSError, RuntimeError) as error:
                verdicts[path] = f" ({getattr(error, 'strerror', None) or 'links form a ring'})"
                continue
            if permitted and there:
                return path.resolve()
            verdicts[path] = "" if permitted else " (outside, refused)"
    advice = "put the file there, or correct the reference"
    if any("refused" in verdict for verdict in verdicts.values()):
        advice = "copy the file into the robot's folder, or allow its folder with --package NAME=DIR"
    elif named is not None:
        advice = f"say where the package is with --package {named[0] or 'NAME'}=DIR, or in ROS_PACKAGE_PATH"
    tried = "".join(f"\n  {path}{verdict}" for path, verdict in verdicts.items())
    raise AssetError(f"file {reference!r} not found; {advice}. Tried:{tried}")


def flatten_includes(
    tree: etree._ElementTree,
    folder: Path | None,
    *,
    file: str = "model",
    packages: Mapping[str, Path] = _NO_PACKAGES,
    read: Callable[[etree._Element, Path], None] | None = None,
) -> etree._ElementTree:
    """Replace every MJCF `<include file="..."/>` by what stands in that file, in place.

    File names start in `folder`, else in the folder of the including file. As in MuJoCo, a file can be included once.

    Args:
        tree: The parsed MJCF; it is edited.
        folder: The folder of the main file.
        file: What the main file is called in messages.
        packages: Further folders that included files may lie in.
        read: Is told the root element and the path of each included file, before its elements move.

    Returns:
        `tree`, without includes.

    Raises:
        AssetError: An included file is missing or lies outside `folder`.
        DescriptionError: An included file is not XML, or is included twice.
    """
    origin: dict[Path, str] = {}
    pending = [(element, folder, file) for element in tree.iter("include")]
    while pending:
        element, base, owner = pending.pop()
        where = f"{owner}:{element.sourceline}"
        reference = element.get("file")
        if reference is None:
            raise DescriptionError(f'{where}: <include> without file; write <include file="part.xml"/>')
        if folder is None or base is None:
            raise DescriptionError(f"{where}: <include file={reference!r}> cannot be followed without a folder")
        try:
            path = _included(reference, folder, base, packages)
        except AssetError as error:
            raise AssetError(f"{where}: {error}") from None
        if path in origin or len(origin) >= _MAX_INCLUDES:
            raise DescriptionError(
                f"{where}: {reference!r} is included again (first by {origin.get(path, 'many')}); a file can be"
                " included once"
            )
        origin[path] = where
        try:
            part = parse(read_limited(path), file=path.name).getroot()
        except OSError as error:
            raise AssetError(f"{where}: {path} cannot be read: {error.strerror}") from None
        if read is not None:
            read(part, path)
        children = list(part)
        _replace(element, part)
        for child in children:
            if isinstance(child.tag, str):
                pending += [(nested, path.parent, path.name) for nested in child.iter("include")]
    return tree


def _included(reference: str, folder: Path, base: Path, packages: Mapping[str, Path]) -> Path:
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


def _replace(element: etree._Element, part: etree._Element) -> None:
    parent = element.getparent()
    if parent is None:
        raise DescriptionError("<include> cannot be the root element")
    at = parent.index(element)
    tail = element.tail
    children = list(part)
    parent.remove(element)
    for offset, child in enumerate(children):
        parent.insert(at + offset, child)
    if children:
        children[-1].tail = tail
