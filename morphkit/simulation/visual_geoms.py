"""What a robot wears to be looked at: which shapes show, sticks for limbs that have none, colors, a floor."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any

import mujoco
import numpy as np

from morphkit.readers.mjcf import subtree
from morphkit.simulation.ground import lowest_of

HIDDEN_GROUP = 5
_SHOWN_GROUPS = 3  # MuJoCo's viewers show groups 0 to 2.
_DEFAULT_COLOR = (0.5, 0.5, 0.5, 1.0)
# Of limbs whose shapes have no color, by the number of joints to the root.
_PALETTE = (
    (0.36, 0.42, 0.52, 1.0),
    (0.85, 0.53, 0.28, 1.0),
    (0.30, 0.58, 0.62, 1.0),
    (0.87, 0.71, 0.36, 1.0),
    (0.53, 0.44, 0.63, 1.0),
    (0.55, 0.67, 0.42, 1.0),
)
_DARKEST = 0.13  # A blacker black shows no shape.
_STICK_SHARE = 0.12  # Radius of a stick as a share of the robot's mean limb length.


def hide_collision_shapes(spec: mujoco.MjSpec) -> None:
    """Hide the collision shapes of bodies that have visual ones too, as a URDF means it, in place."""
    for body in spec.bodies:
        colliding = [geom for geom in body.geoms if geom.contype or geom.conaffinity]
        if len(colliding) < len(body.geoms) and body.name != "world":
            for geom in colliding:
                geom.group = HIDDEN_GROUP


def show_left_shapes(spec: mujoco.MjSpec, incomplete: Collection[str]) -> None:
    """Show the hidden shapes of bodies whose visible ones were left out, in place."""
    for name in incomplete:
        body = spec.body(name)
        if not any(geom.group < _SHOWN_GROUPS for geom in body.geoms):
            for geom in body.geoms:
                geom.group = 0


def add_sticks(spec: mujoco.MjSpec, root: Any, limb_of: dict[str, str]) -> None:
    """Draw limbs without any visible shape as sticks from joint to joint, in place. They weigh nothing.

    Args:
        spec: The model.
        root: Its body of the robot's root limb.
        limb_of: Body name -> limb name, for all bodies of the robot.
    """
    bodies = list(subtree(root))
    dressed = {limb_of[body.name] for body in bodies if any(geom.group < _SHOWN_GROUPS for geom in body.geoms)}
    naked = [body for body in bodies if limb_of[body.name] not in dressed]
    if not naked:
        return
    lengths = [float(np.linalg.norm(body.pos)) for body in bodies if body is not root]
    radius = _STICK_SHARE * float(np.mean([length for length in lengths if length > 0] or [0.2]))
    for body in naked:
        if limb_of[body.name] == body.name:
            _add_shape(body, mujoco.mjtGeom.mjGEOM_SPHERE, size=[1.3 * radius, 0, 0])
        for child in body.bodies:
            if np.linalg.norm(child.pos) > radius:
                _add_shape(body, mujoco.mjtGeom.mjGEOM_CAPSULE, size=[radius, 0, 0], fromto=[0, 0, 0, *child.pos])


def _add_shape(body: Any, kind: Any, **shape: Any) -> None:
    body.add_geom(type=kind, mass=0, contype=0, conaffinity=0, group=0, rgba=_DEFAULT_COLOR, **shape)


def visible_geoms(model: mujoco.MjModel) -> Iterator[int]:
    """Ids of the geoms that show, of whatever type."""
    for geom in range(model.ngeom):
        if model.geom_group[geom] < _SHOWN_GROUPS and geom_color(model, geom)[3] > 0:
            yield geom


def geom_color(model: mujoco.MjModel, geom: int) -> np.ndarray:
    """Red, green, blue and opacity of a geom, each 0 to 1, shape (4,)."""
    material = model.geom_matid[geom]
    color: np.ndarray = model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]
    return color


def color_limbs(model: mujoco.MjModel, root: int) -> None:
    """Give the robot's shapes that have no color of their own one that tells limb from limb, in place."""
    depth = {root: 0}
    for body in range(root + 1, model.nbody):
        parent = int(model.body_parentid[body])
        if parent in depth:
            depth[body] = depth[parent] + int(model.body_jntnum[body] > 0)
    for geom in range(model.ngeom):
        level = depth.get(int(model.geom_bodyid[geom]))
        if level is not None and model.geom_matid[geom] < 0:
            model.geom_rgba[geom, :3] = np.maximum(model.geom_rgba[geom, :3], _DARKEST)
        plain = model.geom_matid[geom] < 0 and np.allclose(model.geom_rgba[geom], _DEFAULT_COLOR)
        if level is not None and plain:
            model.geom_rgba[geom] = _PALETTE[level % len(_PALETTE)]


def lay_floor(model: mujoco.MjModel, floor: int, root: int, start: np.ndarray) -> None:
    """Move an added floor right below the robot in its start pose, in place.

    Args:
        model: The model.
        floor: Geom id of the floor.
        root: Body id of the robot's root.
        start: The pose, shape (nq,).
    """
    data = mujoco.MjData(model)
    data.qpos[:] = start
    mujoco.mj_kinematics(model, data)
    low = [
        lowest_of(model, data, geom)
        for geom in visible_geoms(model)
        if model.body_rootid[model.geom_bodyid[geom]] == model.body_rootid[root]
    ]
    model.geom_pos[floor, 2] = min(low, default=0.0)
    model.geom_sameframe[floor] = 0  # Else MuJoCo takes the world's frame for the geom's.
