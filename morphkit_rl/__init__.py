"""morphkit_rl: one policy over many morphologies.

    import morphkit, morphkit_rl

    family = morphkit.load_all("cheetah-family")
    morphkit_rl.train(family, "runs/first", morphkit_rl.load_config(), steps=200_000)
    results = morphkit_rl.evaluate("runs/first", family, episodes=3)

Importing it registers the Gymnasium ids `morphkit/<robot>-v0`; everything else is imported on first use.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from morphkit_rl.envs.registration import register_robots

if TYPE_CHECKING:
    from morphkit_rl.algorithms.policy import Policy
    from morphkit_rl.config.methods import Method, ModelSettings
    from morphkit_rl.config.train_config import TrainConfig, load_config, presets
    from morphkit_rl.envs.batch_env import BatchEnv
    from morphkit_rl.envs.gym_env import MorphEnv
    from morphkit_rl.envs.gym_vector_env import MorphVectorEnv
    from morphkit_rl.envs.robot import prepare
    from morphkit_rl.envs.tasks import Task, task_for
    from morphkit_rl.evaluation.evaluate import RobotResult, evaluate
    from morphkit_rl.models import load_published
    from morphkit_rl.training.progress import TrainSummary
    from morphkit_rl.training.trainer import resume, train

_MODULES = {
    "morphkit_rl.algorithms.policy": ("Policy",),
    "morphkit_rl.config.methods": ("Method", "ModelSettings"),
    "morphkit_rl.config.train_config": ("TrainConfig", "load_config", "presets"),
    "morphkit_rl.envs.batch_env": ("BatchEnv",),
    "morphkit_rl.envs.gym_env": ("MorphEnv",),
    "morphkit_rl.envs.gym_vector_env": ("MorphVectorEnv",),
    "morphkit_rl.envs.robot": ("prepare",),
    "morphkit_rl.envs.tasks": ("Task", "task_for"),
    "morphkit_rl.evaluation.evaluate": ("RobotResult", "evaluate"),
    "morphkit_rl.models": ("load_published",),
    "morphkit_rl.training.progress": ("TrainSummary",),
    "morphkit_rl.training.trainer": ("resume", "train"),
}
_HOME = {name: module for module, names in _MODULES.items() for name in names}

__all__ = [
    "BatchEnv",
    "Method",
    "ModelSettings",
    "MorphEnv",
    "MorphVectorEnv",
    "Policy",
    "RobotResult",
    "Task",
    "TrainConfig",
    "TrainSummary",
    "evaluate",
    "load_config",
    "load_published",
    "prepare",
    "presets",
    "resume",
    "task_for",
    "train",
]

register_robots()


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'morphkit_rl' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return __all__
