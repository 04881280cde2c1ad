"""Checks of meshes: can they be read, are they as large as a robot's parts, do masses fit them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from morphkit.formats.poses import Pose
from morphkit.simulation.mesh_files import MAX_STL_FACES
from morphkit.validation.document import CheckedDocument

FORMATS = (".stl", ".obj", ".msh")
"""What MuJoCo reads."""

LARGEST_M, SMALLEST_M = 10.0, 1e-4
LIGHTEST, DENSEST = 5.0, 25_000.0  # kg/m^3


@dataclass(frozen=True)
class MeshUse:
    """A mesh in a description.

    Attributes:
        element: Where it is named.
        link: The link or body that it belongs to; empty for an asset.
        owner: What uses it, for messages.
        path: The file.
        scale: Factors along its axes, (3,).
        pose: Its pose in the frame of the link.
    """

    element: Any
    link: str
    owner: str
    path: Path
    scale: np.ndarray
    pose: Pose


@dataclass(frozen=True)
class MeshFacts:
    """What a mesh file holds, in its own unit scaled to meters where it states one.

    Attributes:
        bounds: Lowest and highest corner, (2, 3).
        volume: Volume of its convex hull; 0 where it is flat.
        faces: Number of triangles.
        problem: Why it cannot be read; else empty.
        up_axis: The axis that a COLLADA file states as up: `X`, `Y` or `Z`; else None.
    """

    bounds: np.ndarray
    volume: float
    faces: int
    problem: str = ""
    up_axis: str | None = None


def check_meshes(doc: CheckedDocument, uses: Sequence[MeshUse], facts: Mapping[str, MeshFacts]) -> None:
    """Report meshes that cannot be read or have an unlikely size; `facts` is keyed by path."""
    _check_formats(doc, uses)
    _check_up_axes(doc, uses, facts)
    for use in uses:
        known = facts.get(str(use.path))
        if known is None:
            continue
        if known.problem:
            doc.add("mesh-unreadable", use.element, f"{use.owner}: {use.path.name}: {known.problem}", name=use.link)
            continue
        if known.faces > MAX_STL_FACES and use.path.suffix.lower() == ".stl":
            doc.add("mesh-faces", use.element, f"{use.owner}: {use.path.name} has {known.faces} faces", name=use.link)
        size = np.abs((known.bounds[1] - known.bounds[0]) * use.scale)
        if size.max() > LARGEST_M or size.max() < SMALLEST_M:
            shown = " x ".join(f"{length:.3g}" for length in size)
            doc.add("mesh-scale", use.element, f"{use.owner}: {use.path.name} measures {shown} m", name=use.link)


def _check_formats(doc: CheckedDocument, uses: Sequence[MeshUse]) -> None:
    """Report each format that MuJoCo does not read once."""
    others: dict[str, dict[Path, Any]] = {}
    for use in uses:
        suffix = use.path.suffix.lower()
        if suffix not in FORMATS:
            others.setdefault(suffix, {}).setdefault(use.path, use.element)
    for suffix, paths in others.items():
        first = next(iter(paths))
        number = "1 mesh is" if len(paths) == 1 else f"{len(paths)} meshes are"
        doc.add("mesh-format", paths[first], f"{number} {suffix or 'without a suffix'}, such as {first.name}")


def _check_up_axes(doc: CheckedDocument, uses: Sequence[MeshUse], facts: Mapping[str, MeshFacts]) -> None:
    """Report once that there are meshes which some tools turn."""
    turned: dict[Path, MeshUse] = {}
    for use in uses:
        known = facts.get(str(use.path))
        if known is not None and known.up_axis in ("X", "Y"):
            turned.setdefault(use.path, use)
    if turned:
        first = next(iter(turned.values()))
        axis = facts[str(first.path)].up_axis
        number = "1 COLLADA mesh states" if len(turned) == 1 else f"{len(turned)} COLLADA meshes state"
        doc.add("mesh-up-axis", first.element, f"{number} another up axis than z, such as {first.path.name} ({axis})")


def check_density(doc: CheckedDocument, element: Any, name: str, mass: float, volume: float) -> None:
    """Report a mass, kg, that cannot fill a volume, m^3, or would be lost in it."""
    if volume <= 0:
        return
    density = mass / volume
    if not LIGHTEST <= density <= DENSEST:
        what = f"{name!r} weighs {mass:.4g} kg in shapes of {volume:.4g} m^3: {density:.3g} kg/m^3"
        doc.add("mass-density", element, what, name=name)


def corners(bounds: np.ndarray, scale: np.ndarray, pose: Pose) -> np.ndarray:
    """The corners of a mesh's bounding box in the frame of its link, (8, 3), m."""
    grid = np.array([[bounds[i, 0], bounds[j, 1], bounds[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    return np.array([pose.apply(corner) for corner in grid * scale])
