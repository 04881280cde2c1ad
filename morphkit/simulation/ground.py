"""How high a robot stands: its lowest point, and the ground below it."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

_VERTICAL = 1 - 1e-9


def can_touch(model: mujoco.MjModel) -> np.ndarray:
    """Which geoms can touch something, bool (ngeom,)."""
    return np.asarray((model.geom_contype > 0) | (model.geom_conaffinity > 0))


def ground_height(model: mujoco.MjModel, touching: np.ndarray | None = None) -> float | None:
    """Height of the ground above the world's origin, m; None where it is not a level plane, or there is more than that.

    Args:
        model: The model.
        touching: Which geoms can touch something, bool (ngeom,); None takes what the model says.
    """
    fixed = model.body_weldid[model.geom_bodyid] == 0
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    heights = []
    for geom in np.flatnonzero(fixed & (can_touch(model) if touching is None else touching)):
        if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_PLANE or data.geom_xmat[geom, 8] < _VERTICAL:
            return None
        heights.append(float(data.geom_xpos[geom, 2]))
    return max(heights, default=None)


def raise_root(spec: mujoco.MjSpec, root: Any, model: mujoco.MjModel, qpos: np.ndarray) -> None:
    """Raise (or lower) the root until the robot touches the ground, or height 0 where there is none.

    Args:
        spec: Changed in place.
        root: A top-level body; one within a frame is taken out of it, so that its `pos` is in the world.
        model: `spec` compiled.
        qpos: The pose in which it touches, (nq,).
    """
    own = model.body(root.name)
    if root.frame is not None:
        root.set_frame(spec.worldbody.add_frame())
        root.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
        root.pos, root.quat = own.pos, own.quat
    root.pos[2] += (ground_height(model) or 0.0) - lowest_point(model, own.id, qpos)


def lowest_point(
    model: mujoco.MjModel, root: int, qpos: np.ndarray | None = None, touching: np.ndarray | None = None
) -> float:
    """Height above the world's origin, m, of the lowest point of the robot's geoms.

    Geoms that can touch something count; where none can, all do.

    Args:
        model: The model.
        root: Body id of the robot's root.
        qpos: The pose, (nq,); None for the model's zero pose.
        touching: Which geoms can touch something, bool (ngeom,); None takes what the model says.
    """
    data = mujoco.MjData(model)
    if qpos is not None:
        data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    own = model.body_rootid[model.geom_bodyid] == root
    counted = own & (can_touch(model) if touching is None else touching)
    geoms = np.flatnonzero(counted if counted.any() else own)
    return min((lowest_of(model, data, geom) for geom in geoms), default=float(data.xpos[root, 2]))


def lowest_of(model: mujoco.MjModel, data: mujoco.MjData, geom: int | np.integer) -> float:
    """Lowest height of one geom, m; that of its bounding sphere where the type is not known here."""
    types, size = mujoco.mjtGeom, model.geom_size[geom]
    height, down = float(data.geom_xpos[geom, 2]), data.geom_xmat[geom].reshape(3, 3)[2]
    kind = model.geom_type[geom]
    if kind == types.mjGEOM_SPHERE:
        return height - float(size[0])
    if kind == types.mjGEOM_CAPSULE:
        return height - float(abs(down[2]) * size[1] + size[0])
    if kind == types.mjGEOM_CYLINDER:
        return height - float(abs(down[2]) * size[1] + size[0] * np.sqrt(max(0.0, 1 - down[2] ** 2)))
    if kind == types.mjGEOM_ELLIPSOID:
        return height - float(np.linalg.norm(down * size))
    if kind == types.mjGEOM_BOX:
        return height - float(np.abs(down) @ size)
    if kind == types.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        first = model.mesh_vertadr[mesh]
        return height + float((model.mesh_vert[first : first + model.mesh_vertnum[mesh]] @ down).min())
    return height - float(model.geom_rbound[geom])
