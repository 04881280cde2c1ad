"""Checks of the names in an MJCF model: used twice, referred to and missing, defined and unused."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from pathlib import PurePosixPath
from typing import Any

from lxml import etree

from morphkit.formats.mjcf_schema import ASSETS, EXPANDERS, NAMED_BY_FILE, references
from morphkit.validation.common import index_names, unknown
from morphkit.validation.document import CheckedDocument, elements

_IN_BODIES = {
    "body": ("body",),
    "joint": ("joint", "freejoint"),
    "geom": ("geom",),
    "site": ("site",),
    "camera": ("camera",),
    "light": ("light",),
}
_IN_SECTIONS = {
    "material": ("asset", "material"),
    "texture": ("asset", "texture"),
    "mesh": ("asset", "mesh"),
    "hfield": ("asset", "hfield"),
    "tendon": ("tendon", None),
    "actuator": ("actuator", None),
    "sensor": ("sensor", None),
    "equality": ("equality", None),
    "keyframe": ("keyframe", None),
    "flex": ("deformable", "flex"),
}
_REFERRING = ("actuator", "sensor", "tendon", "equality", "contact", "deformable", "custom", "asset")
_NOT_REFERRING = (*EXPANDERS, "model", "plugin", "instance", "config")


def numbered(root: Any) -> tuple[str, dict[int, Any]]:
    """Return the model's text with one element a line, and the element of each line."""
    twin = copy.deepcopy(root)
    for each in list(twin.iter(etree.Comment, etree.PI)):
        parent = each.getparent()
        if parent is not None:
            parent.remove(each)
    for each in twin.iter():
        each.text = each.tail = None
    etree.indent(twin, "")
    text = etree.tostring(twin, encoding="unicode")
    parsed: Any = etree.fromstring(text)
    lines = {each.sourceline: own for each, own in zip(parsed.iter(), root.iter("*"), strict=True)}
    return text, lines


def check_names(doc: CheckedDocument, made: Mapping[str, list[str]] | None) -> None:
    """Report names used twice, and references to names that do not exist.

    Args:
        doc: The model.
        made: Names by kind as MuJoCo made them, which counts what `replicate` and `attach` add; None where MuJoCo
            could not parse the model.
    """
    known = _index(doc)
    expanded = next(doc.root.iter(*EXPANDERS), None) is not None
    if not doc.complete or (expanded and made is None):
        return
    for kind, names in (made or {}).items():
        known.setdefault(kind, set()).update(names)
    for element, kind, name in _references(doc.root):
        if name not in known.get(kind, ()):
            own = element.get("name")
            label = f"<{element.tag}>" + (f" {own!r}" if own else "")
            what = f"{label} refers to {unknown(doc, kind, name, known.get(kind, ()))}"
            doc.add("reference-unknown", element, what, name=own or name)
    classes = {each.get("class") for each in doc.root.iterfind(".//default")} | {"main"}
    for element in doc.root.iter("*"):
        for attribute in ("class", "childclass"):
            name = element.get(attribute)
            if name is not None and element.tag != "default" and name not in classes:
                listed = [each for each in classes if each]
                what = f"<{element.tag}> refers to {unknown(doc, 'default class', name, listed)}"
                doc.add("reference-unknown", element, what, name=element.get("name") or "")


def _index(doc: CheckedDocument) -> dict[str, set[str]]:
    """Names by kind; those used twice are reported."""
    known: dict[str, set[str]] = {}
    bodies = [each for world in elements(doc.root, "worldbody") for each in world.iter("*")]
    for kind, tags in _IN_BODIES.items():
        known[kind] = set(index_names(doc, [each for each in bodies if each.tag in tags], kind, required=False))
    known["body"].add("world")
    for kind, (section, tag) in _IN_SECTIONS.items():
        found = [
            each for part in elements(doc.root, section) for each in elements(part) if tag is None or each.tag == tag
        ]
        known[kind] = set(index_names(doc, found, kind, required=False))
        if kind in NAMED_BY_FILE:
            known[kind] |= {PurePosixPath(each.get("file", "")).stem for each in found if each.get("name") is None}
    return known


def _references(root: Any) -> Iterator[tuple[Any, str, str]]:
    """Yield element, kind and name of every reference."""
    for section in elements(root):
        if section.tag in _REFERRING:
            for element in section.iter("*"):
                if element is not section and element.tag not in _NOT_REFERRING:
                    yield from _named_by(element)
        elif section.tag in ("worldbody", "default"):
            for element in section.iter("geom", "site", "camera", "light", "material"):
                yield from _named_by(element)


def _named_by(element: Any) -> Iterator[tuple[Any, str, str]]:
    for kind, name in references(element):
        if name and kind in (*_IN_BODIES, *_IN_SECTIONS):
            yield element, kind, name


def check_unused(doc: CheckedDocument) -> None:
    """Report meshes, materials, textures, height fields and default classes that nothing uses."""
    if not doc.complete or next(doc.root.iter("attach", "model"), None) is not None:
        return
    used: dict[str, set[str]] = {kind: set() for kind in ASSETS}
    for element in doc.root.iter("*"):
        for kind, name in references(element):
            if kind in used:
                used[kind].add(name)
    for asset in (each for section in elements(doc.root, "asset") for each in elements(section, *ASSETS)):
        name = asset.get("name") or PurePosixPath(asset.get("file", "")).stem
        if name and name not in used[asset.tag] and asset.get("type") != "skybox":
            doc.add("asset-unused", asset, f"nothing uses {asset.tag} {name!r}", name=name)
    classes = {each.get(key) for each in doc.root.iter("*") for key in ("class", "childclass") if each.tag != "default"}
    for default in doc.root.iterfind(".//default//default"):
        nested = {each.get("class") for each in default.iter("default")}
        if default.get("class") and not nested & classes:
            name = default.get("class")
            doc.add("asset-unused", default, f"nothing uses default class {name!r}", name=name)
