"""Checks of the files that an MJCF model refers to, and of masses that do not fit its meshes."""

from __future__ import annotations

import os
import posixpath
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from morphkit.description import Description
from morphkit.errors import AssetError, DescriptionError
from morphkit.formats.assets import mentions
from morphkit.formats.mjcf_attach import files_of_model
from morphkit.formats.mjcf_defaults import Defaults
from morphkit.formats.poses import Angles, identity
from morphkit.validation.document import CheckedDocument, elements, one_line
from morphkit.validation.mass_properties import Shape, check_body
from morphkit.validation.meshes import MeshFacts, MeshUse, corners

_PLACED_BY = ("refpos", "refquat")


def find_meshes(doc: CheckedDocument) -> dict[str, MeshUse]:
    """Return the meshes that are there by their name; files that are missing are reported."""
    defaults = Defaults(doc.root)
    meshes: dict[str, MeshUse] = {}
    for each in mentions(doc.root):
        asset = each.element
        path = _find(doc, asset, each.reference)
        if path is not None and asset.tag == "model":
            _find_parts(doc, asset, path)
        if path is not None and asset.tag == "mesh":
            name = asset.get("name") or Path(each.reference).stem
            meshes[name] = _use(doc, asset, name, path, defaults)
    return {name: use for name, use in meshes.items() if use.scale.all()}


def _find(doc: CheckedDocument, asset: Any, reference: str) -> Path | None:
    name = asset.get("name") or Path(reference).stem
    return doc.find_asset(asset, reference, f"{asset.tag} {name!r}", name, missing="mesh-missing")


def _find_parts(doc: CheckedDocument, asset: Any, model: Path) -> None:
    """Report what a model to attach needs, from its own folder, and is missing."""
    source, packages = doc.document.source, doc.packages
    description = Description(
        model.stem, model.name, "mjcf", source, doc.folder, packages=packages, document=doc.document
    )
    owner = f"model {(asset.get('name') or model.stem)!r}"
    try:
        files = list(files_of_model(model, description))
    except AssetError as error:
        doc.add("include-missing", asset, f"{owner}: {one_line(error)}")
        return
    except (OSError, DescriptionError):
        return  # MuJoCo, which is asked too, says what is wrong with it
    folder = os.path.relpath(model.parent, doc.folder.resolve())
    for each in files:
        if each.path is None:
            doc.find_asset(asset, posixpath.join(folder, each.reference), owner, model.name, missing="mesh-missing")


def _use(doc: CheckedDocument, asset: Any, name: str, path: Path, defaults: Defaults) -> MeshUse:
    text = defaults.get(asset, "scale", "1 1 1")
    try:
        scale = np.array([float(word) for word in text.split()])
    except ValueError:
        scale = np.zeros(3)
    if scale.shape != (3,) or not np.isfinite(scale).all() or not scale.all():
        doc.add("mesh-scale-zero", asset, f"mesh {name!r} has scale {text}", name=name)
        scale = np.zeros(3)
    return MeshUse(asset, "", f"mesh {name!r}", path, scale, identity())


def check_bodies(
    doc: CheckedDocument,
    inertials: Mapping[Any, tuple[float, Any, Any]],
    meshes: Mapping[str, MeshUse],
    facts: Mapping[str, MeshFacts],
) -> None:
    """Report explicit masses and inertias that do not fit the meshes of their body."""
    settings = {key: value for section in elements(doc.root, "compiler") for key, value in section.attrib.items()}
    angles = Angles(settings.get("angle") == "radian", settings.get("eulerseq", "xyz"))
    for inertial, (mass, center, tensor) in inertials.items():
        body = inertial.getparent()
        geoms = elements(body, "geom")
        if not geoms or any(geom.get("mesh") not in meshes for geom in geoms):
            continue
        shapes: list[Shape] = []
        for geom in geoms:
            use = meshes[geom.get("mesh")]
            known = facts.get(str(use.path))
            if known is None or known.problem or any(use.element.get(key) for key in _PLACED_BY):
                shapes = []
                break
            try:
                pose = angles.pose(geom)
            except (ValueError, IndexError, TypeError):
                shapes = []
                break
            volume = known.volume * float(abs(np.prod(use.scale)))
            shapes.append(Shape(volume, corners(known.bounds, use.scale, pose)))
        check_body(
            doc,
            inertial,
            body.get("name") or "",
            mass=mass,
            center=np.asarray(center) if center is not None else None,
            tensor=tensor,
            shapes=[shapes],
        )
