"""Families on disk: variants are written as they come, then their `manifest.json`, and all appear in one step."""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, TextIO

from morphkit.ablation.ablate import Variant
from morphkit.ablation.loss import Loss
from morphkit.description import Description, RobotInfo
from morphkit.errors import DescriptionError, OutputError
from morphkit.families.assets import AssetMode, Packer
from morphkit.families.build import FailedVariant, Made, MirroredVariant, servo_gains
from morphkit.families.manifest import FILE_NAME, SCHEMA_VERSION, ManifestVariant, listed_files, read_manifest
from morphkit.readers import read
from morphkit.scaling.scale import scaled_gains, scaled_start
from morphkit.utils.staging import clear_leftovers, staged_folder


def write_family(
    source: Description,
    variants: Iterable[Made],
    folder: Path | str,
    *,
    force: bool = False,
    assets: AssetMode = "copy",
    notes: Sequence[str] = (),
) -> Path:
    """Write variants, the assets that they need, and their manifest into `folder`, in one step.

    An existing folder is replaced where it is empty or holds nothing but an earlier family; a killed run leaves either
    the old folder or the new one, and a failed run leaves everything as it was.

    Args:
        source: The description that the variants were cut from. The manifest has the gains of its servos, so that what
            a limb loses changes no gain of the rest.
        variants: The variants; they may be made lazily, and are written as they come.
        folder: Where they go. Folders above it are made.
        force: Replace `folder` whatever it holds.
        assets: Whether meshes and textures are copied, so that the folder can be moved, or referred to where they are.
        notes: Sentences for the manifest.

    Returns:
        Path of the `manifest.json`.

    Raises:
        OutputError: The folder holds other files, cannot be written, or two variants have one name.
    """
    folder = Path(folder)
    gains, morphology = servo_gains(source), read(source)
    source = replace(source, info=replace(source.info, gains=gains))
    source.keep(morphology=morphology)
    clear_leftovers(folder.absolute())
    _check_target(folder, source, force)
    with staged_folder(folder) as stage:
        rest: dict[str, list[Any]] = {"failed": [], "mirrored": []}
        taken = {FILE_NAME}
        packer = Packer(folder, stage, assets, taken)
        with _open_manifest(stage, source) as listing:
            for variant in variants:
                if isinstance(variant, FailedVariant):
                    rest["failed"].append(asdict(variant))
                elif isinstance(variant, MirroredVariant):
                    rest["mirrored"].append(asdict(variant))
                else:
                    file = variant.description.file
                    if file.casefold() in taken or (stage / file).exists():
                        what = "two variants" if file.casefold() in taken else "a variant and an asset"
                        raise OutputError(f"{folder}: {what} would be written to {file}; give one of them another name")
                    taken.add(file.casefold())
                    content, missing = packer.pack(variant.description)
                    (stage / file).write_bytes(content)
                    listing.add(variant, content, missing)
            files = [{"file": file, "sha256": sha256} for file, sha256 in sorted(packer.files.items())]
            listing.close({"assets" if assets == "copy" else "references": files, **rest, "notes": list(notes)})
    return folder / FILE_NAME


class _Listing:
    """A manifest that is written as its variants come, so that thousands of them need no memory."""

    def __init__(self, out: TextIO, source: Description) -> None:
        self._out, self._source = out, source
        self._morphology = read(source)
        self._begun = False
        self._comma = ""

    def add(self, variant: Variant, content: bytes, missing: Sequence[Loss]) -> None:
        self._begin(variant.description.info)
        entry = ManifestVariant(
            variant.description.name,
            variant.description.file,
            hashlib.sha256(content).hexdigest(),
            variant.removed,
            variant.spliced,
            variant.limbs,
            (*variant.lost, *missing),
            variant.scaled,
            scaled_gains(self._source.info, self._morphology, variant.scaled),
            self._own_start(variant),
        )
        self._out.write(self._comma + "\n    " + _dump(entry.as_json()).replace("\n", "\n    "))
        self._comma = ","

    def close(self, rest: Mapping[str, Sequence[Any]]) -> None:
        """Write the keys after the variants; empty ones are left out."""
        self._begin(self._source.info)
        self._out.write("\n  ]" if self._comma else "]")
        for key, value in rest.items():
            if value:
                self._out.write(f',\n  "{key}": ' + _dump(value).replace("\n", "\n  "))
        self._out.write("\n}\n")

    def _own_start(self, variant: Variant) -> dict[str, float]:
        """Where the joints of a variant start, if scaling made that another place than the source's."""
        start = scaled_start(self._source.info, self._morphology, variant.scaled)
        return start if isinstance(start, dict) and start != self._source.info.start else {}

    def _begin(self, names: RobotInfo) -> None:
        if not self._begun:
            own = self._source.info
            info = replace(own, canonical=names.canonical or own.canonical, labels=names.labels or own.labels)
            self._out.write(_dump(_head(self._source, info)).removesuffix("\n}") + ',\n  "variants": [')
            self._begun = True


@contextmanager
def _open_manifest(stage: Path, source: Description) -> Iterator[_Listing]:
    with (stage / FILE_NAME).open("w", encoding="utf-8") as out:
        yield _Listing(out, source)


def _dump(value: Any) -> str:
    return json.dumps(value, indent=2, ensure_ascii=False)


def _check_target(folder: Path, source: Description, force: bool) -> None:
    """Refuse to replace what is not an earlier, unchanged family."""
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise OutputError(f"{folder}: exists and is no folder; choose another output folder")
    if not folder.exists():
        return
    kept = [Path.cwd(), *([source.folder] if source.folder is not None else [])]
    with contextlib.suppress(RuntimeError):  # The user has no home, as containers may have it.
        kept.append(Path.home())
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
        listed = listed_files(read_manifest(folder))
    except DescriptionError as error:
        raise OutputError(f"{folder}: holds no unchanged family: {error}; {advice}") from error
    others = sorted(present - {FILE_NAME, *listed})
    if others:
        raise OutputError(f"{folder}: holds other files, such as {others[0]}; {advice}")


def _head(source: Description, info: RobotInfo) -> dict[str, Any]:
    """The keys of a manifest before its variants."""
    shared: dict[str, Any] = {
        "type_words": [list(group) for group in info.type_words],
        "type_matched_in": info.type_matched_in,
        "canonical": info.canonical,
    }
    if info.labels:
        shared["labels"] = info.labels
    if info.start:
        shared["start"] = info.start
    if info.actuation is not None:
        shared["actuation"] = info.actuation
    if info.gains:
        shared["gains"] = {joint: list(gains) for joint, gains in info.gains.items()}
    for key in ("action_scale", "control_frequency"):
        if getattr(info, key) is not None:
            shared[key] = getattr(info, key)
    if info.healthy_height is not None:
        shared["healthy_height"] = [value if math.isfinite(value) else None for value in info.healthy_height]
    return {
        "schema_version": SCHEMA_VERSION,
        "tool_version": version("morphkit"),
        "source": {"file": source.file, "sha256": source.sha256, "format": source.format},
        "family": info.family,
        "task": info.task,
        "base": info.base or read(source).base,
        "info": shared,
    }
