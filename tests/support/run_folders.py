"""What tests read from run folders."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from morphkit_rl.config.train_config import TrainConfig, load_config
from morphkit_rl.runs import checkpoint

FILES = ("policy", "learner", "optimizer", "environments")


def weights(run: Path) -> dict[str, np.ndarray]:
    """All arrays of the latest checkpoint of a run."""
    folder, _ = checkpoint.load_state(run)
    return {f"{f}/{k}": a for f in FILES for k, a in checkpoint.load_arrays(folder / f"{f}.safetensors").items()}


def assert_same(one: Path, other: Path) -> None:
    """The latest checkpoints of two runs hold the same numbers."""
    a, b = weights(one), weights(other)
    assert a.keys() == b.keys()
    for key in a:
        np.testing.assert_array_equal(a[key], b[key], err_msg=key)


def small_config(*overrides: str) -> TrainConfig:
    """Settings of the smallest networks and batches."""
    sizes = ("model.d_model=16", "model.layers=1", "model.feedforward=16", "td3.batch_size=4", "trainer.num_envs=2")
    critic = ("learner.critic_width=16", "learner.critic_layers=1")
    return load_config(overrides=[*sizes, *critic, "trainer.start_steps=8", "trainer.updates_per_sweep=1", *overrides])
