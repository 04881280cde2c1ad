"""Where a camera has to be to show a robot."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

FIELD_OF_VIEW = 40.0
"""Vertical, degrees."""
MARGIN = 1.1
"""Size of a picture as a share of what it shows."""
VIEWS = {"planar": (90.0, -8.0), "free": (125.0, -18.0), "fixed": (125.0, -18.0)}
"""How the root is attached -> azimuth and elevation of the camera, degrees."""


def viewpoint(
    model: Any, state: np.ndarray, *, root: int = 1, base: str = "free", aspect: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Where a camera has to be to show a robot, and what it looks at, world frame, m.

    Args:
        model: The MjModel.
        state: The pose, shape (nq,).
        root: Body id of the robot's root.
        base: How the root is attached; it chooses the side.
        aspect: Width of the picture by its height.
    """
    import mujoco

    camera = mujoco.MjvCamera()
    camera.azimuth, camera.elevation = VIEWS.get(base, VIEWS["free"])
    data = mujoco.MjData(model)
    target, distance, _ = view_of_all(model, data, np.atleast_2d(state), root, camera, aspect)
    return target - distance * _forward(camera), target


def view_of_all(
    model: Any, data: Any, states: np.ndarray, root: int, camera: Any, aspect: float
) -> tuple[np.ndarray, float, float]:
    """Where a camera of given direction has to be to show the robot in all states.

    Returns:
        What it looks at, world frame, m; its distance from there, m; half of the diagonal of the robot's box, m.
    """
    corners = np.concatenate([_corners(model, data, state, root) for state in states])
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    forward = _forward(camera)
    right = np.array([forward[1], -forward[0], 0.0]) / np.hypot(*forward[:2])
    away = corners - middle
    upward = np.tan(np.radians(FIELD_OF_VIEW / 2)) / MARGIN
    across = np.abs(away @ right) / (upward * aspect)
    high = np.abs(away @ np.cross(right, forward)) / upward
    distance = np.max(np.maximum(across, high) - away @ forward)
    size = float(np.linalg.norm(corners.max(axis=0) - corners.min(axis=0)) / 2)
    return middle, float(distance), size


def move(model: Any, data: Any, state: np.ndarray) -> None:
    """Put a model into a state, shape (nq,), as far as pictures show it."""
    import mujoco

    data.qpos[:] = state
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)
    mujoco.mj_tendon(model, data)


def _corners(model: Any, data: Any, state: np.ndarray, root: int) -> np.ndarray:
    """Corners of the boxes around all geoms of the robot, world frame, m, shape (n, 3)."""
    move(model, data, state)
    mine = np.flatnonzero(model.body_rootid[model.geom_bodyid] == model.body_rootid[root])
    if not len(mine):
        return np.array(data.xpos[root]) + np.array([[-0.5] * 3, [0.5] * 3])
    signs = np.array(list(itertools.product((-1, 1), repeat=3)))
    local = model.geom_aabb[mine, None, :3] + signs * model.geom_aabb[mine, None, 3:]
    turned = np.einsum("gij,gcj->gci", data.geom_xmat[mine].reshape(-1, 3, 3), local)
    found: np.ndarray = (turned + data.geom_xpos[mine, None]).reshape(-1, 3)
    return found


def _forward(camera: Any) -> np.ndarray:
    azimuth, elevation = np.radians((camera.azimuth, camera.elevation))
    return np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
