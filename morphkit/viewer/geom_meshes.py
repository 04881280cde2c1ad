"""Triangles of MuJoCo's shapes, for viewers that draw triangles only."""

from __future__ import annotations

import numpy as np
import trimesh
from mujoco import MjModel, mjtGeom

_SHARP = np.radians(30)
_MOST_FACES = 40_000  # Smoothing takes too long for more.


def surface(model: MjModel, geom: int) -> trimesh.Trimesh | None:
    """The surface of a geom in the geom's own frame, m, with vertices doubled at sharp edges; None without a surface.

    Planes and height fields have none here.
    """
    size = np.array(model.geom_size[geom])
    kind = mjtGeom(model.geom_type[geom])
    if kind == mjtGeom.mjGEOM_SPHERE:
        return trimesh.creation.icosphere(subdivisions=3, radius=size[0])
    if kind == mjtGeom.mjGEOM_ELLIPSOID:
        return trimesh.creation.icosphere(subdivisions=3).apply_scale(size)
    if kind == mjtGeom.mjGEOM_CAPSULE:
        return trimesh.creation.capsule(radius=size[0], height=2 * size[1], count=[24, 24])
    if kind == mjtGeom.mjGEOM_CYLINDER:
        return _creased(trimesh.creation.cylinder(radius=size[0], height=2 * size[1], sections=48))
    if kind == mjtGeom.mjGEOM_BOX:
        return _creased(trimesh.creation.box(extents=2 * size))
    mesh = int(model.geom_dataid[geom])
    if kind == mjtGeom.mjGEOM_MESH and mesh >= 0:
        vertices = slice(model.mesh_vertadr[mesh], model.mesh_vertadr[mesh] + model.mesh_vertnum[mesh])
        faces = slice(model.mesh_faceadr[mesh], model.mesh_faceadr[mesh] + model.mesh_facenum[mesh])
        return _creased(trimesh.Trimesh(model.mesh_vert[vertices], model.mesh_face[faces], process=False))
    return None


def _creased(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    return trimesh.graph.smooth_shade(mesh, angle=_SHARP) if len(mesh.faces) <= _MOST_FACES else mesh
