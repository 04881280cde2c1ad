"""An MJCF file ready to be cut: includes flattened, every body found, and expanded by MuJoCo where need be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import mujoco
from lxml import etree

from morphkit.cutting.loss import Loss
from morphkit.cutting.mjcf import body_elements
from morphkit.cutting.source import Source
from morphkit.description import Description
from morphkit.errors import AssetError
from morphkit.io.mjcf import name_elements
from morphkit.io.resolve import flatten_includes, resolve_asset
from morphkit.io.xml import parse, serialize

_EXPANDERS = ("replicate", "attach", "flexcomp", "composite")


@dataclass
class MjcfFile:
    """An editable MJCF file.

    Attributes:
        source: The file, includes flattened.
        bodies: Element of each body, by the name that the reader gives it, in file order.
        findings: What had to be done to the file before it could be cut.
    """

    source: Source
    bodies: dict[str, Any]
    findings: list[Loss] = field(default_factory=list)


def open_mjcf(description: Description, wanted: Sequence[str]) -> MjcfFile:
    """Open an MJCF description for cutting at the bodies `wanted`.

    Bodies that only exist once MuJoCo has expanded `replicate` or `attach` are cut in what MuJoCo writes out; a finding
    of kind `format` says so.

    Raises:
        AssetError: MuJoCo has to write the file out and a mesh is missing.
    """
    findings = []
    tree = parse(description.source, file=description.file)
    if next(tree.iter("include"), None) is not None:
        flatten_includes(tree, description.folder, file=description.file)
        description = replace(description, source=serialize(tree))
        findings.append(Loss("format", "include", "", "included files were written into the description"))
    source = Source(description.source, file=description.file)
    bodies = _bodies(source, description)
    if all(name in bodies and next(bodies[name].iter(*_EXPANDERS), None) is None for name in wanted) and not any(
        above.tag in _EXPANDERS for name in wanted for above in bodies[name].iterancestors()
    ):
        return MjcfFile(source, bodies, findings)
    expanded = replace(description, source=_write_out(description))
    source = Source(expanded.source, file=description.file)
    reason = "limbs made by replicate or attach were cut in MuJoCo's own output; comments and layout are lost"
    return MjcfFile(source, _bodies(source, expanded), [*findings, Loss("format", description.file, "", reason)])


def _bodies(source: Source, description: Description) -> dict[str, Any]:
    elements = body_elements(source.root)
    named = {element.get("name"): element for element in elements if element.get("name") is not None}
    if len(named) == len(elements):
        return named
    if next(source.root.iter(*_EXPANDERS), None) is not None:
        return named
    names = [body.name for body in _parse_spec(description).bodies[1:]]
    return dict(zip(names, elements, strict=True))


def _write_out(description: Description) -> bytes:
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
            f"{description.file}: limbs made by replicate or attach can only be cut in MuJoCo's output, and MuJoCo"
            f" cannot compile the file: {' '.join(str(error).split())}"
        ) from None


def _parse_spec(description: Description) -> mujoco.MjSpec:
    """The model as MuJoCo parses it, every body named as the reader names it."""
    tree = parse(description.source, file=description.file)
    for model in tree.iterfind("asset/model[@file]"):
        if description.folder is not None:
            model.set("file", str(resolve_asset(model.get("file") or "", description.folder)))
    spec = mujoco.MjSpec.from_string(etree.tostring(tree.getroot(), encoding="unicode"))
    name_elements(spec)
    return spec
