"""Where the files lie that a description refers to: meshes, textures and includes."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from urllib.parse import unquote

from lxml import etree

from morphkit.errors import AssetError, DescriptionError
from morphkit.io.xml import parse

_NO_PACKAGES: Mapping[str, Path] = MappingProxyType({})
_SCHEME = re.compile(r"([A-Za-z][A-Za-z0-9+.-]+):/{0,2}(.*)", re.DOTALL)
_MAX_INCLUDES = 1000


def resolve_asset(reference: str, folder: Path, *, packages: Mapping[str, Path] = _NO_PACKAGES) -> Path:
    """Return the existing file that a description refers to.

    `package://name/rest` and `model://name/rest` are looked for in `packages[name]`, then in the nearest folder above
    that is called `name` and holds a `package.xml`, then below `folder` as `name/rest` and `rest`. Relative paths
    start in `folder`. `file://` and absolute paths must lie in `folder` or in a package.

    Args:
        reference: What the description says.
        folder: The folder of the description file.
        packages: Folder of each ROS package or Gazebo model that may be read, by name.

    Raises:
        AssetError: There is no such file, or it lies outside `folder` and all packages; the message lists every path
            tried.
    """
    text = reference.strip().replace("\\", "/")
    if not text or "\0" in text:
        raise AssetError(f"empty or impossible file name {reference!r}")
    folder = folder.resolve()
    allowed = [folder, *(path.resolve() for path in packages.values())]
    candidates: list[Path] = []
    match = _SCHEME.fullmatch(text)
    if match is None:
        candidates.append(folder / text)
    elif match[1] in ("package", "model"):
        name, _, rest = unquote(match[2]).partition("/")
        if name in packages:
            candidates.append(packages[name] / rest)
        home = next((p for p in (folder, *folder.parents) if p.name == name and (p / "package.xml").is_file()), None)
        if home is not None:
            candidates.append(home / rest)
            allowed.append(home)
        candidates += [folder / name / rest, folder / rest]
    elif match[1] == "file":
        candidates.append(folder / unquote(match[2]))
    else:
        raise AssetError(f"cannot read {reference!r}: scheme {match[1]!r} is not supported; use a relative path")
    outside = []
    for candidate in candidates:
        path = candidate.resolve()
        if not any(path.is_relative_to(base) for base in allowed):
            outside.append(candidate)
        elif path.is_file():
            return path
    tried = "".join(f"\n  {path}{' (outside, refused)' if path in outside else ''}" for path in candidates)
    advice = (
        "copy the file into the robot's folder, or name its package"
        if outside
        else "put the file there, or correct the reference"
    )
    raise AssetError(f"file {reference!r} not found; {advice}. Tried:{tried}")


def flatten_includes(tree: etree._ElementTree, folder: Path | None, *, file: str = "model") -> etree._ElementTree:
    """Replace every MJCF `<include file="..."/>` by what stands in that file, in place.

    File names start in `folder`, else in the folder of the including file. As in MuJoCo, a file can be included once.

    Args:
        tree: The parsed MJCF; it is edited.
        folder: The folder of the main file.
        file: What the main file is called in messages.

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
            path = _included(reference, folder, base)
        except AssetError as error:
            raise AssetError(f"{where}: {error}") from None
        if path in origin or len(origin) >= _MAX_INCLUDES:
            raise DescriptionError(
                f"{where}: {reference!r} is included again (first by {origin.get(path, 'many')}); a file can be"
                " included once"
            )
        origin[path] = where
        try:
            part = parse(path.read_bytes(), file=path.name).getroot()
        except OSError as error:
            raise AssetError(f"{where}: {path} cannot be read: {error.strerror}") from None
        children = list(part)
        _replace(element, part)
        for child in children:
            if isinstance(child.tag, str):
                pending += [(nested, path.parent, path.name) for nested in child.iter("include")]
    return tree


def _included(reference: str, folder: Path, base: Path) -> Path:
    try:
        return resolve_asset(reference, folder)
    except AssetError:
        nested = (base / reference).resolve()
        if nested.is_relative_to(folder.resolve()) and nested.is_file():
            return nested
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
