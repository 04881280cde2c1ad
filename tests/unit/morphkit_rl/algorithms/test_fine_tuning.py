"""Training that goes on from a policy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from morphkit.errors import ConfigError
from morphkit.registry import load
from morphkit_rl.algorithms.fine_tuning import start_config
from morphkit_rl.algorithms.policy import Policy
from morphkit_rl.config.train_config import TrainConfig, load_config
from morphkit_rl.runs import saved_policy
from morphkit_rl.training.trainer import resume, train
from tests.support.networks import tiny_overrides
from tests.support.run_folders import assert_same

SMALL = ("td3.batch_size=4", "trainer.num_envs=2", "trainer.start_steps=8", "trainer.updates_per_sweep=1")


def config(method: str, *overrides: str) -> TrainConfig:
    return load_config(overrides=[*tiny_overrides(method), *SMALL, "trainer.precision=float32", *overrides])


@pytest.mark.parametrize("method", ["limb-former", "anymorph"])
def test_it_begins_with_the_policy_on_other_bodies_and_resumes_exactly(method: str, tmp_path: Path) -> None:
    train([load("hopper_3")], tmp_path / "first", config(method), steps=20)
    first = tmp_path / "policy"
    saved_policy.save(saved_policy.load(tmp_path / "first"), first)
    held = start_config(first, overrides=["learner.actor_start=1000"])
    train([load("hopper_4")], tmp_path / "held", held, steps=24, start=first)
    before, after = Policy.load(first), Policy.load(tmp_path / "held")
    (known,) = before.prepare([load("hopper_3")])
    obs = np.random.default_rng(0).standard_normal((5, len(known.spec.sensors))).astype(np.float32)
    after.normalizer = before.normalizer  # which saw more
    np.testing.assert_array_equal(after.act(known.spec, obs), before.act(known.spec, obs))
    np.testing.assert_array_equal(after.embedder.mean, before.embedder.mean)

    learns = start_config(first, overrides=["learner.actor_start=0"])
    train([load("hopper_4")], tmp_path / "whole", learns, steps=40, start=first)
    train([load("hopper_4")], tmp_path / "parts", learns, steps=20, start=first)
    resume(tmp_path / "parts", steps=40)
    assert_same(tmp_path / "whole", tmp_path / "parts")
    weights, trained = before.actor.state_dict(), Policy.load(tmp_path / "whole").actor.state_dict()
    assert any(
        not torch.equal(trained[key], weights[key]) for key in weights if trained[key].shape == weights[key].shape
    )


def test_what_does_not_fit_the_policy_is_refused(tmp_path: Path) -> None:
    train([load("hopper_3")], tmp_path / "first", config("limb-former"), steps=12)
    for setting, message in (
        ("model.d_model=16", "model.d_model is 16, but the policy that training begins with was made with 8"),
        ("trainer.normalize=false", "trainer.normalize is False"),
        ("text.naming=canonical", "text.naming is 'canonical'"),
    ):
        asked = start_config(tmp_path / "first", overrides=[setting])
        with pytest.raises(ConfigError, match=message):
            train([load("hopper_4")], tmp_path / "next", asked, steps=12, start=tmp_path / "first")
        assert not (tmp_path / "next").exists()
    with pytest.raises(ConfigError, match=r"model\.method is 'smp'"):
        train([load("hopper_4")], tmp_path / "next", config("smp"), steps=12, start=tmp_path / "first")
    preset = start_config(tmp_path / "first", "limb-former-2026-11", ["td3.tau=0.5"])
    assert (preset.model.d_model, preset.td3.tau, preset.learner.critic) == (8, 0.5, "method")  # type: ignore[attr-defined]
