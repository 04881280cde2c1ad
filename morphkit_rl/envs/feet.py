"""Feet: what of a robot touches the ground first."""

from __future__ import annotations

import mujoco
import numpy as np

from morphkit.simulation.build import Simulation
from morphkit.simulation.ground import can_touch, ground_height, lowest_of, lowest_point

CONTACT_M = 0.005
"""Height above the floor up to which a foot touches it."""
_SHARE = 0.25  # of the height at which the root starts


class Feet:
    """The lowest geom of each limb that ends a chain and starts near the ground.

    Attributes:
        limbs: Index of the limb of each foot, int (feet,).
        center: Center of its lowest geom in the limb's frame, m, (feet, 3).
        radius: How far the geom reaches below its center in the start pose, m, (feet,).
        floor: Height of the ground, m; that of the robot's lowest point at the start where it is not level.
    """

    def __init__(self, simulation: Simulation) -> None:
        model, limbs = simulation.model, simulation.morphology.limbs
        data = mujoco.MjData(model)
        data.qpos[:] = simulation.start
        mujoco.mj_kinematics(model, data)
        root, touching = simulation.limb_body[0], can_touch(model)
        lowest = lowest_point(model, root, simulation.start)
        ground = ground_height(model)
        self.floor = lowest if ground is None else ground
        reach = lowest + _SHARE * max(float(data.xpos[root, 2]) - lowest, 1e-6)
        parents = {limb.parent for limb in limbs}
        found: list[tuple[int, np.ndarray, float]] = []
        for index, limb in enumerate(limbs):
            if limb.name in parents:
                continue
            members = {model.body(name).id for name in limb.members}
            geoms = [g for g in range(model.ngeom) if model.geom_bodyid[g] in members and touching[g]]
            low, geom = min(((lowest_of(model, data, g), g) for g in geoms), default=(np.inf, -1))
            if low <= reach:
                body = simulation.limb_body[index]
                offset = data.geom_xpos[geom] - data.xpos[body]
                center = data.xmat[body].reshape(3, 3).T @ offset
                found.append((index, center, float(data.geom_xpos[geom, 2]) - low))
        self.limbs = np.array([index for index, _, _ in found], int)
        self.center = np.array([center for _, center, _ in found]).reshape(-1, 3)
        self.radius = np.array([radius for _, _, radius in found])
