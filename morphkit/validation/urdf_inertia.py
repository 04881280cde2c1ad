"""Whether the masses and inertias in a URDF fit the shapes of their links."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from morphkit.formats.poses import Pose, urdf_pose
from morphkit.validation.document import CheckedDocument, elements
from morphkit.validation.mass_properties import Shape, box, check_body
from morphkit.validation.meshes import MeshFacts, MeshUse, corners
from morphkit.validation.urdf_links import Inertial
from morphkit.validation.urdf_tree import UrdfTree


def check_masses(
    doc: CheckedDocument,
    tree: UrdfTree,
    inertials: Mapping[str, Inertial],
    uses: Sequence[MeshUse],
    facts: Mapping[str, MeshFacts],
) -> None:
    """Report masses and inertias that do not fit the shapes of their link."""
    mesh_at = {id(use.element): use for use in uses}
    for name, inertial in inertials.items():
        if not inertial.counts:
            continue
        groups: list[list[Shape]] = []
        for tag in ("visual", "collision"):
            parts = elements(tree.links[name], tag)
            shapes = [_shape(part, mesh_at, facts) for part in parts]
            groups.append([shape for shape in shapes if shape is not None] if None not in shapes else [])
        check_body(
            doc,
            inertial.element,
            name,
            mass=inertial.mass,
            center=inertial.center,
            tensor=inertial.tensor,
            shapes=groups,
        )


def _shape(part: Any, mesh_at: Mapping[int, MeshUse], facts: Mapping[str, MeshFacts]) -> Shape | None:
    """Volume and corners of a visual or collision; None where they are not known."""
    shape = next(iter(part.iterfind("geometry/*")), None)
    if shape is None:
        return None
    use = mesh_at.get(id(shape))
    if use is not None:
        known = facts.get(str(use.path))
        if known is None or known.problem:
            return None
        volume = known.volume * float(abs(np.prod(use.scale)))
        return Shape(volume, corners(known.bounds, use.scale, use.pose))
    try:
        pose = urdf_pose(next(iter(elements(part, "origin")), None))
        sizes = [float(word) for key in ("size", "radius", "length") for word in shape.get(key, "").split()]
    except (ValueError, TypeError):
        return None  # no numbers, which is reported
    proper = pose.position.shape == (3,) and np.isfinite(pose.position).all() and np.isfinite(sizes).all()
    if not proper or min(sizes, default=0.0) <= 0:
        return None
    return _primitive(str(shape.tag), sizes, pose)


def _primitive(kind: str, sizes: Sequence[float], pose: Pose) -> Shape | None:
    """A box (x, y, z), sphere (radius), cylinder or capsule (radius, length); None for another number of sizes."""
    if kind == "box" and len(sizes) == 3:
        return box(float(np.prod(sizes)), np.array(sizes) / 2, pose)
    radius = sizes[0]
    ball = 4 / 3 * np.pi * radius**3
    if kind == "sphere" and len(sizes) == 1:
        return box(ball, (radius, radius, radius), pose)
    if kind not in ("cylinder", "capsule") or len(sizes) != 2:
        return None
    tube, half = np.pi * radius**2 * sizes[1], sizes[1] / 2
    if kind == "cylinder":
        return box(tube, (radius, radius, half), pose)
    return box(tube + ball, (radius, radius, half + radius), pose)
