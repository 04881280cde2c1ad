"""A conversion on disk: the MJCF and a folder of meshes beside it, written together or not at all."""

from __future__ import annotations

import shutil
import tempfile
from importlib.metadata import version
from pathlib import Path

import mujoco

from morphkit.conversion.converting import Conversion
from morphkit.errors import DescriptionError, OutputError
from morphkit.output import staged_folder


def asset_folder(path: Path) -> Path:
    """Where the meshes of the MJCF `path` go."""
    return path.with_name(f"{path.stem}_assets")


def write_conversion(conversion: Conversion, path: Path, *, force: bool = False) -> list[Path]:
    """Write the MJCF and its meshes; the meshes lie in `NAME_assets` beside it.

    Both are written under other names first, and MuJoCo compiles them there; then they take their places.

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
    spec, assets = conversion.spec, dict(conversion.spec.assets)
    spec.modelname = conversion.description.name
    spec.meshdir = folder.name if assets else ""
    # Keep numbers at full precision.
    spec.compiler.savecompiled = False
    spec.compiler.savecanonical = False
    source = conversion.description
    head = f"<!-- Made of {_safe(source.file)} (sha256 {source.sha256}) by morphkit {version('morphkit')}. -->\n"
    text = head + spec.to_xml()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{path.stem[:60]}-", dir=path.parent) as stage:
            staged = Path(stage) / path.name
            staged.write_text(text, encoding="utf-8")
            if assets:
                (Path(stage) / folder.name).mkdir()
            for name, content in assets.items():
                (Path(stage) / folder.name / name).write_bytes(content)
            _compile(staged)
            if assets:
                with staged_folder(folder) as final:
                    shutil.copytree(staged.parent / folder.name, final, dirs_exist_ok=True)
            staged.replace(path)
    except OSError as error:
        if isinstance(error, OutputError):
            raise
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from error
    return [path, *(folder / name for name in assets)]


def check_target(path: Path, *, force: bool) -> None:
    """Refuse a place where something is that must not be overwritten.

    Raises:
        OutputError: `path` is a folder or no .xml; or it or its folder of meshes is there and `force` is False.
    """
    if path.is_dir():
        raise OutputError(f"{path}: is a folder; give the name of the MJCF file, such as {path / 'robot.xml'}")
    if path.suffix != ".xml":
        raise OutputError(f"{path}: an MJCF file is called .xml; give {path.with_suffix('.xml')}")
    for place in (path, asset_folder(path)):
        if place.exists() and not force:
            raise OutputError(f"{place}: exists; --force replaces it")


def _compile(path: Path) -> None:
    try:
        mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise DescriptionError(f"MuJoCo cannot read what was written: {' '.join(str(error).split())}") from error


def _safe(name: str) -> str:
    return name.replace("--", "- -")
