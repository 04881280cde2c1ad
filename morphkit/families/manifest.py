"""Families on disk: the variants' files, and a `manifest.json` that says where each comes from and what it lost."""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path, PurePosixPath
from typing import Any, get_args

from morphkit.ablation.limb_scale import LimbScale
from morphkit.ablation.loss import Loss
from morphkit.description import Actuation, RobotInfo
from morphkit.errors import DescriptionError
from morphkit.families.build import FailedVariant, MirroredVariant
from morphkit.morphology import Base
from morphkit.utils.plain_files import read_plain, require_plain_way

FILE_NAME = "manifest.json"
SCHEMA_VERSION = 1


@dataclass(frozen=True, slots=True)
class ManifestVariant:
    """A variant as a manifest lists it; see `Variant`.

    Attributes:
        name: Its name.
        file: Its file, relative to the manifest.
        sha256: The file's SHA-256, hexadecimal.
        removed: As in `Variant`.
        spliced: As in `Variant`.
        limbs: As in `Variant`.
        lost: As in `Variant`.
        scaled: Factors of each limb that was scaled.
        gains: Stiffness and damping of the servos of limbs that are stronger than in the source, by joint.
        start: Where joints start, where that is not as in the source; see `RobotInfo.start`.
    """

    name: str
    file: str
    sha256: str
    removed: tuple[str, ...]
    spliced: tuple[str, ...]
    limbs: tuple[str, ...]
    lost: tuple[Loss, ...]
    scaled: Mapping[str, LimbScale] = field(default_factory=dict)
    gains: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    start: Mapping[str, float] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """What is written of it: the last three only where they hold something."""
        entry = asdict(self)
        return {key: value for key, value in entry.items() if value or key not in ("scaled", "gains", "start")}


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
        references: SHA-256 of each mesh or texture that was left where it is, by its path relative to the manifest.
        failed: Variants that could not be made.
        mirrored: Variants left out as mirror images of others.
        notes: What else there is to know, such as why the variants were not compiled.
    """

    path: Path
    tool_version: str
    source_file: str
    source_sha256: str
    source_format: str
    info: RobotInfo
    variants: tuple[ManifestVariant, ...]
    assets: dict[str, str]
    references: dict[str, str] = field(default_factory=dict)
    failed: tuple[FailedVariant, ...] = ()
    mirrored: tuple[MirroredVariant, ...] = ()
    notes: tuple[str, ...] = ()

    def info_of(self, variant: ManifestVariant) -> RobotInfo:
        """What is known of a variant besides its file."""
        shared = {joint: gains for joint, gains in self.info.gains.items() if joint not in variant.gains}
        start = dict(variant.start) or self.info.start
        return replace(self.info, gains={**variant.gains, **shared}, start=start)  # the first that matches counts

    def readable(self) -> dict[str, Path]:
        """The files outside the manifest's folder that its variants may read, for `Description.packages`.

        Only files that are what they were when the manifest was written, so that a manifest from a stranger opens no
        others.
        """
        found = {}
        for number, (place, sha256) in enumerate(self.references.items()):
            path = Path(os.path.normpath(self.path.absolute().parent / place))
            if path.is_file() and hashlib.sha256(path.read_bytes()).hexdigest() == sha256:
                found[f"asset {number}"] = path
        return found


def read_manifest(path: Path, *, check_files: bool = True) -> Manifest:
    """Read a manifest.

    Args:
        path: The `manifest.json`, or the folder that holds it.
        check_files: Whether every file listed must be there, as it was written.

    Raises:
        DescriptionError: It cannot be read, has another schema version, a key is missing or has a value that makes no
            sense, or a file it lists is missing, was changed, or is reached through a link.
    """
    path = path / FILE_NAME if path.is_dir() else path
    require_plain_way(path, DescriptionError)
    try:
        data = json.loads(read_plain(path))
    except OSError as error:
        raise DescriptionError(f"{path}: cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
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
        for file, sha256 in listed_files(manifest).items():
            _check_file(path.parent / file, sha256, path)
    return manifest


def find_listed(file: Path) -> tuple[Manifest, ManifestVariant] | None:
    """The manifest next to a description file and what it lists it as; None where none lists it.

    Raises:
        DescriptionError: The manifest is damaged; one of another program is not.
    """
    listing = file.parent / FILE_NAME
    if not listing.is_file():
        return None
    try:
        manifest = read_manifest(listing, check_files=False)
    except DescriptionError:
        if b'"variants"' in listing.read_bytes():
            raise
        return None
    return next(((manifest, each) for each in manifest.variants if each.file == file.name), None)


def listed_files(manifest: Manifest) -> dict[str, str]:
    """SHA-256 of each file in the manifest's folder, by its path there."""
    return {**{variant.file: variant.sha256 for variant in manifest.variants}, **manifest.assets}


def _check_file(file: Path, sha256: str, listing: Path) -> None:
    require_plain_way(file, DescriptionError, top=listing.parent)
    if not file.is_file():
        raise DescriptionError(f"{file}: is missing, but {listing.name} lists it; write the family again")
    if hashlib.sha256(file.read_bytes()).hexdigest() != sha256:
        raise DescriptionError(
            f"{file}: its SHA-256 is not the one in {listing.name}: it was changed after the cut; write the family"
            " again, or load the file alone"
        )


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
        labels=dict(shared.get("labels", {})),
        task=data["task"],
        base=base,
        start=_start(shared.get("start", "")),
        healthy_height=None if height is None else _height(*height),
        actuation=_one_of(shared.get("actuation"), get_args(Actuation)),
        gains=_gains_by_joint(shared.get("gains", {})),
        action_scale=_positive(shared.get("action_scale")),
        control_frequency=_positive(shared.get("control_frequency")),
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
        references={entry["file"]: entry["sha256"] for entry in data.get("references", [])},
        failed=tuple(
            FailedVariant(entry["name"], tuple(entry["removed"]), tuple(entry["spliced"]), entry["reason"])
            for entry in data.get("failed", [])
        ),
        mirrored=tuple(
            MirroredVariant(entry["name"], tuple(entry["removed"]), entry["mirrors"])
            for entry in data.get("mirrored", [])
        ),
        notes=tuple(data.get("notes", [])),
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
        scaled={limb: _scale(**factors) for limb, factors in entry.get("scaled", {}).items()},
        gains=_gains_by_joint(entry.get("gains", {})),
        start=_coordinates(entry.get("start", {})),
    )


def _inside(file: str) -> str:
    path = PurePosixPath(file)
    if path.is_absolute() or ".." in path.parts or not path.parts:
        raise ValueError(f"file {file!r} lies outside the manifest's folder")
    return file


def _one_of(value: Any, choices: tuple[Any, ...]) -> Any:
    if value is not None and value not in choices:
        raise ValueError(f"{value!r} is none of {', '.join(choices)}")
    return value


def _positive(value: Any) -> float | None:
    if value is None:
        return None
    if not 0 < float(value) < math.inf:
        raise ValueError(f"{value!r} is no positive number")
    return float(value)


def _scale(length: float, mass: float, gain: float) -> LimbScale:
    factors = (float(length), float(mass), float(gain))
    if not all(0 < factor < math.inf for factor in factors):
        raise ValueError(f"factors of a limb are {factors!r}")
    return LimbScale(*factors)


def _gains_by_joint(pairs: Mapping[str, Any]) -> dict[str, tuple[float, float]]:
    return {joint: _gains(*pair) for joint, pair in pairs.items()}


def _gains(stiffness: float, damping: float) -> tuple[float, float]:
    if not (0 < stiffness < math.inf and 0 <= damping < math.inf):
        raise ValueError(f"gains are {stiffness!r} and {damping!r}")
    return float(stiffness), float(damping)


def _height(low: float | None, high: float | None) -> tuple[float, float]:
    return (-math.inf if low is None else float(low), math.inf if high is None else float(high))


def _start(value: Any) -> str | dict[str, float]:
    return value if isinstance(value, str) else _coordinates(value)


def _coordinates(value: Mapping[str, Any]) -> dict[str, float]:
    found = {str(joint): float(number) for joint, number in value.items()}
    if not all(map(math.isfinite, found.values())):
        raise ValueError("start has a value that is not finite")
    return found
