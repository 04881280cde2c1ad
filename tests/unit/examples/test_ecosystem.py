"""Other people's learners on morphkit's environments, as the examples show them."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch

EXAMPLES = Path(__file__).parents[3] / "examples"


def example(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"example_{name}", EXAMPLES / f"{name}.py")
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def cleanrl() -> ModuleType:
    return example("cleanrl_continuous_action")


@pytest.mark.parametrize("algorithm", ["td3", "sac"])
def test_cleanrls_pattern_runs_and_updates(
    algorithm: str, cleanrl: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made = []
    kind = getattr(cleanrl, algorithm.upper())

    def make(*sizes: int) -> Any:
        agent = kind(*sizes)
        made.append((agent, [weights.detach().clone() for weights in agent.actor.parameters()]))
        return agent

    monkeypatch.setattr(cleanrl, algorithm.upper(), make)
    monkeypatch.setattr(cleanrl, "BATCH", 32)
    returns = cleanrl.train(algorithm, "morphkit/hopper_3-v0", steps=400, warm_up=370, width=32)
    assert len(returns) >= 2
    assert np.isfinite(returns).all()
    assert capsys.readouterr().out.count("return") == len(returns)
    ((agent, before),) = made
    assert not any(torch.equal(*pair) for pair in zip(agent.actor.parameters(), before, strict=True))
    assert all(bool(weights.isfinite().all()) for weights in agent.actor.parameters())


def test_stable_baselines3_runs_unchanged() -> None:
    pytest.importorskip("stable_baselines3")
    settings = {"learning_starts": 100, "batch_size": 32, "policy_kwargs": {"net_arch": [32]}}
    model, mean = example("stable_baselines").train("morphkit/hopper_3-v0", steps=200, **settings)
    assert model.num_timesteps == 200
    assert np.isfinite(mean)


def test_stable_baselines3_finds_nothing_wrong_with_the_environments() -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    checker.check_env(gymnasium.make("morphkit/arm-v0").unwrapped, warn=False)
