"""The tip of a robot: what an arm reaches with."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from morphkit.simulation.actuation import drives
from morphkit.simulation.build import Simulation

_SHARE = 0.8
"""Of the way that a servo goes."""


class Tip(NamedTuple):
    """The far end of the last limb of the deepest chain, twice as far from its frame as its center of mass.

    Attributes:
        limb: Index of the limb.
        point: The tip in the limb's frame, m, (3,).
        reach: Length of the chain from the root's frame to there, m.
    """

    limb: int
    point: np.ndarray
    reach: float


def find_tip(simulation: Simulation) -> Tip:
    """The tip of a robot."""
    model, limbs = simulation.model, simulation.morphology.limbs
    index = {limb.name: i for i, limb in enumerate(limbs)}
    chains = [[0]]
    for i, limb in enumerate(limbs[1:], 1):
        chains.append([*chains[index[limb.parent or ""]], i])
    chain = max(reversed(chains), key=len)
    point = 2 * model.body_ipos[simulation.limb_body[chain[-1]]]
    data = mujoco.MjData(model)
    data.qpos[:] = simulation.start
    mujoco.mj_kinematics(model, data)
    places = data.xpos[simulation.limb_body[chain]]
    reach = float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum() + np.linalg.norm(point))
    return Tip(chain[-1], point, max(reach, 1e-6))


class Targets:
    """Draws places that the tip can be at: where it is at random joint angles.

    Angles are within the limits of the joints, and of those with servos within 80 % of the way that these go: gravity
    keeps servos from where they are told to go.

    Args:
        simulation: The robot.
    """

    def __init__(self, simulation: Simulation) -> None:
        self._model, self._tip = simulation.kinematics, find_tip(simulation)
        self._data = mujoco.MjData(self._model)
        self._body = int(simulation.limb_body[self._tip.limb])
        own = [joint for joints in simulation.limb_joints for joint in joints]
        kinds = self._model.jnt_type[own]
        turning = (kinds == int(mujoco.mjtJoint.mjJNT_HINGE)) | (kinds == int(mujoco.mjtJoint.mjJNT_SLIDE))
        joints = np.array(own, int)[turning]
        limited = self._model.jnt_limited[joints] != 0
        self._address = self._model.jnt_qposadr[joints]
        free = np.where(self._model.jnt_type[joints] == int(mujoco.mjtJoint.mjJNT_HINGE), np.pi, 0.0)
        self._low = np.where(limited, self._model.jnt_range[joints, 0], -free)
        self._high = np.where(limited, self._model.jnt_range[joints, 1], free)
        for drive in drives(simulation.model, simulation.morphology.actuators, simulation.start):
            place = np.flatnonzero(joints == simulation.model.dof_jntid[drive.dof])
            if drive.own is not None and simulation.model.actuator_ctrllimited[drive.index]:
                low, high = np.sort(simulation.model.actuator_ctrlrange[drive.index] / drive.gear)
                spared = (1 - _SHARE) / 2 * (high - low)
                self._low[place] = np.clip(low + spared, self._low[place], self._high[place])
                self._high[place] = np.clip(high - spared, self._low[place], self._high[place])

    def draw(self, rng: np.random.Generator, start: np.ndarray) -> np.ndarray:
        """Places for the tip of a robot with coordinates `start`, (k, nq), all but its limbs' joints; (k, 3), m.

        Of ten draws the first above the floor counts, if there is one.
        """
        places = np.zeros((len(start), 3))
        for place, qpos in zip(places, start, strict=True):
            for _ in range(10):
                self._data.qpos[:] = qpos
                self._data.qpos[self._address] = rng.uniform(self._low, self._high)
                mujoco.mj_kinematics(self._model, self._data)
                place[:] = self._data.xpos[self._body]
                place += self._data.xmat[self._body].reshape(3, 3) @ self._tip.point
                if place[2] > 0:
                    break
        return places
