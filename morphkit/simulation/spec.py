"""A robot description -> an `MjSpec` of exactly what the file says, with every mesh and texture resolved."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import mujoco

from morphkit.description import Description
from morphkit.errors import AssetError, DescriptionError
from morphkit.formats import xml
from morphkit.formats.assets import reference_in_urdf, take_names_as_written
from morphkit.formats.document import document_of
from morphkit.formats.limits import check_chain, check_mjcf
from morphkit.formats.mjcf_attach import prepare_parse
from morphkit.formats.mjcf_include import flattened
from morphkit.formats.mjcf_names import name_elements
from morphkit.formats.resolve import locate
from morphkit.morphology import Morphology
from morphkit.readers.urdf_normalize import normalize
from morphkit.simulation.image_files import ImageReader
from morphkit.simulation.mesh_files import read_for_mujoco
from morphkit.simulation.urdf_repair import leave_out_strays, mend


def load_spec(
    description: Description,
    *,
    incomplete: set[str] | None = None,
    only: Morphology | None = None,
    drawn: bool = True,
    decorated: bool = True,
) -> tuple[mujoco.MjSpec, tuple[str, ...]]:
    """Parse a description into an MjSpec that compiles without touching the file system again.

    A URDF goes through MuJoCo's importer with `fusestatic="false" discardvisual="false"`, so that fixed links and
    visuals survive. A mesh that only decorates (no contact, no part in masses) is dropped where it cannot be found.

    Args:
        description: The robot.
        incomplete: For a model that is only looked at: a set, to which the names of bodies are added that lose a shape.
            Every mesh and height field that cannot be found is dropped then, even one that matters.
        only: The robot, where links of a URDF that are no part of it are to be left out.
        drawn: Whether the model is drawn. Else no image of a texture is read.
        decorated: Whether meshes that only decorate are kept. Else they are left out unread, but for a robot that
            nothing can touch: how high it stands is seen from them.

    Returns:
        The spec, its bodies, joints and actuators all named as the reader names them; and one sentence for each thing
        that was dropped or repaired.

    Raises:
        DescriptionError: MuJoCo cannot parse the file, or as `normalize`.
        AssetError: A mesh, height field or included file that the simulation needs is missing or too large.
    """
    images = ImageReader()
    document = document_of(description)
    references: dict[str, str] = {}
    models: dict[str, bytes] = {}
    mended: tuple[str, ...] = ()
    if description.format == "urdf":
        tree = document.copy()
        check_chain(tree.getroot(), file=description.file)
        repairs = normalize(tree, file=description.file).repairs
        strays = tuple(leave_out_strays(tree.getroot(), only)) if only is not None else ()
        mended = (*(repair.text for repair in repairs), *strays, *mend(tree.getroot(), file=description.file))
        references = _prepare_urdf(tree.getroot(), description)
    else:
        tree = flattened(document, description.folder, file=description.file, packages=description.packages)
        check_mjcf(tree.getroot(), file=description.file)
        models = prepare_parse(tree, description)
    try:
        spec = mujoco.MjSpec.from_string(xml.decode(xml.serialize(tree), tree), include=models)
    except ValueError as error:
        raise DescriptionError(f"{description.file}: MuJoCo cannot read it: {error}") from error
    name_elements(spec)
    notes = [
        *mended,
        *_resolve_meshes(spec, description, references, incomplete, decorated=decorated),
        *_resolve_fields(spec, description, incomplete, images),
        *_resolve_skins(spec, description),
        *(_resolve_images(spec, description, images) if drawn else _without_images(spec)),
    ]
    return spec, tuple(notes)


def compile_spec(spec: mujoco.MjSpec, file: str) -> mujoco.MjModel:
    """Compile `spec`; what MuJoCo complains about becomes a DescriptionError that names `file`."""
    try:
        return spec.compile()
    except ValueError as error:
        raise DescriptionError(f"{file}: MuJoCo cannot compile it: {error}") from error


def _prepare_urdf(robot: Any, description: Description) -> dict[str, str]:
    """Insert the importer's options; give every mesh a short unique file name, and return name -> reference."""
    named = [(mesh, reference_in_urdf(mesh, partial(locate, description=description))) for mesh in robot.iter("mesh")]
    mujoco_element = robot.find("mujoco")
    if mujoco_element is None:
        mujoco_element = robot.makeelement("mujoco", {})
        robot.append(mujoco_element)
    compiler = mujoco_element.find("compiler")
    if compiler is None:
        compiler = mujoco_element.makeelement("compiler", {})
        mujoco_element.insert(0, compiler)
    take_names_as_written(robot)
    for key, value in {"fusestatic": "false", "discardvisual": "false"}.items():
        compiler.set(key, value)
    for place, material in enumerate(robot.findall("material")):
        robot.insert(place, material)  # the robot's own count before those of links; MuJoCo takes the first of a name
    names: dict[str, str] = {}
    for mesh, reference in named:
        mesh.set("filename", names.setdefault(reference, f"{len(names)}_{Path(reference).name}"))
    return {name: reference for reference, name in names.items()}


def _resolve_meshes(
    spec: mujoco.MjSpec,
    description: Description,
    references: dict[str, str],
    incomplete: set[str] | None,
    *,
    decorated: bool,
) -> list[str]:
    notes = []
    assets: dict[str, bytes] = {}
    geoms: dict[str, list[Any]] = {}
    spared = not decorated and any(_collides(geom) for body in spec.bodies[1:] for geom in body.geoms)
    for geom in spec.geoms:
        geoms.setdefault(geom.meshname, []).append(geom)
    for mesh in list(spec.meshes):
        if not mesh.file:
            continue
        reference = references.get(mesh.file, mesh.file)
        users = geoms.get(mesh.name, [])
        try:
            if spared and users and all(_is_decoration(geom) and not geom.name for geom in users):
                locate(reference, description)
                drop_shape(spec, mesh, users)
                continue
            name, content = _mesh_bytes(reference, description)
        except AssetError as error:
            if incomplete is None and not all(_is_decoration(geom) for geom in users):
                raise AssetError(f"{description.file}: mesh {reference!r} is needed in simulation: {error}") from error
            notes.append(f"mesh {reference!r} was left out: {error}")
            drop_shape(spec, mesh, users, incomplete)
            continue
        mesh.file = f"{len(assets)}_{name}"
        assets[mesh.file] = content
    spec.assets = {**spec.assets, **assets}
    return notes


def _mesh_bytes(reference: str, description: Description) -> tuple[str, bytes]:
    return read_for_mujoco(locate(reference, description))


def _resolve_fields(
    spec: mujoco.MjSpec, description: Description, incomplete: set[str] | None, images: ImageReader
) -> list[str]:
    notes = []
    for field in [field for field in spec.hfields if field.file]:
        try:
            path = locate(field.file, description)
            content = images.read(path)
        except AssetError as error:
            if incomplete is None:
                raise
            notes.append(f"height field {field.file!r} was left out: {error}")
            drop_shape(spec, field, [geom for geom in spec.geoms if geom.hfieldname == field.name], incomplete)
            continue
        field.file = f"{len(spec.assets)}_{path.name}"
        spec.assets = {**spec.assets, field.file: content}
    return notes


def _resolve_skins(spec: mujoco.MjSpec, description: Description) -> list[str]:
    """Skins never matter to the simulation: one that cannot be found is left out."""
    notes = []
    for skin in [skin for skin in spec.skins if skin.file]:
        try:
            path = locate(skin.file, description)
        except AssetError as error:
            notes.append(f"skin {skin.name or skin.file!r} was left out: {error}")
            spec.delete(skin)
            continue
        skin.file = f"{len(spec.assets)}_{path.name}"
        spec.assets = {**spec.assets, skin.file: path.read_bytes()}
    return notes


def drop_shape(spec: mujoco.MjSpec, asset: Any, users: Sequence[Any], incomplete: set[str] | None = None) -> None:
    """Delete a mesh or height field and the geoms that use it; the names of their bodies are added to `incomplete`."""
    for geom in users:
        if incomplete is not None:
            incomplete.add(geom.parent.name)
        spec.delete(geom)
    spec.delete(asset)


def _resolve_images(spec: mujoco.MjSpec, description: Description, images: ImageReader) -> list[str]:
    """Textures never matter to the simulation: one that cannot be found, or is too large, becomes a flat color."""
    notes = []
    for texture in spec.textures:
        files = [file for file in (texture.file, *texture.cubefiles) if file]
        if not files or texture.builtin != mujoco.mjtBuiltin.mjBUILTIN_NONE:
            continue
        try:
            paths = {file: locate(file, description) for file in files}
            contents = {path: images.read(path) for path in dict.fromkeys(paths.values())}
        except AssetError as error:
            notes.append(f"texture {texture.name or files[0]!r} was left out: {error}")
            _flatten(texture)
            continue
        renamed = {}
        for file, path in paths.items():
            renamed[file] = f"{len(spec.assets)}_{path.name}"
            spec.assets = {**spec.assets, renamed[file]: contents[path]}
        if texture.file:
            texture.file = renamed[texture.file]
        texture.cubefiles = [renamed.get(file, "") for file in texture.cubefiles]
    return notes


def _without_images(spec: mujoco.MjSpec) -> list[str]:
    for texture in spec.textures:
        _flatten(texture)
    return []


def _flatten(texture: Any) -> None:
    texture.file, texture.cubefiles = "", [""] * len(texture.cubefiles)
    texture.builtin, texture.width, texture.height = mujoco.mjtBuiltin.mjBUILTIN_FLAT, 8, 8


def _is_decoration(geom: Any) -> bool:
    """Whether neither contacts nor masses depend on the geom."""
    massless = geom.mass == 0 or (geom.mass != geom.mass and geom.density == 0)
    return not _collides(geom) and (geom.parent.explicitinertial or massless)


def _collides(geom: Any) -> bool:
    return bool(geom.contype or geom.conaffinity)
