"""Whether a robot with legs stands where it starts; runs in the child of `probe`."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from morphkit.simulation.ground import can_touch, lowest_point
from morphkit.simulation.spec import compile_spec

LEAST_RAD = 0.2
"""The angle below which servos that give way a little under the robot's weight may let it tip over."""
_TOUCHING_M = 0.01
_FLOOR = "morphkit_balance"
_ANGLES = np.linspace(0, 2 * math.pi, 180, endpoint=False)


def tips_at(spec: mujoco.MjSpec, start: np.ndarray, file: str) -> float | None:
    """The angle by which gravity has to turn for a robot to tip over where it starts, rad.

    Then the center of mass is above the edge of what the robot stands on.

    Args:
        spec: The robot; changed in place.
        start: The pose, (nq,).
        file: What the robot is called in messages.

    Returns:
        The angle, negative where it tips over by itself; None for a robot that does not stand on two limbs or more.
    """
    plain = compile_spec(spec, file)
    root = int(np.flatnonzero(plain.body_parentid == 0)[1])
    floor = lowest_point(plain, root, start)
    spec.worldbody.add_geom(
        name=_FLOOR, type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 1], pos=[0, 0, floor], margin=_TOUCHING_M
    )
    model = compile_spec(spec, file)
    data = mujoco.MjData(model)
    data.qpos[:] = start
    mujoco.mj_forward(model, data)
    plane = model.geom(_FLOOR).id
    contacts = [each for each in data.contact[: data.ncon] if plane in each.geom]
    limbs = {
        int(model.body_weldid[model.geom_bodyid[geom]]) for each in contacts for geom in each.geom if geom != plane
    }
    if len(limbs) < 2 or int(model.body_weldid[root]) in limbs or not can_touch(plain).any():
        return None
    center = data.subtree_com[root]
    way = np.array([each.pos[:2] for each in contacts]) - center[:2]
    support = (way @ np.stack([np.cos(_ANGLES), np.sin(_ANGLES)])).max(0)
    return math.atan2(float(support.min()), max(float(center[2]) - floor, 1e-6))
