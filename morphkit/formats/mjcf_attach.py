"""The models that an MJCF file attaches: read and checked here, and handed to MuJoCo with every path written out.

MuJoCo would open them itself while it parses, follow without end those that attach each other, and forget which folder
the files of each start in.
"""

from __future__ import annotations

import os
import posixpath
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from lxml import etree

from morphkit.description import Description
from morphkit.errors import AssetError, DescriptionError
from morphkit.formats.assets import Asset, find_asset, mentions, place_of
from morphkit.formats.document import Document, document_of
from morphkit.formats.limits import check_mjcf
from morphkit.formats.mjcf_include import flattened
from morphkit.formats.mjcf_locations import Places
from morphkit.formats.mjcf_schema import drop_file_settings
from morphkit.formats.resolve import locate


def attach_models(tree: etree._ElementTree, description: Description, places: Places | None = None) -> dict[str, bytes]:
    """Take the place of MuJoCo in opening the models that a model attaches, and that those attach.

    Args:
        tree: The parsed model, includes flattened. Its references to models are renamed, in place, to the keys of the
            result.
        description: Its description.
        places: Receives where the elements of those models are.

    Returns:
        The models for `MjSpec.from_string(..., include=...)`: includes flattened, and each mesh, texture, height field
        and skin called by its whole path, as the folder and the compiler settings of its own model have it.

    Raises:
        AssetError: One of them, or a file that it includes, is missing or may not be read.
        DescriptionError: One is no MJCF, breaks a limit, or attaches itself: MuJoCo would not survive that.
    """
    models: dict[str, bytes] = {}
    _follow(tree, description, document_of(description), (), models, places)
    return models


def _follow(
    tree: etree._ElementTree,
    description: Description,
    document: Document,
    above: tuple[Path, ...],
    models: dict[str, bytes],
    places: Places | None,
) -> None:
    for model in tree.iterfind("asset/model[@file]"):
        where = f"{description.file}:{model.sourceline}"
        try:
            path = locate(model.get("file") or "", description)
        except AssetError as error:
            raise AssetError(f"{where}: {error}") from None
        if path in above:
            raise DescriptionError(f"{where}: {path.name} attaches itself, through {abridged_path(above, path)}")
        try:
            attached = document.part(path)
        except OSError as error:
            raise AssetError(f"{where}: {path} cannot be read: {error.strerror}") from None
        nested = _description(path, attached, description)
        if attached.format == "mjcf":
            read = places.own if places is not None else None
            part = flattened(attached, path.parent, file=path.name, packages=nested.packages, read=read)
            check_mjcf(part.getroot(), file=path.name)
            _follow(part, nested, attached, (*above, path), models, places)
        else:
            part = attached.copy()
        _write_out_paths(part.getroot(), nested)
        name = f"{len(models)}_{path.name}"
        text = etree.tostring(part.getroot(), encoding="unicode")
        models[name] = text.encode()
        model.set("file", name)
        if places is not None:
            places.add(part.getroot(), text, path.name, main=False)


def files_of_model(path: Path, description: Description, *, above: tuple[Path, ...] = ()) -> Iterator[Asset]:
    """Yield every file that a model to attach needs, references and places as seen from the folder of that model.

    Those are the files that it includes, its meshes and other assets, the models that it attaches itself, and theirs.

    Args:
        path: The model.
        description: What attaches it.
        above: The models on the way to it.

    Raises:
        AssetError: The model, or a file that it includes, cannot be read.
        DescriptionError: It is no robot description.
    """
    document = document_of(description).part(path)
    part = _description(path, document, description)
    included: list[Path] = []
    tree = document.tree
    if document.format == "mjcf":
        packages = part.packages
        tree = flattened(
            document, path.parent, file=path.name, packages=packages, read=lambda _, file: included.append(file)
        )
    for file in included:
        reference = Path(os.path.relpath(file, path.parent.resolve())).as_posix()
        yield Asset(reference, place_of(reference), file)
    for each in mentions(tree.getroot()):
        asset = find_asset(each.reference, part)
        yield asset
        if each.element.tag == "model" and asset.path is not None and asset.path not in above:
            folder = posixpath.dirname(each.reference)
            for below in files_of_model(asset.path, part, above=(*above, asset.path)):
                reference = posixpath.join(folder, below.reference)
                yield replace(below, reference=reference, place=place_of(reference))


def _description(path: Path, document: Document, owner: Description) -> Description:
    """The description of a model that `owner` attaches."""
    packages = readable(owner)
    return Description(
        path.stem, path.name, document.format, document.source, path.parent, packages=packages, document=document
    )


def abridged_path(above: tuple[Path, ...], end: Path) -> str:
    """`a.xml -> b.xml -> a.xml`."""
    return " -> ".join(path.name for path in (*above[above.index(end) :], end))


def readable(description: Description) -> dict[str, Path]:
    """The packages and the robot's own folder, which models in folders below may refer to."""
    own = {} if description.folder is None else {"": description.folder.resolve()}
    return {**own, **description.packages}


def _write_out_paths(root: etree._Element, part: Description) -> None:
    assert part.folder is not None
    for each in list(mentions(root)):
        if each.element.tag == "model":
            continue
        name = str(each.element.get(each.attribute))
        if part.format == "urdf":
            try:
                target = str(locate(name, part))
            except AssetError:
                continue  # a missing mesh is for those to complain about who need it
        else:
            target = str(part.folder / each.reference)
        each.element.set(each.attribute, target)
    drop_file_settings(root)
    if part.format == "urdf":
        for compiler in root.iter("compiler"):
            compiler.set("strippath", "false")
