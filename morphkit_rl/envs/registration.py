"""Gymnasium ids of the shipped robots: `morphkit/<robot>-v0`, recipes included."""

from __future__ import annotations

import importlib.resources
import tomllib
from pathlib import Path

import gymnasium

NAMESPACE = "morphkit"
MAX_EPISODE_STEPS = 1000
"""Length of every task's episodes, known without importing the simulator."""


def register_robots() -> tuple[str, ...]:
    """Register every shipped robot and recipe that is not registered yet; nothing is loaded or compiled.

    Returns:
        All ids, sorted.
    """
    ids = {f"{NAMESPACE}/{name}-v0": name for name in _robot_names()}
    for env_id, name in ids.items():
        if env_id not in gymnasium.registry:
            gymnasium.register(
                env_id,
                entry_point="morphkit_rl.envs.gym_env:unlimited",
                vector_entry_point="morphkit_rl.envs.gym_vector_env:MorphVectorEnv",
                max_episode_steps=MAX_EPISODE_STEPS,
                kwargs={"robot": name},
            )
    return tuple(sorted(ids))


def _robot_names() -> list[str]:
    names = []
    for path in Path(str(importlib.resources.files("morphkit_robots"))).glob("*/robot.toml"):
        names += [path.parent.name, *tomllib.loads(path.read_text("utf-8")).get("recipes", {})]
    return names
