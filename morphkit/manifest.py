"""Families on disk: the variants' files, and a `manifest.json` that says where each comes from and what it lost."""

from __future__ import annotations

import hashlib
import json
import math
import shutil
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from pathlib import Path, PurePosixPath
from typing import Any, get_args

from morphkit.ablation import Variant
from morphkit.assets import find_assets
from morphkit.cutting.loss import Loss
from morphkit.description import Description, RobotInfo
from morphkit.errors import DescriptionError, OutputError
from morphkit.io import read
from morphkit.morphology import Base
from morphkit.output import staged_folder

FILE_NAME = "manifest.json"
SCHEMA_VERSION = 1


@dataclass(frozen=True, slots=True)
class ManifestVariant:
    """A variant as a manifest lists it; see `Variant`. `file` is relative to the manifest."""

    name: str
    file: str
    sha256: str
    removed: tuple[str, ...]
    spliced: tuple[str, ...]
    limbs: tuple[str, ...]
    lost: tuple[Loss, ...]


@dataclass(frozen=True, slots=True)
class Manifest:
    """What `manifest.json` says.

    Attributes:
        path: The file.
        tool_version: Version of morphkit that wrote it.
        source_file: Basename of the description that the variants were cut from.
        source_sha256: Its SHA-256, hexadecimal.
        source_format: `urdf` or `mjcf`.
        info: What the variants share: family, task, base, limb types, canonical names.
        variants: The variants in the order of the file.
        assets: SHA-256 of each mesh or texture copied along, by its path relative to the manifest.
    """

    path: Path
    tool_version: str
    source_file: str
    source_sha256: str
    source_format: str
    info: RobotInfo
    variants: tuple[ManifestVariant, ...]
    assets: dict[str, str]


def write_family(source: Description, variants: Iterable[Variant], folder: Path, *, force: bool = False) -> Path:
    """Write variants, the assets that they need, and their manifest into `folder`, in one step.

    An existing folder is replaced where it is empty or holds nothing but an earlier family; a killed run leaves either
    the old folder or the new one, and a failed run leaves everything as it was.

    Args:
        source: The description that the variants were cut from.
        variants: The variants; they may be made lazily.
        folder: Where they go. Folders above it are made.
        force: Replace `folder` whatever it holds.

    Returns:
        Path of the `manifest.json`.

    Raises:
        OutputError: The folder holds other files, cannot be written, or two variants have one name.
    """
    _check_target(folder, source, force)
    with staged_folder(folder) as stage:
        listed: list[ManifestVariant] = []
        assets: dict[str, str] = {}
        taken = {FILE_NAME}
        canonical: dict[str, str] = {}
        for variant in variants:
            file = variant.description.file
            if file.casefold() in taken:
                raise OutputError(f"{folder}: two variants would be written to {file}; give one of them another name")
            taken.add(file.casefold())
            missing = _copy_assets(variant.description, stage, assets)
            (stage / file).write_bytes(variant.description.source)
            listed.append(
                ManifestVariant(
                    variant.description.name,
                    file,
                    variant.description.sha256,
                    variant.removed,
                    variant.spliced,
                    variant.limbs,
                    (*variant.lost, *missing),
                )
            )
            canonical = canonical or variant.description.info.canonical
        info = replace(source.info, canonical=canonical or source.info.canonical)
        text = json.dumps(_to_json(source, info, listed, assets), indent=2, ensure_ascii=False) + "\n"
        (stage / FILE_NAME).write_text(text, encoding="utf-8")
    return folder / FILE_NAME


def read_manifest(path: Path, *, check_files: bool = True) -> Manifest:
    """Read a manifest.

    Args:
        path: The `manifest.json`, or the folder that holds it.
        check_files: Whether every file listed must be there, as it was written.

    Raises:
        DescriptionError: It cannot be read, has another schema version, a key is missing or has a value that makes no
            sense, or a file it lists is missing or was changed.
    """
    path = path / FILE_NAME if path.is_dir() else path
    try:
        data = json.loads(path.read_text("utf-8"))
    except OSError as error:
        raise DescriptionError(f"{path}: cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise DescriptionError(f"{path}: is not JSON: {error}") from error
    found = data.get("schema_version") if isinstance(data, dict) else None
    if found != SCHEMA_VERSION:
        raise DescriptionError(
            f"{path}: schema_version is {found!r}, expected {SCHEMA_VERSION}; write the family again with this version"
            " of morphkit ablate"
        )
    try:
        manifest = _from_json(path, data)
    except KeyError as error:
        raise DescriptionError(
            f"{path}: key {error} is missing; write the family again with morphkit ablate"
        ) from error
    except (TypeError, ValueError, AttributeError) as error:
        raise DescriptionError(f"{path}: makes no sense: {error}") from error
    if check_files:
        for file, sha256 in _files(manifest).items():
            _check_file(path.parent / file, sha256, path)
    return manifest


def _files(manifest: Manifest) -> dict[str, str]:
    return {**{variant.file: variant.sha256 for variant in manifest.variants}, **manifest.assets}


def _check_file(file: Path, sha256: str, listing: Path) -> None:
    if not file.is_file():
        raise DescriptionError(f"{file}: is missing, but {listing.name} lists it; write the family again")
    if hashlib.sha256(file.read_bytes()).hexdigest() != sha256:
        raise DescriptionError(
            f"{file}: its SHA-256 is not the one in {listing.name}: it was changed after the cut; write the family"
            " again, or load the file alone"
        )


def _check_target(folder: Path, source: Description, force: bool) -> None:
    """Refuse to replace what is not an earlier, unchanged family."""
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise OutputError(f"{folder}: exists and is no folder; choose another output folder")
    if not folder.exists():
        return
    kept = [Path.cwd(), Path.home(), *([source.folder] if source.folder is not None else [])]
    if any(path.resolve().is_relative_to(folder.resolve()) for path in kept):
        raise OutputError(
            f"{folder}: is or holds the current folder, the home folder or the robot itself; choose another"
        )
    if force:
        return
    present = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_symlink() or path.is_file()}
    if not present and not any(folder.iterdir()):
        return
    advice = "choose another folder, or replace it with --force"
    if FILE_NAME not in present:
        raise OutputError(f"{folder}: holds other files, such as {min(present, default='a folder')}; {advice}")
    try:
        listed = _files(read_manifest(folder))
    except DescriptionError as error:
        raise OutputError(f"{folder}: holds no unchanged family: {error}; {advice}") from error
    others = sorted(present - {FILE_NAME, *listed})
    if others:
        raise OutputError(f"{folder}: holds other files, such as {others[0]}; {advice}")


def _copy_assets(description: Description, stage: Path, copied: dict[str, str]) -> list[Loss]:
    """Copy what `description` refers to into `stage`; return what is missing."""
    lost = []
    for asset in find_assets(description):
        if asset.path is None or asset.place is None:
            lost.append(Loss("asset", asset.reference, "", asset.problem))
        elif asset.place.as_posix() not in copied:
            target = stage / asset.place
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(asset.path, target)
            copied[asset.place.as_posix()] = hashlib.sha256(target.read_bytes()).hexdigest()
    return lost


def _to_json(
    source: Description, info: RobotInfo, variants: list[ManifestVariant], assets: Mapping[str, str]
) -> dict[str, Any]:
    shared: dict[str, Any] = {
        "type_words": [list(group) for group in info.type_words],
        "type_matched_in": info.type_matched_in,
        "canonical": info.canonical,
    }
    if info.healthy_height is not None:
        shared["healthy_height"] = [value if math.isfinite(value) else None for value in info.healthy_height]
    data: dict[str, Any] = {
        "schema_version": SCHEMA_VERSION,
        "tool_version": version("morphkit"),
        "source": {"file": source.file, "sha256": source.sha256, "format": source.format},
        "family": info.family,
        "task": info.task,
        "base": info.base or read(source).base,
        "info": shared,
        "variants": [asdict(variant) for variant in variants],
    }
    if assets:
        data["assets"] = [{"file": file, "sha256": sha256} for file, sha256 in sorted(assets.items())]
    return data


def _from_json(path: Path, data: Mapping[str, Any]) -> Manifest:
    shared, source, base = data["info"], data["source"], data["base"]
    if base is not None and base not in get_args(Base):
        raise ValueError(f"base is {base!r}, expected one of {', '.join(get_args(Base))}")
    if shared["type_matched_in"] not in ("body", "joint"):
        raise ValueError(f"type_matched_in is {shared['type_matched_in']!r}, expected body or joint")
    height = shared.get("healthy_height")
    info = RobotInfo(
        family=data["family"],
        type_words=tuple(tuple(group) for group in shared["type_words"]),
        type_matched_in=shared["type_matched_in"],
        canonical=dict(shared["canonical"]),
        task=data["task"],
        base=base,
        healthy_height=None if height is None else _height(*height),
    )
    return Manifest(
        path=path,
        tool_version=data["tool_version"],
        source_file=source["file"],
        source_sha256=source["sha256"],
        source_format=source["format"],
        info=info,
        variants=tuple(_variant(entry) for entry in data["variants"]),
        assets={_inside(entry["file"]): entry["sha256"] for entry in data.get("assets", [])},
    )


def _variant(entry: Mapping[str, Any]) -> ManifestVariant:
    return ManifestVariant(
        name=entry["name"],
        file=_inside(entry["file"]),
        sha256=entry["sha256"],
        removed=tuple(entry["removed"]),
        spliced=tuple(entry["spliced"]),
        limbs=tuple(entry["limbs"]),
        lost=tuple(Loss(**loss) for loss in entry["lost"]),
    )


def _inside(file: str) -> str:
    path = PurePosixPath(file)
    if path.is_absolute() or ".." in path.parts or not path.parts:
        raise ValueError(f"file {file!r} lies outside the manifest's folder")
    return file


def _height(low: float | None, high: float | None) -> tuple[float, float]:
    return (-math.inf if low is None else float(low), math.inf if high is None else float(high))
