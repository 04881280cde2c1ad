"""Assets of variants: copied next to them, or left where they are and referred to from there."""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any, Literal

from morphkit.ablation.loss import Loss
from morphkit.description import Description
from morphkit.errors import MorphkitError
from morphkit.formats.assets import Asset, Mention, find_asset, mentions, place_of, take_names_as_written
from morphkit.formats.document import document_of
from morphkit.formats.mjcf_attach import files_of_model
from morphkit.formats.mjcf_schema import NAMED_BY_FILE, drop_file_settings
from morphkit.formats.packages import split_reference
from morphkit.formats.resolve import locate
from morphkit.formats.source import Source

AssetMode = Literal["copy", "reference"]
_OUTSIDE = "assets"


class Packer:
    """Makes every file that variants refer to be found from the folder that they are written into.

    Attributes:
        files: SHA-256 of each file, by its path relative to that folder.
    """

    def __init__(self, folder: Path, stage: Path, mode: AssetMode, taken: Collection[str]) -> None:
        """Pack for `folder`, which is being written at `stage`; `taken` holds names, casefolded, that are not free."""
        self.files: dict[str, str] = {}
        self._folder, self._stage, self._mode = folder.resolve(), stage, mode
        self._taken = taken
        self._paths: dict[str, Path] = {}

    def pack(self, description: Description) -> tuple[bytes, list[Loss]]:
        """Bring along what `description` refers to.

        References stay as they are where a copy can lie at that very place. Others, such as absolute paths, paths that
        lead out of the folder, and with mode `reference` all of them, are rewritten.

        Returns:
            The bytes of the description as it has to be written; what is missing and what was rewritten.
        """
        find = partial(locate, description=description)
        named = list(mentions(document_of(description).root, find))
        found = {each.reference: find_asset(each.reference, description) for each in named}
        lost = [Loss("asset", name, "", asset.problem) for name, asset in found.items() if asset.path is None]
        target: Callable[[Asset], str] = self._reference if self._mode == "reference" else self._copy
        for each in named:
            path = found[each.reference].path
            if each.element.tag == "model" and path is not None:
                place = PurePosixPath(target(found[each.reference])).parent
                lost += self._pack_parts(path, place, description)
        targets = {name: target(asset) for name, asset in found.items() if asset.path is not None}
        in_place = self._mode == "copy"
        if all(each.reference not in targets or _right(each, targets, in_place) for each in named):
            return description.source, lost
        source = Source(document_of(description))
        rewritten = list(_rewrite(source.root, targets, find, in_place=in_place))
        return source.render(), [*lost, *(rewritten if in_place else [])]

    def _pack_parts(self, model: Path, place: PurePosixPath, description: Description) -> Iterator[Loss]:
        """Bring along the files of a model to attach, a copy of which is in `place`: they are found from its folder."""
        try:
            files = list(files_of_model(model, description))
        except (OSError, MorphkitError) as error:
            yield Loss("asset", model.name, "", str(error).splitlines()[0])
            return
        for asset in files:
            inside = asset.place if split_reference(asset.reference) is not None else asset.reference
            wanted = place_of((place / inside).as_posix()) if inside is not None else None
            if asset.path is None:
                yield Loss("asset", asset.reference, "", f"of {model.name}: {asset.problem}")
            elif self._mode == "reference":
                self._reference(asset)
            elif wanted is None or self._copy(replace(asset, place=wanted)) != wanted.as_posix():
                yield Loss("asset", asset.reference, "", f"of {model.name}: no copy can lie where it is looked for")

    def _reference(self, asset: Asset) -> str:
        """Enter a file; return its path relative to the folder."""
        assert asset.path is not None
        place = Path(os.path.relpath(asset.path, self._folder)).as_posix()
        if place not in self.files:
            self.files[place] = hashlib.sha256(asset.path.read_bytes()).hexdigest()
        return place

    def _copy(self, asset: Asset) -> str:
        """Copy a file; return the place of the copy."""
        assert asset.path is not None
        known = next((place for place, path in self._paths.items() if path == asset.path), None)
        if asset.place is None and known is not None:
            return known
        place = asset.place or PurePosixPath(_OUTSIDE) / asset.path.name
        if place.as_posix().casefold() in self._taken:
            place = PurePosixPath(_OUTSIDE) / asset.path.name
        number = 1
        while self._paths.setdefault(place.as_posix(), asset.path) != asset.path:
            number += 1
            place = PurePosixPath(_OUTSIDE) / f"{asset.path.stem}_{number}{asset.path.suffix}"
        if place.as_posix() not in self.files:
            target = self._stage / place
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(asset.path, target)
            self.files[place.as_posix()] = hashlib.sha256(target.read_bytes()).hexdigest()
        return place.as_posix()


def _rewrite(root: Any, targets: dict[str, str], find: Callable[[str], Path], *, in_place: bool) -> Iterator[Loss]:
    """Write `targets`, by reference, into the file's attributes wherever they are not what is there already."""
    named = list(mentions(root, find))
    # Names below a folder that a file sets cannot lead out of it: all are written out, without one.
    settled = drop_file_settings(root) if root.tag == "mujoco" else take_names_as_written(root)
    for each in named:
        right = each.reference not in targets or _right(each, targets, in_place)
        target = each.reference if right else targets[each.reference]
        if each.element.get(each.attribute) != target and (settled or not right):
            yield Loss("asset", each.reference, "", f"is written as {target}")
            _keep_name(each.element, target)
            each.element.set(each.attribute, target)


def _keep_name(element: Any, target: str) -> None:
    """Write the name of an asset that has that of its file, where the file is to have another."""
    stem = PurePosixPath(element.get("file", "")).stem
    named = element.get("name") is not None or element.tag not in NAMED_BY_FILE
    if not named and stem not in ("", PurePosixPath(target).stem):
        element.set("name", stem)


def _right(mention: Mention, targets: dict[str, str], in_place: bool) -> bool:
    """Whether a reference leads to its target as it is; xacro's `$(find name)` leads nowhere outside of ROS."""
    place = place_of(mention.reference)
    return in_place and "$(" not in mention.reference and place is not None and str(place) == targets[mention.reference]
