"""Meshes and height fields of an MJCF's limbs: one of each size that limbs need."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from pathlib import PurePosixPath
from typing import Any

from morphkit.errors import AblationError
from morphkit.scaling.attributes import multiply
from morphkit.scaling.mjcf_limbs import Limbs, own_elements

_SIZES = {"mesh": ("scale", "1 1 1"), "hfield": ("size", "")}
"""Kind of asset -> the attribute for its size, and what that is where nothing says."""


def scale_meshes(limbs: Limbs) -> None:
    """Let every limb refer to meshes of its own size; a mesh that limbs of several sizes share is copied."""
    users = _users(limbs)
    for (kind, name), wanted in users.items():
        asset = next((each for each in limbs.root.iterfind(f"asset/{kind}") if _name(each) == name), None)
        if asset is None:
            continue  # MuJoCo, which compiles the variant, says what is missing
        if asset.find("plugin") is not None and any(length != 1 for length, _ in wanted):
            raise AblationError(
                f"line {asset.sourceline}: mesh {name!r} is made by a plugin, which cannot be scaled; leave the length"
                " of its limbs as it is"
            )
        _make_sizes(limbs, asset, kind, wanted)


def _users(limbs: Limbs) -> dict[tuple[str, str], list[tuple[float, Any]]]:
    """Kind and name of each asset -> the factor of the length of each element that uses it, and the element."""
    factors = {
        id(element): scale.length
        for name, scale in limbs.scales.items()
        for element in own_elements(limbs.bodies[name])
    }
    users: dict[tuple[str, str], list[tuple[float, Any]]] = {}
    for element in [each for world in limbs.root.iterfind("worldbody") for each in world.iter("geom", "site")]:
        for kind in _SIZES:
            if name := limbs.get(element, kind):
                users.setdefault((kind, name), []).append((factors.get(id(element), 1.0), element))
    return users


def _make_sizes(limbs: Limbs, asset: Any, kind: str, users: Sequence[tuple[float, Any]]) -> None:
    attribute, fallback = _SIZES[kind]
    size = limbs.get(asset, attribute, fallback)
    lengths = list(dict.fromkeys(length for length, _ in users))
    if 1.0 in lengths:
        lengths.remove(1.0)
    else:
        multiply(asset, attribute, lengths.pop(0), size)
    taken = {_name(each) for each in limbs.root.iterfind(f"asset/{kind}")}
    for length in lengths:
        made = copy.deepcopy(asset)
        made.set("name", _free(f"{_name(asset)}_x{length:g}", taken))
        multiply(made, attribute, length, size)
        asset.addnext(made)
        for wanted, element in users:
            if wanted == length:
                element.set(kind, made.get("name"))


def _name(asset: Any) -> str:
    return str(asset.get("name") or PurePosixPath(asset.get("file", "").replace("\\", "/")).stem)


def _free(name: str, taken: set[str]) -> str:
    number, free = 1, name
    while free in taken:
        number += 1
        free = f"{name}_{number}"
    taken.add(free)
    return free
