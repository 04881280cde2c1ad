"""What MuJoCo reads while it parses an MJCF: the models that it attaches and the shapes of flexcomps.

They are read and checked here, and handed over with every path written out. MuJoCo would open whatever is named, follow
without end models that attach each other, and forget which folder the files of each start in.
"""

from __future__ import annotations

import os
import posixpath
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

from lxml import etree

from morphkit.description import Description
from morphkit.errors import AssetError, DescriptionError
from morphkit.formats.assets import Asset, find_asset, mentions, place_of, take_names_as_written, write_out_names
from morphkit.formats.document import Document, document_of
from morphkit.formats.limits import check_flexcomp, check_mjcf
from morphkit.formats.mjcf_include import flattened
from morphkit.formats.mjcf_locations import Places
from morphkit.formats.mjcf_schema import reads_file
from morphkit.formats.resolve import locate
from morphkit.formats.xml import read_limited


def prepare_parse(tree: etree._ElementTree, description: Description, places: Places | None = None) -> dict[str, bytes]:
    """Make a model ready for `MjSpec.from_string`: read what MuJoCo would open, and write out where all files are.

    Args:
        tree: The parsed model, includes flattened. In place, its files get their names as seen from the description's
            folder, and models and flexcomps the keys of the result.
        description: Its description.
        places: Receives where the elements of attached models are.

    Returns:
        The files for `MjSpec.from_string(..., include=...)`. Models have their includes flattened, and each mesh,
        texture, height field and skin called by its whole path, as the folder and the compiler settings of its own
        model have it.

    Raises:
        AssetError: A model or the shape of a flexcomp, or a file that it includes, is missing or may not be read.
        DescriptionError: A model is no MJCF, breaks a limit, or attaches itself: MuJoCo would not survive that. A
            flexcomp makes too many bodies.
    """
    models: dict[str, bytes] = {}
    write_out_names(tree.getroot())
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
    _read_flexcomps(tree.getroot(), description, models)
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
            write_out_names(part.getroot())
            _follow(part, nested, attached, (*above, path), models, places)
        else:
            part = attached.copy()
        _write_whole_paths(part.getroot(), nested)
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
    for each in mentions(tree.getroot(), partial(locate, description=part)):
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


def _read_flexcomps(root: etree._Element, description: Description, files: dict[str, bytes]) -> None:
    for flexcomp in root.iter("flexcomp"):
        name = flexcomp.get("file")
        if not name or not reads_file(flexcomp):
            continue
        where = f"{description.file}:{flexcomp.sourceline}"
        try:
            path = locate(name, description)
            content = read_limited(path)
        except AssetError as error:
            raise AssetError(f"{where}: {error}") from None
        except OSError as error:
            raise AssetError(f"{where}: {path} cannot be read: {error.strerror}") from None
        check_flexcomp(flexcomp, content, path, where=where)
        key = f"{len(files)}_{path.name}"
        files[key] = content
        flexcomp.set("file", key)


def _write_whole_paths(root: etree._Element, part: Description) -> None:
    """Call the files of an attached model by their whole paths, but those that are handed over."""
    assert part.folder is not None
    for each in list(mentions(root, partial(locate, description=part))):
        if each.element.tag in ("model", "flexcomp"):
            continue
        if part.format == "urdf":
            try:
                target = str(locate(each.reference, part))
            except AssetError:
                continue  # a missing mesh is for those to complain about who need it
        else:
            target = str(part.folder / each.reference)
        each.element.set(each.attribute, target)
    if part.format == "urdf":
        take_names_as_written(root)
