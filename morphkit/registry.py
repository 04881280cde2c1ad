"""Where robots come from: the ones that ship with morphkit, by name, and description files on disk."""

from __future__ import annotations

import importlib.resources
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from morphkit.description import Description, RobotInfo
from morphkit.errors import ConfigError, DescriptionError, MorphkitError, UnknownNameError
from morphkit.robot_toml import FILE_NAME, Recipe, RobotToml, read_robot_toml
from morphkit.utils.suggest import did_you_mean, nearest

if TYPE_CHECKING:
    from morphkit.formats.document import Document

MANIFEST = "manifest.json"
_SUFFIXES = (".urdf", ".xml")
_READABLE = (*_SUFFIXES, ".xacro", ".json")
_NO_PACKAGES: Mapping[str, Path] = MappingProxyType({})
_NO_ARGUMENTS: Mapping[str, str] = MappingProxyType({})


def load(
    target: str | Path,
    *,
    root: str | None = None,
    packages: Mapping[str, Path] = _NO_PACKAGES,
    xacro_args: Mapping[str, str] = _NO_ARGUMENTS,
    trust_xacro: bool = False,
) -> Description:
    """Load one robot.

    Args:
        target: Name of a shipped robot (`cheetah`) or of one of its recipes (`cheetah_3_balanced`, cut from the full
            robot in memory); else the path of a `.urdf`, `.xml` or `.xacro` file, of a folder with a `robot.toml`, or
            of a family (a `manifest.json` or its folder) of a single variant.
        root: Top-level body or link to take where the file has several.
        packages: Folder of each ROS package or Gazebo model that the file refers to, by name; see `io.packages`.
        xacro_args: Values of a xacro file's arguments, by name.
        trust_xacro: Whether a xacro file may do all that the library lets it do.

    Returns:
        The description. It holds what a `robot.toml` or `manifest.json` in the same folder says of the file.

    Raises:
        UnknownNameError: There is no such robot and no such file; the message names the nearest.
        DescriptionError: The file is empty, not XML, or neither URDF nor MJCF, or its `robot.toml` or manifest is
            damaged.
        DependencyError: A xacro file, and the library that expands it is not installed.
        ConfigError: There are `xacro_args`, and the file is no xacro file.
    """
    found = load_all(target, root=root, packages=packages, xacro_args=xacro_args, trust_xacro=trust_xacro)
    if len(found) != 1:
        names = ", ".join(description.name for description in found)
        raise DescriptionError(f"{target}: holds {len(found)} robots where one is expected; give one file of: {names}")
    return found[0]


def load_all(
    target: str | Path,
    *,
    root: str | None = None,
    packages: Mapping[str, Path] = _NO_PACKAGES,
    xacro_args: Mapping[str, str] = _NO_ARGUMENTS,
    trust_xacro: bool = False,
) -> list[Description]:
    """Load one robot, or all variants of a family.

    Args:
        target: As in `load`; a folder with a `manifest.json`, or that file, gives all its variants in its order, a
            folder of description files gives them all, sorted by file name.
        root: As in `load`.
        packages: As in `load`.
        xacro_args: As in `load`.
        trust_xacro: As in `load`.

    Returns:
        At least one description.

    Raises:
        UnknownNameError: There is no such robot and no such file.
        DescriptionError: A file is not what it says, or differs from the SHA-256 in its manifest.
        ConfigError: As in `load`.
    """
    if xacro_args and not is_xacro(target):
        raise ConfigError(f"{target}: is no .xacro file, and only those have arguments for --xacro-arg")
    tomls = _shipped_tomls()
    if str(target) in tomls:
        return [_full(tomls[str(target)], root)]
    for toml in tomls.values():
        if str(target) in toml.recipes:
            return [_cut(_full(toml, root), str(target), toml.recipes[str(target)])]
    path = Path(target)
    try:
        if not path.exists():
            raise _unknown(path, tomls)
        if is_xacro(path) and path.is_file():
            return [_expand(path, root, packages, xacro_args, trust_xacro)]
        return [
            replace(description, packages={**description.packages, **packages})
            for description in _load_path(path, root)
        ]
    except OSError as error:
        if isinstance(error, MorphkitError):
            raise
        raise DescriptionError(f"{error.filename or target}: cannot be read: {error.strerror}") from error


def is_xacro(target: str | Path) -> bool:
    """Whether `target` is expanded before it is read, going by its name."""
    return Path(target).suffix == ".xacro"


def shipped() -> list[Description]:
    """The full robots that ship with morphkit, sorted by name."""
    return [_full(toml, None) for _, toml in sorted(_shipped_tomls().items())]


def recipes(robot: str) -> tuple[str, ...]:
    """Names of the variants of shipped robot `robot` that its `robot.toml` names; each works in `load`.

    Raises:
        UnknownNameError: No robot of that name ships with morphkit.
    """
    tomls = _shipped_tomls()
    if robot not in tomls:
        raise _unknown(Path(robot), tomls)
    return tuple(tomls[robot].recipes)


def _shipped_tomls() -> dict[str, RobotToml]:
    """Every shipped `robot.toml`, by the name of its folder, which is the robot's."""
    folder = Path(str(importlib.resources.files("morphkit_robots")))
    return {path.parent.name: read_robot_toml(path) for path in sorted(folder.glob(f"*/{FILE_NAME}"))}


def _full(toml: RobotToml, root: str | None) -> Description:
    path = toml.path.parent / toml.file
    if not path.is_file():
        raise DescriptionError(f"{toml.path}: its file {toml.file!r} does not exist")
    description = _describe(path, path.stem, toml.info, root)
    if isinstance(toml.info.start, dict):
        _check_start(toml, description)
    return description


def _check_start(toml: RobotToml, description: Description) -> None:
    """Refuse coordinates of joints that the robot does not have."""
    from morphkit.readers import read

    joints = [joint.name for joint in read(description).joints if joint.kind in ("hinge", "slide")]
    for name in toml.info.start:
        if name not in joints:
            raise DescriptionError(
                f"{toml.path}: start: there is no hinge or slide {name!r} in {toml.file}{did_you_mean(name, joints)}"
            )


def _cut(full: Description, name: str, recipe: Recipe) -> Description:
    """Make a recipe's variant out of the full robot."""
    variant = full
    if recipe.remove or recipe.splice:
        from morphkit.ablation.ablate import ablate

        variant = ablate(full, remove=recipe.remove, splice=recipe.splice, name=name).description
    if recipe.root_height is not None:
        from morphkit.ablation.ablate import set_root_height

        variant = set_root_height(variant, recipe.root_height)
    info = replace(
        variant.info,
        healthy_height=recipe.healthy_height or full.info.healthy_height,
        expert_return=recipe.expert_return,
    )
    return replace(variant, name=name, file=name + Path(full.file).suffix, info=info)


def _load_path(path: Path, root: str | None) -> list[Description]:
    if path.is_dir():
        return _load_folder(path, root)
    if path.name == MANIFEST:
        return _load_family(path, root)
    if path.name == FILE_NAME:
        return _load_folder(path.parent, root)
    return [_load_file(path, root)]


def _load_folder(folder: Path, root: str | None) -> list[Description]:
    if (folder / FILE_NAME).is_file():
        return [_full(read_robot_toml(folder / FILE_NAME), root)]
    if (folder / MANIFEST).is_file():
        return _load_family(folder / MANIFEST, root)
    files = sorted(path for path in folder.iterdir() if path.suffix in _SUFFIXES and path.is_file())
    if not files:
        raise DescriptionError(f"{folder}: holds no {FILE_NAME}, no {MANIFEST} and no .urdf or .xml file")
    return [_describe(path, path.stem, RobotInfo(), root) for path in files]


def _load_file(path: Path, root: str | None) -> Description:
    """Load a description file together with what a `robot.toml` or a manifest next to it says about it."""
    beside = path.parent / FILE_NAME
    if beside.is_file():
        toml = read_robot_toml(beside)
        if toml.file == path.name:
            return _full(toml, root)
    from morphkit.families.manifest import find_listed

    listed = find_listed(path)
    if listed is not None:
        manifest, variant = listed
        return replace(_describe(path, variant.name, manifest.info_of(variant), root), packages=manifest.readable())
    return _describe(path, path.stem, RobotInfo(), root)


def _load_family(path: Path, root: str | None) -> list[Description]:
    """Load every variant that a manifest lists; each file must be the one that was written with it."""
    from morphkit.families.manifest import read_manifest

    manifest = read_manifest(path)
    if not manifest.variants:
        raise DescriptionError(f"{path}: lists no variants")
    files = manifest.readable()
    return [
        replace(_describe(path.parent / each.file, each.name, manifest.info_of(each), root), packages=files)
        for each in manifest.variants
    ]


def _describe(path: Path, name: str, info: RobotInfo, root: str | None) -> Description:
    """Read a file and tell its format from its root element."""
    from morphkit.formats.document import Document
    from morphkit.formats.xml import read_limited

    if not path.is_file():
        raise DescriptionError(f"{path}: is no regular file")
    document = Document(read_limited(path), file=str(path))
    names = _printable(name), _printable(path.name)
    info = _started(info, path, document)
    return Description(*names, document.format, document.source, path.parent, info, root, document=document)


def _started(info: RobotInfo, path: Path, document: Document) -> RobotInfo:
    """`info` with the start pose that an SRDF next to a URDF says."""
    from morphkit.formats.srdf import start_state

    return replace(info, start=start_state(path, document, info.start)) if document.format == "urdf" else info


def _expand(
    path: Path, root: str | None, packages: Mapping[str, Path], xacro_args: Mapping[str, str], trusted: bool
) -> Description:
    """The URDF that a xacro file describes."""
    from morphkit.formats import xacro
    from morphkit.formats.document import Document

    source = xacro.expand(path, packages, xacro_args, trusted=trusted)
    file = path.name.removesuffix(".xacro").removesuffix(".urdf") + ".urdf"
    document = Document(source, file=f"{path} (expanded)")
    name, file = _printable(Path(file).stem), _printable(file)
    info = _started(RobotInfo(), path, document)
    return Description(
        name, file, document.format, source, path.parent, info, root=root, packages=packages, document=document
    )


def _printable(name: str) -> str:
    """A file's name without what is no UTF-8, which could be neither printed nor written."""
    return name.encode(errors="surrogateescape").decode(errors="replace")


def _unknown(path: Path, tomls: Mapping[str, RobotToml]) -> UnknownNameError:
    """The error for a robot that is neither shipped nor on disk."""
    if path.suffix or len(path.parts) > 1:
        return UnknownNameError(f"{path}: no such file{_nearest_file(path)}")
    names = [*tomls, *(name for toml in tomls.values() for name in toml.recipes)]
    return UnknownNameError(
        f"{path}: no such robot or file{_nearest_file(path) or did_you_mean(path.stem, names)}\n"
        f"  shipped robots: {', '.join(tomls)}; give one of their names, or the path of a .urdf or .xml file"
    )


def _nearest_file(path: Path) -> str:
    """`; did you mean 'folder/robot.urdf'?` with a description or a folder beside a path that does not exist."""
    if not path.parent.is_dir():
        return f": there is no folder {path.parent}"
    beside = {entry.name: entry for entry in path.parent.iterdir() if entry.suffix in _READABLE or entry.is_dir()}
    near = nearest(path.name, beside)
    return f"; did you mean {str(beside[near])!r}?" if near else ""
