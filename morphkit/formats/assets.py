"""The meshes, textures, height fields, skins and flexes that a description file refers to, and where MuJoCo finds them.

A name in an MJCF starts in `meshdir` or `texturedir`; with `strippath="true"` only its last part counts. What is not
there, and is named by an included file, lies beside that file. Paths are shortened as text, so that `a/../b`
means `b` even where there is no `a`.
"""

from __future__ import annotations

import os
import posixpath
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from morphkit.description import Description
from morphkit.errors import AssetError
from morphkit.formats.mjcf_schema import (
    FILE_FOLDERS,
    FILE_SETTINGS,
    TEXTURE_FILES,
    drop_file_settings,
    file_folder,
    reads_file,
    sought_folder,
    strips_paths,
)
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


def mentions(root: Any, find: Callable[[str], Path] | None = None) -> Iterator[Mention]:
    """All places in a description that name an asset file.

    Args:
        root: The root element of a URDF, or of an MJCF whose includes are flattened.
        find: Gives the file that a reference means; AssetError where there is none. It is asked for URDFs that say
            where MuJoCo finds their meshes; without it that is not heeded.
    """
    if root.tag == "robot":
        for element in root.iter("mesh", "texture"):
            if element.get("filename"):
                yield Mention(element, "filename", "", reference_in_urdf(element, find))
        return
    folders = {setting: file_folder(root, setting) for setting in FILE_FOLDERS.values()}
    strip = strips_paths(root)
    for element in _naming_files(root):
        folder = folders.get(FILE_FOLDERS.get(element.tag, ""), "")
        for attribute in _file_attributes(element):
            name = element.get(attribute).replace("\\", "/")
            if strip and element.tag != "model":
                name = posixpath.basename(name)
            yield Mention(element, attribute, folder, _shortened(posixpath.join(folder, name)))


def reference_in_urdf(element: Any, find: Callable[[str], Path] | None) -> str:
    """What the `filename` of a URDF's mesh or texture means, seen from the URDF's folder.

    `<mujoco><compiler meshdir="..." strippath="..."/></mujoco>` says where MuJoCo finds meshes. What is not there is
    looked for as if it were not said, as ROS does.
    """
    name: str = element.get("filename", "")
    compiler = element.getroottree().getroot().find("mujoco/compiler")
    if find is None or compiler is None or element.tag != "mesh":
        return name
    folder = compiler.get("meshdir", compiler.get("assetdir", ""))
    own = name.strip().replace("\\", "/")
    if compiler.get("strippath") == "true":
        own = posixpath.basename(own)
    elif not _is_plain(own):
        return name
    reference = _shortened(posixpath.join(folder, own))
    try:
        find(reference)
    except AssetError:
        return name
    return reference


def point_beside_includes(root: Any, included: Iterable[tuple[Any, Path]], folder: Path) -> None:
    """Rewrite the names of files that MuJoCo finds beside included files, in place, so that they are found without.

    Args:
        root: The root element of an MJCF whose includes were flattened.
        included: Elements that were in included files, and the folder of that file.
        folder: The folder of the main file.
    """
    strip = strips_paths(root)
    for element, own in included:
        if element.tag not in FILE_FOLDERS and element.tag != "model":
            continue
        start = folder / file_folder(root, FILE_FOLDERS.get(element.tag, ""))
        for attribute in _file_attributes(element):
            name = element.get(attribute).replace("\\", "/")
            beside = Path(os.path.normpath(own / name))
            if not _is_plain(name) or (strip and element.tag != "model"):
                continue
            if _is_file(beside) and not _is_before(element, name, root, folder):
                element.set(attribute, Path(os.path.relpath(beside, start)).as_posix())


def write_out_names(root: Any) -> None:
    """Let the names of files in an MJCF, includes flattened, mean what they say, seen from its folder; in place."""
    for each in list(mentions(root)):
        each.element.set(each.attribute, each.reference)
    drop_file_settings(root)


def take_names_as_written(robot: Any) -> bool:
    """Let the names of files in a URDF mean what they say, seen from its folder; whether they did not before."""
    settled = False
    for compiler in robot.iterfind("mujoco/compiler"):
        for key in set(FILE_SETTINGS) & set(compiler.attrib):
            del compiler.attrib[key]
            settled = True
        compiler.set("strippath", "false")
    return settled


def _naming_files(root: Any) -> Iterator[Any]:
    for element in (*root.iterfind("asset/*"), *root.iterfind("deformable/skin"), *root.iter("flexcomp")):
        if (element.tag in FILE_FOLDERS or element.tag == "model") and reads_file(element):
            yield element


def _is_before(element: Any, name: str, root: Any, folder: Path) -> bool:
    """Whether MuJoCo finds a name before it looks beside the included file; not always where the name then starts."""
    return element.tag != "model" and _is_file(folder / sought_folder(root, element.tag) / name)


def _file_attributes(element: Any) -> list[str]:
    return [key for key in (TEXTURE_FILES if element.tag == "texture" else ("file",)) if element.get(key)]


def _is_plain(name: str) -> bool:
    """Whether a name is a relative path, no URL and no `$(find package)/path`."""
    return not name.startswith("/") and ":" not in name and "$(" not in name


def _shortened(reference: str) -> str:
    return posixpath.normpath(reference) if ":" not in reference and "$(" not in reference else reference


def _is_file(path: Path) -> bool:
    try:
        return Path(os.path.normpath(path)).is_file()
    except (OSError, ValueError):
        return False


def place_of(reference: str) -> PurePosixPath | None:
    """Where a copy of a file has to lie, relative to the description's folder, to be found by `reference`."""
    text = reference.strip().replace("\\", "/")
    package = split_reference(text)
    if package is not None:
        text = posixpath.join(*package)
    path = PurePosixPath(posixpath.normpath(text))
    outside = path.is_absolute() or ".." in path.parts or ":" in path.parts[0]
    return None if outside else path
