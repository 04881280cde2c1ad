"""An MJCF file ready to be cut: includes flattened, every body found, and expanded by MuJoCo where need be."""

from __future__ import annotations

import os
import posixpath
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco

from morphkit.ablation.loss import Loss
from morphkit.ablation.mjcf import body_elements, body_parents, cut, set_height
from morphkit.ablation.mjcf_keyframes import KeyframeLayout
from morphkit.ablation.mjcf_names import Given, given_names, keep_names, parse_tree, unnamed
from morphkit.ablation.mjcf_references import Bones
from morphkit.ablation.plan import Plan
from morphkit.ablation.rest_pose import Positions, mjcf_positions
from morphkit.description import Description
from morphkit.errors import AssetError, DescriptionError
from morphkit.formats.assets import mentions
from morphkit.formats.document import Document, document_of
from morphkit.formats.isolation import compiling, isolated
from morphkit.formats.mjcf_include import flattened
from morphkit.formats.mjcf_names import name_elements
from morphkit.formats.mjcf_schema import EXPANDERS, drop_file_settings
from morphkit.formats.resolve import locate
from morphkit.formats.skin import bone_names
from morphkit.formats.source import Source
from morphkit.formats.xml import read_limited

_MADE = "limbs made by replicate, attach or flexcomp"


@dataclass(frozen=True)
class MjcfFile:
    """An editable MJCF file.

    Attributes:
        source: The file, includes flattened.
        bodies: Element of each body, by the name that the reader gives it, in file order.
        given: Names of elements without one, as the reader gives them.
        layout: That of its keyframes.
        bones: The bodies that its skin files name.
        findings: What had to be done to the file before it could be cut.
        description: What was opened.
    """

    source: Source
    bodies: dict[str, Any]
    given: Given
    layout: KeyframeLayout
    bones: Bones
    findings: tuple[Loss, ...]
    description: Description

    def parents(self) -> dict[str, str | None]:
        """Parent of every body in file order; None at the top."""
        return body_parents(self.bodies)

    def cut(self, plan: Plan) -> list[Loss]:
        """Edit the file; return what went besides the bodies themselves."""
        root = self.source.root
        lost = cut(root, self.bodies, plan, self.layout, self.bones)
        return [*lost, *keep_names(root, self.description, self.given, spliced=bool(plan.splice))]


class MjcfOpener:
    """Opens an MJCF description for cutting, any number of times; what all times share is done once."""

    def __init__(self, description: Description) -> None:
        self._description = description
        self._findings: tuple[Loss, ...] = ()
        document = document_of(description)
        if next(document.root.iter("include"), None) is not None:
            file = description.file
            tree = flattened(document, description.folder, file=file, packages=description.packages)
            self._description = _with(description, Document.of_tree(tree, file=file))
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
            reason = f"{_MADE} were cut in MuJoCo's own output; comments and layout are lost"
            return self._expanded.open((*self._findings, Loss("format", self._description.file, "", reason)))
        return file

    def positions(self, base: str) -> Positions:
        """Where the bodies below `base` are in the file's rest pose; none where the file does not spell it out."""
        file = self.open([])
        return mjcf_positions(file.source.root, file.bodies, base) if base in file.bodies else {}

    def set_height(self, root: str, height_m: float) -> bytes:
        """The file with the body `root` at another height above the world's origin, m."""
        file = self.open([root])
        set_height(file.source.root, file.bodies[root], height_m)
        return file.source.render()

    @cached_property
    def _written(self) -> _Shared:
        return _Shared(self._description)

    @cached_property
    def _expandable(self) -> bool:
        return next(document_of(self._description).root.iter(*EXPANDERS), None) is not None

    @cached_property
    def _expanded(self) -> _Shared:
        return _Shared(_with(self._description, _write_out(self._description)))


class _Shared:
    """What every edit of one file shares."""

    def __init__(self, description: Description) -> None:
        self._source = Source(document_of(description))
        self._description = description
        self._layout: KeyframeLayout | None = None
        self._bones = _bones(self._source.root, description)
        elements = body_elements(self._source.root)
        given = given_names(self._source.root, description)
        self._given = [name for _, name in given]
        called = {id(element): name for element, name in given}
        self._names = [element.get("name") or called[id(element)] for element in elements]

    def open(self, findings: tuple[Loss, ...]) -> MjcfFile:
        if self._layout is None:
            self._layout = KeyframeLayout(self._source.root, self._description)
        source = self._source.again()
        elements = zip(self._names, body_elements(source.root), strict=True)
        bodies = {name: element for name, element in elements if name is not None}
        given = list(zip(unnamed(source.root), self._given, strict=True))
        return MjcfFile(source, bodies, given, self._layout, self._bones, findings, self._description)


def _with(description: Description, document: Document) -> Description:
    """The description with another source."""
    return replace(description, source=document.source, document=document)


def _reachable(file: MjcfFile, wanted: Sequence[str]) -> bool:
    """Whether all bodies `wanted` are in the file, and nothing around or below them has to be expanded."""
    if any(name not in file.bodies or next(file.bodies[name].iter(*EXPANDERS), None) is not None for name in wanted):
        return False
    return not any(above.tag in EXPANDERS for name in wanted for above in file.bodies[name].iterancestors())


def _bones(root: Any, description: Description) -> Bones:
    """The bodies that each skin file names; a file that cannot be read names none."""
    bones = {}
    for each in mentions(root):
        if each.element.tag == "skin":
            try:
                bones[each.element.get("file")] = bone_names(read_limited(locate(each.reference, description)))
            except (OSError, DescriptionError):
                continue
    return bones


def _write_out(description: Description) -> Document:
    written = Document(isolated(_expanded, description, compiling(description)), file=description.file)
    return _inner_paths(written, description)


def _expanded(description: Description) -> bytes:
    spec = _parse_spec(description)
    if description.folder is not None:
        spec.modelfiledir = str(description.folder)
    # Keep numbers at full precision and defaults as they were.
    spec.compiler.savecompiled = False
    spec.compiler.savecanonical = False
    try:
        spec.compile()
        return str(spec.to_xml()).encode()
    except (ValueError, RuntimeError) as error:
        raise AssetError(
            f"{description.file}: {_MADE} can only be cut in MuJoCo's output, and MuJoCo cannot compile the file:"
            f" {' '.join(str(error).split())}"
        ) from None


def _parse_spec(description: Description) -> mujoco.MjSpec:
    """The model as MuJoCo parses it, every body named as the reader names it."""
    spec = parse_tree(document_of(description).copy(), description)
    name_elements(spec)
    return spec


def _inner_paths(written: Document, description: Description) -> Document:
    """Call the files of attached models, which `attach_models` calls by their whole paths, as seen from the folder."""
    tree = written.copy()
    root = tree.getroot()
    named = list(mentions(root))
    if description.folder is None or not any(posixpath.isabs(each.reference) for each in named):
        return written
    for each in named:
        path = each.reference
        if posixpath.isabs(path) and Path(path).is_relative_to(description.folder.resolve()):
            path = Path(os.path.relpath(path, description.folder.resolve())).as_posix()
        each.element.set(each.attribute, path)
    drop_file_settings(root)
    return Document.of_tree(tree, file=description.file)
