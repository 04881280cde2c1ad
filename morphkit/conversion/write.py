"""A conversion on disk: the MJCF and a folder of meshes next to it, written together or not at all."""

from __future__ import annotations

import json
import re
import shutil
from importlib.metadata import version
from pathlib import Path

import mujoco

from morphkit.conversion.convert import Conversion, ConversionReport, convert
from morphkit.description import Description
from morphkit.errors import DescriptionError, OutputError
from morphkit.formats.isolation import compiling, isolated
from morphkit.morphology import Base
from morphkit.utils import staging
from morphkit.utils.plain_files import read_plain
from morphkit.utils.printable import one_line
from morphkit.utils.staging import in_turn, require_text, stage

_PLACED = "placed"  # in a stage: names of the mesh files that are moved from there
_MESH_NAME = re.compile(r"[\w.-]*-[0-9a-f]{8,64}[\w.-]*")  # see `convert._name_meshes`


def asset_folder(path: Path) -> Path:
    """Where the meshes of the MJCF `path` go."""
    return path.with_name(f"{path.stem}_assets")


def convert_to(
    path: Path, description: Description, *, base: Base | None = None, floor: bool | None = None, force: bool = False
) -> tuple[ConversionReport, list[Path]]:
    """Convert a URDF and write it; in a process of its own, with limits on memory and time, where that may cost much.

    Args:
        path: The MJCF.
        description: The URDF.
        base: As `convert`.
        floor: As `convert`.
        force: As `write_conversion`.

    Returns:
        What was done, and the files written, the MJCF first.

    Raises:
        DescriptionError: As `convert`, or the limits did not suffice.
        AssetError: As `convert`.
        ConfigError: As `convert`.
        OutputError: As `write_conversion`.
    """
    check_target(path, force=force)
    options = {"path": path, "base": base, "floor": floor, "force": force}
    return isolated(_convert_to, description, compiling(description), **options)


def _convert_to(
    description: Description, *, path: Path, base: Base | None, floor: bool | None, force: bool
) -> tuple[ConversionReport, list[Path]]:
    conversion = convert(description, base=base, floor=floor)
    return conversion.report(), write_conversion(conversion, path, force=force)


def write_conversion(conversion: Conversion, path: Path, *, force: bool = False) -> list[Path]:
    """Write the MJCF and its meshes; the meshes lie in `NAME_assets` next to it.

    Both are written under other names first, and MuJoCo compiles them there; then they take their places. A killed run
    leaves the old model or the new one, each with its meshes.

    Args:
        conversion: What to write.
        path: The MJCF.
        force: Whether what is there may be replaced: the file, and the folder of meshes with all it holds.

    Returns:
        The files written, the MJCF first.

    Raises:
        OutputError: Something is there already, or it cannot be written.
    """
    check_target(path, force=force)
    folder = asset_folder(path)
    spec = conversion.spec
    assets = {mesh.file: spec.assets[mesh.file] for mesh in spec.meshes if mesh.file}
    spec.modelname = one_line(conversion.description.name)  # XML holds no control characters
    spec.meshdir = folder.name if assets else ""
    # Keep numbers at full precision.
    spec.compiler.savecompiled = False
    spec.compiler.savecanonical = False
    source = conversion.description
    head = f"<!-- Made of {_safe(source.file)} (sha256 {source.sha256}) by morphkit {version('morphkit')}. -->\n"
    text = head + spec.to_xml()
    try:
        with stage(path) as own:
            staged, meshes = own / path.name, own / folder.name
            staged.write_text(text, encoding="utf-8")
            meshes.mkdir()
            for name, content in assets.items():
                (meshes / name).write_bytes(content)
            _compile(staged)
            with in_turn(path.parent):
                _put(staged, meshes, path, force=force)
    except OSError as error:
        if isinstance(error, OutputError):
            raise
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from error
    return [path, *(folder / name for name in assets)]


def _put(staged: Path, meshes: Path, path: Path, *, force: bool) -> None:
    """Move what is staged to its place, so that at every moment the MJCF there finds its meshes.

    The name of a mesh file changes with its content: new ones can go next to old ones first, and old ones go last.
    """
    folder = asset_folder(path)
    names = {mesh.name for mesh in meshes.iterdir()}
    new = sorted(name for name in names if not _same(meshes / name, folder / name))
    (staged.parent / _PLACED).write_text(json.dumps(new), encoding="utf-8")
    try:
        if names and not folder.exists():
            meshes.rename(folder)
        else:
            for name in new:
                (meshes / name).replace(folder / name)
        staged.replace(path)
    except OSError:
        _take_back(staged.parent, path)
        raise
    if force and folder.is_dir():
        for left in folder.iterdir():
            if left.name not in names:
                _remove(left)
        if not names:
            folder.rmdir()


def _take_back(own: Path, path: Path) -> None:
    """Remove the meshes that were placed from the stage `own`, but those that the MJCF at `path` names."""
    folder = asset_folder(path)
    if folder.is_symlink() or not (own / _PLACED).is_file():
        return
    text = path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""
    for name in _placed(own):
        if f'"{name}"' not in text:
            (folder / name).unlink(missing_ok=True)
    if folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()


def _placed(own: Path) -> list[str]:
    """Names in the list of a stage, which may be anybody's: only those that `convert` gives to meshes."""
    try:
        names = json.loads(read_plain(own / _PLACED))
    except (OSError, ValueError, RecursionError):
        return []
    found = names if isinstance(names, list) else []
    return [name for name in found if isinstance(name, str) and _MESH_NAME.fullmatch(name)]


def _same(first: Path, second: Path) -> bool:
    return second.is_file() and not second.is_symlink() and first.read_bytes() == second.read_bytes()


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink()


def clear_leftovers(path: Path) -> None:
    """Remove what killed conversions to `path` left."""

    def undo(own: Path) -> None:
        with in_turn(path.parent):
            _take_back(own, path)

    staging.clear_leftovers(path, undo)


def check_target(path: Path, *, force: bool) -> None:
    """Refuse a place where something is that must not be overwritten.

    Raises:
        OutputError: `path` is a folder, no .xml or no UTF-8 text; or it or its folder of meshes is there and `force` is
            False.
    """
    require_text(path)
    if path.is_dir():
        raise OutputError(f"{path}: is a folder; give the name of the MJCF file, such as {path / 'robot.xml'}")
    if path.suffix != ".xml":
        raise OutputError(f"{path}: an MJCF file is called .xml; give {path.with_suffix('.xml')}")
    clear_leftovers(path)
    folder = asset_folder(path)
    for place in (path, folder):
        if place.exists() and not force:
            raise OutputError(f"{place}: exists; --force replaces it")
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise OutputError(f"{folder}: is no folder, and the meshes would go there; remove it or choose another name")


def _compile(path: Path) -> None:
    try:
        mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise DescriptionError(f"MuJoCo cannot read what was written: {' '.join(str(error).split())}") from error


def _safe(name: str) -> str:
    """`name` as a comment may hold it: without `--`, and control characters written out."""
    return one_line(name).replace("--", "- -")
