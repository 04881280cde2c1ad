"""A robot's environment, stepped with random actions."""

from __future__ import annotations

import numpy as np

from morphkit.description import Description
from morphkit.errors import MorphkitError
from morphkit.morphology import Base
from morphkit_rl.envs.batch_env import BatchEnv
from morphkit_rl.envs.robot import prepare

STEPS = 1000


def steps(description: Description, base: Base) -> str:
    """Step the environment that `morphkit train` makes of a robot; what hinders that, empty where nothing does.

    Args:
        description: The robot.
        base: How its root is attached to the world.
    """
    try:
        robot = prepare(description, base=base)
    except MorphkitError as error:
        return " ".join(str(error).split())[:300]
    if not robot.spec.actuators:
        return "no actuators"
    env = BatchEnv([robot.simulation], [robot.task], 1, specs=[robot.spec], num_threads=1)
    random = np.random.default_rng(0)
    low, high = (
        np.array([bound if bound is not None and np.isfinite(bound) else other for bound in bounds])
        for bounds, other in (
            ([each.low for each in robot.spec.actuators], -1.0),
            ([each.high for each in robot.spec.actuators], 1.0),
        )
    )
    try:
        numbers = [*env.reset()]
        for _ in range(STEPS):
            step = env.step([random.uniform(low, high)[None]])
            numbers += [*step.obs, *step.final_obs, *step.reward]
        assert all(np.isfinite(each).all() for each in numbers), "an observation or reward is not finite"
        diverged = int(env.diverged.sum())
    finally:
        env.close()
    if not diverged:
        return ""
    known = "; ".join(note for note in robot.simulation.notes if "diverges" in note)
    often = f"diverges {diverged} times in {STEPS} steps of random actions"
    return f"{description.file}: {often}; {known or 'no reason is known'}"
