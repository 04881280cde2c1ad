"""Where the files lie that a description refers to: meshes, textures, included and attached files."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from urllib.parse import unquote

from morphkit.description import Description
from morphkit.errors import AssetError
from morphkit.formats.packages import Home, homes, own_package, split_reference

_NO_PACKAGES: Mapping[str, Path] = MappingProxyType({})
_SCHEME = re.compile(r"([A-Za-z][A-Za-z0-9+.-]+):/{0,2}(.*)", re.DOTALL)


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
