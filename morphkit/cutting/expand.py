"""An MJCF file ready to be cut: includes flattened, every body found, and expanded by MuJoCo where need be."""

from __future__ import annotations

import copy
import os
import posixpath
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco
from lxml import etree

from morphkit.assets import mentions
from morphkit.cutting.keyframes import Layout
from morphkit.cutting.loss import Loss
from morphkit.cutting.mjcf import body_elements
from morphkit.cutting.references import Bones
from morphkit.cutting.skins import bone_names
from morphkit.cutting.source import Source
from morphkit.description import Description
from morphkit.errors import AssetError, DescriptionError
from morphkit.io.attached import attach_models
from morphkit.io.mjcf_names import body_names, name_elements
from morphkit.io.resolve import flatten_includes, locate
from morphkit.io.xml import parse, read_limited, serialize

_MARK = "morphkit/unnamed/"
_EXPANDERS = ("replicate", "attach", "flexcomp", "composite")


@dataclass(frozen=True)
class MjcfFile:
    """An editable MJCF file.

    Attributes:
        source: The file, includes flattened.
        bodies: Element of each body, by the name that the reader gives it, in file order.
        layout: That of its keyframes.
        bones: The bodies that its skin files name.
        findings: What had to be done to the file before it could be cut.
    """

    source: Source
    bodies: dict[str, Any]
    layout: Layout
    bones: Bones
    findings: tuple[Loss, ...]


class MjcfOpener:
    """Opens an MJCF description for cutting, any number of times; what all times share is done once."""

    def __init__(self, description: Description) -> None:
        self._description = description
        self._findings: tuple[Loss, ...] = ()
        tree = parse(description.source, file=description.file)
        if next(tree.iter("include"), None) is not None:
            flatten_includes(tree, description.folder, file=description.file, packages=description.packages)
            self._description = replace(description, source=serialize(tree))
            self._findings = (Loss("format", "include", "", "included files were written into the description"),)

    def open(self, wanted: Sequence[str]) -> MjcfFile:
        """Open the file for cutting at the bodies `wanted`.

        Bodies that only exist once MuJoCo has expanded `replicate` or `attach` are cut in what MuJoCo writes out; a
        finding of kind `format` says so.

        Raises:
            AssetError: MuJoCo has to write the file out and a mesh is missing.
        """
        file = self._written.open(self._findings)
        if self._expandable and not _reachable(file, wanted):
            reason = "limbs made by replicate or attach were cut in MuJoCo's own output; comments and layout are lost"
            return self._expanded.open((*self._findings, Loss("format", self._description.file, "", reason)))
        return file

    @cached_property
    def _written(self) -> _Shared:
        return _Shared(self._description)

    @cached_property
    def _expandable(self) -> bool:
        return next(parse(self._description.source, file=self._description.file).iter(*_EXPANDERS), None) is not None

    @cached_property
    def _expanded(self) -> _Shared:
        return _Shared(replace(self._description, source=_write_out(self._description)))


class _Shared:
    """What every edit of one file shares."""

    def __init__(self, description: Description) -> None:
        self._source = Source(description.source, file=description.file)
        self._description = description
        self._layout: Layout | None = None
        self._bones = _bones(self._source.root, description)
        self._names = given_names(self._source.root, description)

    def open(self, findings: tuple[Loss, ...]) -> MjcfFile:
        if self._layout is None:
            self._layout = Layout(self._source.root, self._description)
        source = self._source.again()
        elements = zip(self._names, body_elements(source.root), strict=True)
        bodies = {name: element for name, element in elements if name is not None}
        return MjcfFile(source, bodies, self._layout, self._bones, findings)


def given_names(root: Any, description: Description) -> list[str | None]:
    """Names of all `<body>` elements below `root` as the reader gives them; None for those that something multiplies.

    Raises:
        ValueError: MuJoCo has to say what else there is, and cannot parse the file.
    """
    bodies = body_elements(root)
    names: list[str | None] = [body.get("name") or None for body in bodies]
    if None not in names:
        return names
    if next(root.iter(*_EXPANDERS), None) is not None:
        return _names_in_model(root, description)
    index = {id(body): number for number, body in enumerate(bodies)}
    rows = []
    for body, name in zip(bodies, names, strict=True):
        above = next(body.iterancestors("body"), None)
        rows.append((name, None if above is None else index[id(above)], _first_joint(body)))
    return [*body_names(rows)]


def _names_in_model(root: Any, description: Description) -> list[str | None]:
    """Mark the bodies without a name, so that they are found again among those that MuJoCo makes."""
    tree = etree.ElementTree(copy.deepcopy(root))
    elements = body_elements(tree.getroot())
    number = {f"{_MARK}{count}/": count for count, element in enumerate(elements) if not element.get("name")}
    for mark, count in number.items():
        elements[count].set("name", mark)
    spec = _parse_tree(tree, description)
    found = {}
    for body in spec.bodies[1:]:
        if body.name.startswith(_MARK):
            found[number.get(body.name)] = body
            body.name = ""
    name_elements(spec)
    made = {count: body.name for count, body in found.items() if count is not None}
    return [made.get(count) if count in number.values() else each.get("name") for count, each in enumerate(elements)]


def _first_joint(body: Any) -> str | None:
    """Name of the first joint of a body, or of the frames in it, that has one."""
    for child in body:
        name = child.get("name") if child.tag in ("joint", "freejoint") else None
        name = name or (_first_joint(child) if child.tag == "frame" else None)
        if name:
            return str(name)
    return None


def open_mjcf(description: Description, wanted: Sequence[str]) -> MjcfFile:
    """Open an MJCF description once; see `MjcfOpener.open`."""
    return MjcfOpener(description).open(wanted)


def _reachable(file: MjcfFile, wanted: Sequence[str]) -> bool:
    """Whether all bodies `wanted` stand in the file, and nothing around or below them has to be expanded."""
    if any(name not in file.bodies or next(file.bodies[name].iter(*_EXPANDERS), None) is not None for name in wanted):
        return False
    return not any(above.tag in _EXPANDERS for name in wanted for above in file.bodies[name].iterancestors())


def _bones(root: Any, description: Description) -> Bones:
    """The bodies that each skin file names; a file that cannot be read names none."""
    bones = {}
    for skin in root.iter("skin"):
        file = skin.get("file")
        if file is not None:
            folders = [compiler.get("meshdir", compiler.get("assetdir")) for compiler in root.iterfind("compiler")]
            folder = next((path for path in reversed(folders) if path), "")
            try:
                bones[file] = bone_names(read_limited(locate(posixpath.join(folder, file), description)))
            except (OSError, DescriptionError):
                continue
    return bones


def _write_out(description: Description) -> bytes:
    spec = _parse_spec(description)
    if description.folder is not None:
        spec.modelfiledir = str(description.folder)
    # Keep numbers at full precision and defaults as they were.
    spec.compiler.savecompiled = False
    spec.compiler.savecanonical = False
    try:
        spec.compile()
        return _inner_paths(str(spec.to_xml()).encode(), description)
    except (ValueError, RuntimeError) as error:
        raise AssetError(
            f"{description.file}: limbs made by replicate or attach can only be cut in MuJoCo's output, and MuJoCo"
            f" cannot compile the file: {' '.join(str(error).split())}"
        ) from None


def _parse_spec(description: Description) -> mujoco.MjSpec:
    """The model as MuJoCo parses it, every body named as the reader names it."""
    spec = _parse_tree(parse(description.source, file=description.file), description)
    name_elements(spec)
    return spec


def _parse_tree(tree: Any, description: Description) -> mujoco.MjSpec:
    models = attach_models(tree, description)
    return mujoco.MjSpec.from_string(etree.tostring(tree.getroot(), encoding="unicode"), include=models)


def _inner_paths(source: bytes, description: Description) -> bytes:
    """Call the files of attached models, which `attach_models` calls by their whole paths, as seen from the folder."""
    tree = parse(source, file=description.file)
    root = tree.getroot()
    named = list(mentions(root))
    if description.folder is None or not any(posixpath.isabs(each.reference) for each in named):
        return source
    for each in named:
        path = each.reference
        if posixpath.isabs(path) and Path(path).is_relative_to(description.folder.resolve()):
            path = Path(os.path.relpath(path, description.folder.resolve())).as_posix()
        each.element.set(each.attribute, path)
    for compiler in root.iterfind("compiler"):
        for attribute in ("meshdir", "texturedir", "assetdir", "strippath"):
            if attribute in compiler.attrib:
                del compiler.attrib[attribute]
    return serialize(tree)
