"""The meshes, textures and height fields that a description file refers to."""

from __future__ import annotations

import posixpath
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from morphkit.description import Description
from morphkit.errors import AssetError
from morphkit.io.resolve import locate
from morphkit.io.xml import parse

_TEXTURE_FILES = ("file", "fileback", "filedown", "filefront", "fileleft", "fileright", "fileup")


@dataclass(frozen=True, slots=True)
class Asset:
    """A file that a description needs.

    Attributes:
        reference: What the description says.
        place: Where a copy belongs, relative to the description's folder; None where no copy would be found.
        path: Where the file is; None where it is missing or may not be read.
        problem: Why `path` or `place` is None; else empty.
    """

    reference: str
    place: PurePosixPath | None
    path: Path | None
    problem: str = ""


def find_assets(description: Description) -> list[Asset]:
    """The files that a description refers to, in the order of the file, each once."""
    root = parse(description.source, file=description.file).getroot()
    references = _urdf(root) if description.format == "urdf" else _mjcf(root)
    return [_find(reference, description) for reference in dict.fromkeys(references)]


def _find(reference: str, description: Description) -> Asset:
    place = _place(reference)
    if place is None:
        return Asset(reference, None, None, "is no path relative to the description; not copied")
    try:
        return Asset(reference, place, locate(reference, description))
    except AssetError as error:
        return Asset(reference, place, None, str(error).splitlines()[0])


def _place(reference: str) -> PurePosixPath | None:
    text = reference.strip().replace("\\", "/")
    for scheme in ("package://", "model://"):
        text = text.removeprefix(scheme)
    path = PurePosixPath(posixpath.normpath(text))
    outside = path.is_absolute() or ".." in path.parts or ":" in path.parts[0]
    return None if outside else path


def _urdf(root: Any) -> Iterator[str]:
    for element in root.iter("mesh", "texture"):
        reference = element.get("filename")
        if reference:
            yield reference


def _mjcf(root: Any) -> Iterator[str]:
    mesh_folder, texture_folder, strip = "", "", False
    for compiler in root.iterfind("compiler"):
        both = compiler.get("assetdir")
        mesh_folder = compiler.get("meshdir", both if both is not None else mesh_folder)
        texture_folder = compiler.get("texturedir", both if both is not None else texture_folder)
        strip = compiler.get("strippath", str(strip).lower()) == "true"
    folders = {"texture": texture_folder, "mesh": mesh_folder, "hfield": mesh_folder, "skin": mesh_folder, "model": ""}
    for element in root.iterfind("asset/*"):
        folder = folders.get(element.tag)
        if folder is None:
            continue
        for attribute in _TEXTURE_FILES if element.tag == "texture" else ("file",):
            reference = element.get(attribute)
            if reference:
                reference = posixpath.basename(reference) if strip else reference
                yield posixpath.join(folder, reference) if folder else reference
