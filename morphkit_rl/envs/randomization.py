"""Robots that differ from episode to episode: friction, masses and gains."""

from __future__ import annotations

import copy

import mujoco
import numpy as np

from morphkit_rl.envs.stepping import SteppedRobot
from morphkit_rl.envs.task_settings import Randomization


class Variants:
    """A model of its own for each environment of a robot.

    Args:
        stepped: The robot, whose models are replaced.
        root: Body id of its root.
    """

    def __init__(self, stepped: SteppedRobot, root: int) -> None:
        self._base = stepped.model
        self._models = [copy.deepcopy(self._base) for _ in stepped.models]
        stepped.models[:] = self._models
        self._data = mujoco.MjData(self._base)
        self._bodies = self._base.body_rootid == root

    def apply(self, which: np.ndarray, factors: np.ndarray) -> None:
        """Multiply friction, masses and gains of environments `which`, int (k,), by `factors` (k, 3)."""
        base = self._base
        for env, (friction, mass, gain) in zip(which.tolist(), factors, strict=True):
            model = self._models[env]
            model.geom_friction[:, 0] = base.geom_friction[:, 0] * friction
            model.pair_friction[:, :2] = base.pair_friction[:, :2] * friction
            model.body_mass[self._bodies] = base.body_mass[self._bodies] * mass
            model.body_inertia[self._bodies] = base.body_inertia[self._bodies] * mass
            model.actuator_gainprm[:, 0] = base.actuator_gainprm[:, 0] * gain
            model.actuator_biasprm[:, :3] = base.actuator_biasprm[:, :3] * gain
            mujoco.mj_setConst(model, self._data)


def draw_factors(rng: np.random.Generator, ranges: Randomization, n: int) -> np.ndarray:
    """Factors on friction, masses and gains, (n, 3)."""
    low, high = np.array([ranges.friction, ranges.mass, ranges.gain]).T
    return rng.uniform(low, high, (n, 3))
