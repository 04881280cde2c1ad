"""Meshes, height fields, materials and textures that nothing uses any more after a cut."""

from __future__ import annotations

import posixpath
from collections.abc import Iterator
from typing import Any

from morphkit.ablation.loss import Loss
from morphkit.formats.edit import detach, detach_emptied
from morphkit.formats.mjcf_schema import ASSETS, references


class Uses:
    """Which assets of a description are used before a cut; `drop` takes out those that no longer are.

    What was unused from the start stays, and so do sky boxes and what a default class names.
    """

    def __init__(self, root: Any) -> None:
        self._before = _used(root)

    def drop(self, root: Any) -> Iterator[Loss]:
        """Take out the assets that only removed limbs used, and what only those assets used."""
        assets = list(_assets(root))
        while True:
            used = _used(root)
            idle = [item for item in assets if item[:2] in self._before - used]
            if not idle:
                return
            for kind, name, element in idle:
                assets.remove((kind, name, element))
                section = element.getparent()
                detach(element)
                if section.tag == "asset":
                    detach_emptied(section)
                yield Loss(kind, name, "", "only removed limbs used it")


def _assets(root: Any) -> Iterator[tuple[str, str, Any]]:
    """Kind, name and element of every asset that can be referred to; in a URDF the robot's own materials."""
    for element in root.iterfind("asset/*") if root.tag == "mujoco" else root.iterfind("material"):
        if element.tag in ASSETS:
            stem = posixpath.splitext(posixpath.basename(element.get("file", "")))[0]
            name = element.get("name") or stem
            if name:
                yield str(element.tag), name, element


def _used(root: Any) -> set[tuple[str, str]]:
    """Kind and name of everything that some element refers to."""
    used: set[tuple[str, str]] = set()
    for element in root.iter():
        if not isinstance(element.tag, str):
            continue
        if root.tag == "robot":
            if element.tag == "material" and element.getparent() is not root:
                used.add(("material", element.get("name", "")))
            continue
        used.update((kind, name) for kind, name in references(element) if kind in ASSETS)
    return used
