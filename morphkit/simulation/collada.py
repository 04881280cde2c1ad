"""What has to be known of COLLADA files besides their triangles."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from lxml import etree

from morphkit.errors import AssetError

INSTANCES = 2000
"""How often a file may show its shapes in all."""
_UP_AXIS = re.compile(rb"<(?:\w+:)?up_axis>\s*([XYZ])_UP")
_ASSET_BYTES = 2**16  # <asset> comes first in the file.
_SHAPES = ("{*}instance_geometry", "{*}instance_controller")


def up_axis(path: Path) -> str | None:
    """The axis that a COLLADA file states as up: `X`, `Y` or `Z`; None for one that states none and for other files."""
    if path.suffix.lower() != ".dae":
        return None
    with path.open("rb") as file:
        found = _UP_AXIS.search(file.read(_ASSET_BYTES))
    return found[1].decode() if found is not None else None


def check_instances(path: Path) -> None:
    """Refuse a file whose nodes show others over and over: each can double what there is.

    Raises:
        AssetError: It shows its shapes more than 2000 times, or a node shows itself.
    """
    try:
        root = _tree(path).getroot()
    except (etree.XMLSyntaxError, OSError):  # the latter for bytes that are no text
        return  # which the reader says in its own words
    nodes = {node.get("id"): node for node in root.iter("{*}node") if node.get("id")}
    shown: dict[str, int] = {}
    opened: set[str] = set()
    pending = list(nodes)  # without recursion: those that a node shows are counted before it
    while pending:
        name = pending[-1]
        wanted = [target for target in _targets(nodes[name]) if target in nodes]
        missing = [target for target in dict.fromkeys(wanted) if target not in shown]
        if name in shown or not missing:
            shown[name] = _shapes(nodes[name]) + sum(shown[target] for target in wanted)
            opened.discard(name)
            pending.pop()
            continue
        opened.add(name)
        if opened.intersection(missing):
            raise AssetError(f"{path}: cannot be read as a mesh: node {name!r} shows itself")
        pending += missing
    scenes = root.iter("{*}visual_scene")
    total = sum(_shapes(scene) + sum(shown.get(target, 0) for target in _targets(scene)) for scene in scenes)
    if total > INSTANCES:
        raise AssetError(f"{path}: shows its shapes {total:,} times; the limit is {INSTANCES:,}")


def without_materials(path: Path) -> bytes:
    """The bytes of a COLLADA file whose nodes have no materials: one broken reference there drops the whole node."""
    tree = _tree(path)
    for element in list(tree.iter("{*}bind_material")):
        element.getparent().remove(element)
    return bytes(etree.tostring(tree))


def _tree(path: Path) -> Any:
    return etree.parse(path, etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, huge_tree=True))


def _targets(element: Any) -> list[str]:
    """Ids of the nodes that those in an element show, each as often as it is shown."""
    return [each.get("url", "")[1:] for each in element.iter("{*}instance_node")]


def _shapes(element: Any) -> int:
    return sum(1 for _ in element.iter(*_SHAPES))
