"""Masses, centers of mass and inertias of limbs."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from morphkit.simulation.inspection_model import Mechanics

_NOTHING = 1e-10  # kg: less than this is what MuJoCo needs to accept a body, and no mass


@dataclass(frozen=True, slots=True)
class LimbMass:
    """What a limb weighs, with all that is fixed to it.

    Attributes:
        mass: kg; 0 for a limb without a mass.
        center: Center of mass in the frame of the limb's body, m.
        moments: Principal moments of inertia about the center of mass, the smallest first, kg*m^2.
    """

    mass: float
    center: tuple[float, float, float]
    moments: tuple[float, float, float]


def limb_masses(mechanics: Mechanics) -> dict[str, LimbMass | None]:
    """The mass of every limb, in limb order; None where it follows from a shape that is missing."""
    model = mechanics.model
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    bodies: dict[str, list[int]] = {limb.name: [] for limb in mechanics.morphology.limbs}
    for body, limb in mechanics.limb_of.items():
        bodies[limb].append(body)
    return {
        limb: None
        if any(model.body(body).name in mechanics.weightless for body in own)
        else _together(model, data, model.body(limb).id, own)
        for limb, own in bodies.items()
    }


def _together(model: mujoco.MjModel, data: mujoco.MjData, limb: int, bodies: list[int]) -> LimbMass:
    masses = np.where(model.body_mass[bodies] > _NOTHING, model.body_mass[bodies], 0.0)
    mass = float(masses.sum())
    if mass == 0:
        return LimbMass(0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    center = masses @ data.xipos[bodies] / mass
    inertia = np.zeros((3, 3))
    for body, weight in zip(bodies, masses, strict=True):
        if weight > 0:
            axes = data.ximat[body].reshape(3, 3)
            away = data.xipos[body] - center
            inertia += axes * model.body_inertia[body] @ axes.T
            inertia += weight * (away @ away * np.eye(3) - np.outer(away, away))
    here = data.xmat[limb].reshape(3, 3).T @ (center - data.xpos[limb])
    x, y, z = (float(value) for value in here)
    low, middle, high = (float(value) for value in np.linalg.eigvalsh(inertia))
    return LimbMass(mass, (x, y, z), (low, middle, high))
