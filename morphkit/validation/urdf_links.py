"""Checks of the links of a URDF: masses, inertias, shapes and meshes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from morphkit.formats.assets import reference_in_urdf
from morphkit.formats.poses import Pose, identity, numbers, urdf_pose
from morphkit.simulation.inertia import LEAST_MASS
from morphkit.simulation.urdf_shapes import shape_fault, shape_of
from morphkit.validation.balance import LEAST_RAD
from morphkit.validation.common import read_numbers
from morphkit.validation.document import CheckedDocument, elements
from morphkit.validation.inertia import check_tensor, symmetric
from morphkit.validation.meshes import MeshUse
from morphkit.validation.urdf_tree import UrdfTree

_ONE, _THREE = range(1, 2), range(3, 4)
_MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
_NOTABLE_SHARE = 0.02
_MOVING = ("revolute", "continuous", "prismatic", "floating", "planar", "spherical")


@dataclass
class Inertial:
    """Mass, center of mass and tensor of a link, as far as they make sense.

    Attributes:
        element: The `<inertial>`.
        mass: kg.
        center: Center of mass in the link's frame, m.
        tensor: Inertia about the center of mass, kg*m^2; None where it is impossible or zero.
        counts: Whether the link is a notable part of what it is fixed to.
    """

    element: Any
    mass: float
    center: np.ndarray | None
    tensor: np.ndarray | None = None
    counts: bool = True


def check_links(doc: CheckedDocument, tree: UrdfTree) -> tuple[dict[str, Inertial], list[MeshUse]]:
    """Report what is wrong with links by themselves; return their inertials and the meshes that are there."""
    inertials: dict[str, Inertial] = {}
    uses: list[MeshUse] = []
    for name, link in tree.links.items():
        inertial = _check_inertial(doc, name, link)
        if inertial is not None:
            inertials[name] = inertial
    _mark_negligible(tree, inertials)
    for name, link in tree.links.items():
        if name in inertials:
            inertials[name].tensor = _tensor(doc, name, inertials[name])
        for part in elements(link, "visual", "collision"):
            uses += _check_shape(doc, name, part)
    for carrier, group in tree.groups():
        if carrier is None or tree.joints[carrier].get("type") not in _MOVING:
            continue
        if not any(name in inertials for name in group):
            first = tree.links[group[0]]
            what = f"link {group[0]!r} on joint {carrier!r} has no mass"
            doc.add("mass-missing", first, what, name=group[0])
        parts = [part.tag for name in group for part in elements(tree.links[name], "visual", "collision")]
        if "visual" in parts and "collision" not in parts:
            doc.add("collision-missing", tree.links[group[0]], f"link {group[0]!r}", name=group[0])
    return inertials, uses


def check_overlaps(doc: CheckedDocument, tree: UrdfTree, touching: Sequence[Mapping[str, Any]]) -> None:
    """Report links that overlap where the robot starts; `touching` is what `overlaps` found."""
    for each in touching:
        first, second = each["bodies"]
        what = f"links {first!r} and {second!r} overlap by {each['depth'] * 1000:.3g} mm"
        doc.add("links-overlap", tree.links.get(second, doc.root), what, name=second)


def check_balance(doc: CheckedDocument, tips_at: float | None) -> None:
    """Report a robot that barely stands where it starts; `tips_at` is what `balance` found, rad."""
    if tips_at is None or tips_at >= LEAST_RAD:
        return
    what = f"when it has tilted by {tips_at:.2g} rad" if tips_at > 0 else "by itself"
    doc.add("start-tips", doc.root, f"where it starts, the robot tips over {what}")


def _check_inertial(doc: CheckedDocument, name: str, link: Any) -> Inertial | None:
    """Return the link's inertial where it has a mass above zero."""
    owner = f"link {name!r}"
    element = next(iter(elements(link, "inertial")), None)
    if element is None:
        return None
    mass: float | None = None
    for each in elements(element, "mass"):
        numbers = read_numbers(doc, each, "value", _ONE, owner=owner)
        mass = numbers[0] if numbers is not None else None
        if mass is not None and mass < 0:
            doc.add("mass-negative", each, f"{owner} has mass {mass:g} kg", name=name)
    pose = _pose(doc, element, owner)
    center = pose.position if pose is not None else None
    if mass is None or mass <= 0:
        return None
    if mass < LEAST_MASS:
        doc.add("mass-missing", element, f"{owner} has mass {mass:g} kg, which counts as none", name=name)
        return None
    return Inertial(element, mass, center)


def _mark_negligible(tree: UrdfTree, inertials: Mapping[str, Inertial]) -> None:
    """Links that stand for a frame get some grams and any inertia; the simulators that fuse links never see it."""
    for _, group in tree.groups():
        total = sum(inertials[name].mass for name in group if name in inertials)
        for name in group:
            if name in inertials:
                inertials[name].counts = inertials[name].mass >= _NOTABLE_SHARE * total


def _tensor(doc: CheckedDocument, name: str, inertial: Inertial) -> np.ndarray | None:
    owner, mass = f"link {name!r}", inertial.mass
    for element in elements(inertial.element, "inertia"):
        found = [read_numbers(doc, element, key, _ONE, owner=owner) for key in _MOMENTS]
        if any(element.get(key) is None for key in _MOMENTS[:3]):
            return None  # reported as incomplete
        if any(numbers is None and element.get(key) is not None for key, numbers in zip(_MOMENTS, found, strict=True)):
            return None
        tensor = symmetric(*(numbers[0] if numbers is not None else 0.0 for numbers in found))
        proper = check_tensor(doc, element, tensor, mass=mass, owner=owner, name=name, counts=inertial.counts)
        return tensor if proper else None
    return None


def _check_shape(doc: CheckedDocument, name: str, part: Any) -> list[MeshUse]:
    """Check a visual or collision; return its mesh, if it has one that is there."""
    owner = f"a {part.tag} of link {name!r}"
    pose = _pose(doc, part, owner)
    fault, shape = shape_fault(part), shape_of(part)
    if shape is not None and len(shape.get("scale", "1 1 1").split()) != 3:
        doc.add("number-invalid", shape, f"{owner} has scale {shape.get('scale')!r}, expected 3 numbers", name=name)
    elif fault is not None:
        doc.add(fault.rule, fault.element, f"{owner} {fault.text}", name=name)
    if fault is not None:
        return []
    for texture in part.iter("texture"):
        _find(doc, texture, owner, name, decorates=True)
    return _check_mesh(doc, name, part, shape, owner, pose) if shape.tag == "mesh" else []


def _check_mesh(doc: CheckedDocument, name: str, part: Any, shape: Any, owner: str, pose: Pose | None) -> list[MeshUse]:
    path = _find(doc, shape, owner, name, decorates=part.tag == "visual")
    if path is None or pose is None:
        return []
    return [MeshUse(shape, name, owner, path, np.resize(numbers(shape.get("scale", "1")), 3), pose)]


def _pose(doc: CheckedDocument, element: Any, owner: str) -> Pose | None:
    """The pose that the `<origin>` of an element gives; None where its numbers are wrong, which is then reported."""
    origin = next(iter(elements(element, "origin")), None)
    if origin is None:
        return identity()
    proper = [
        read_numbers(doc, origin, key, _THREE, owner=owner) is not None or origin.get(key) is None
        for key in ("xyz", "rpy")
    ]
    return urdf_pose(origin) if all(proper) else None


def _find(doc: CheckedDocument, element: Any, owner: str, name: str, *, decorates: bool) -> Path | None:
    rule = "mesh-missing-visual" if decorates else "mesh-missing"
    return doc.find_asset(element, reference_in_urdf(element, doc.locate), owner, name, missing=rule)
