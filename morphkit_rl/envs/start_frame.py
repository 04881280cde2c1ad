"""Where a robot's root starts."""

from __future__ import annotations

import mujoco
import numpy as np

from morphkit.simulation.build import Simulation
from morphkit.simulation.ground import lowest_point


def start_frame(simulation: Simulation) -> np.ndarray:
    """World position (3, m) and quaternion (4, real part first) of the root's frame in the start pose."""
    data = mujoco.MjData(simulation.model)
    data.qpos[:] = simulation.start
    mujoco.mj_kinematics(simulation.model, data)
    root = simulation.limb_body[0]
    return np.concatenate([data.xpos[root], data.xquat[root]])


def start_height(simulation: Simulation) -> float:
    """Height of the root's frame at the start, m; where that is at the ground or below it, the `stature`."""
    start, high = float(start_frame(simulation)[2]), stature(simulation)
    return start if start > high / 2 else high


def stature(simulation: Simulation) -> float:
    """How high the center of mass lies above the lowest point in the start pose, m."""
    model, root = simulation.model, simulation.limb_body[0]
    data = mujoco.MjData(model)
    data.qpos[:] = simulation.start
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    return float(data.subtree_com[root, 2]) - lowest_point(model, root, simulation.start)
