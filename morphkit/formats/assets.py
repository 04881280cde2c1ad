"""The meshes, textures, height fields and skins that a description file refers to."""

from __future__ import annotations

import posixpath
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from morphkit.description import Description
from morphkit.errors import AssetError
from morphkit.formats.mjcf_schema import FILE_FOLDERS, TEXTURE_FILES, file_folder, strips_paths
from morphkit.formats.packages import split_reference
from morphkit.formats.resolve import locate


@dataclass(frozen=True, slots=True)
class Asset:
    """A file that a description needs.

    Attributes:
        reference: What the description says, from its own folder.
        place: Where a copy belongs, relative to the description's folder; None where no copy would be found.
        path: Where the file is; None where it is missing or may not be read.
        problem: Why `path` is None; else empty.
    """

    reference: str
    place: PurePosixPath | None
    path: Path | None
    problem: str = ""


@dataclass(frozen=True, slots=True)
class Mention:
    """A place in a description that names a file.

    Attributes:
        element: The element.
        attribute: The attribute that names it.
        folder: What MJCF's `meshdir` or `texturedir` puts before the name; else empty.
        reference: The whole, from the description's folder.
    """

    element: Any
    attribute: str
    folder: str
    reference: str


def find_asset(reference: str, description: Description) -> Asset:
    """The file that `reference` in `description` means."""
    place = place_of(reference)
    try:
        return Asset(reference, place, locate(reference, description))
    except AssetError as error:
        return Asset(reference, place, None, str(error).splitlines()[0])


def mentions(root: Any) -> Iterator[Mention]:
    """All places below the root element of a URDF or MJCF file that name an asset file."""
    if root.tag == "robot":
        for element in root.iter("mesh", "texture"):
            if element.get("filename"):
                yield Mention(element, "filename", "", element.get("filename"))
        return
    folders = {setting: file_folder(root, setting) for setting in FILE_FOLDERS.values()}
    strip = strips_paths(root)
    for element in [*root.iterfind("asset/*"), *root.iterfind("deformable/skin")]:
        if element.tag != "model" and element.tag not in FILE_FOLDERS:
            continue
        folder = folders.get(FILE_FOLDERS.get(element.tag, ""), "")
        for attribute in TEXTURE_FILES if element.tag == "texture" else ("file",):
            name = element.get(attribute)
            if name:
                name = posixpath.basename(name) if strip else name
                yield Mention(element, attribute, folder, posixpath.join(folder, name))


def place_of(reference: str) -> PurePosixPath | None:
    """Where a copy of a file has to lie, relative to the description's folder, to be found by `reference`."""
    text = reference.strip().replace("\\", "/")
    package = split_reference(text)
    if package is not None:
        text = posixpath.join(*package)
    path = PurePosixPath(posixpath.normpath(text))
    outside = path.is_absolute() or ".." in path.parts or ":" in path.parts[0]
    return None if outside else path
