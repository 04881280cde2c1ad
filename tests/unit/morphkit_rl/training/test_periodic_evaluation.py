"""Noise-free evaluation while training, on training and validation robots."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from morphkit.errors import ConfigError, UnknownNameError
from morphkit.registry import load
from morphkit_rl.config.train_config import TrainConfig, load_config
from morphkit_rl.runs import checkpoint, run_settings
from morphkit_rl.runs.metrics_log import read_metrics
from morphkit_rl.training.trainer import resume, train
from tests.support.run_folders import assert_same


def config(*overrides: str) -> TrainConfig:
    tiny = ("model.d_model=16", "model.layers=1", "model.feedforward=16", "td3.batch_size=4", "trainer.num_envs=2")
    settings = ("trainer.start_steps=20", "trainer.updates_per_sweep=1", "trainer.evaluate_episodes=2")
    return load_config(overrides=[*tiny, *settings, *overrides])


def evaluations(run: Path) -> dict[int, Any]:
    return {row["steps"]: row["evaluation"] for row in read_metrics(run) if "evaluation" in row}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run; tests only read it."""
    robots, path = [load("hopper"), load("hopper_4"), load("hopper_3")], tmp_path_factory.mktemp("monitor") / "run"
    train(robots, path, config("trainer.evaluate_steps=30"), validation=["hopper_4"], steps=100)
    return path


def test_evaluation_comes_every_so_many_steps_and_leaves_training_as_it_was(run: Path, tmp_path: Path) -> None:
    found = evaluations(run)
    assert list(found) == [32, 60, 92], "the first sweep of 4 steps that reaches a multiple of 30"
    assert all(list(each) == ["hopper", "hopper_3", "hopper_4"] for each in found.values())
    never = tmp_path / "never"
    train([load("hopper"), load("hopper_3")], never, config(), steps=100)
    assert not evaluations(never)
    assert_same(run, never)


def test_scores_follow_from_expert_and_random_returns(run: Path) -> None:
    _, state = checkpoint.load_state(run)
    random = dict(zip(["hopper", "hopper_3", "hopper_4"], state["evaluation"]["random"], strict=True))
    for results in evaluations(run).values():
        for robot, result in results.items():
            assert len(result["returns"]) == 2
            assert np.isclose(result["mean"], np.mean(result["returns"]))
            expert = load(robot).info.expert_return
            assert np.isclose(result["score"], (result["mean"] - random[robot]) / (expert - random[robot]))


def test_a_resumed_run_repeats_and_continues_its_evaluations(run: Path, tmp_path: Path) -> None:
    robots = [load("hopper"), load("hopper_4"), load("hopper_3")]
    parts = tmp_path / "parts"
    train(robots, parts, config("trainer.evaluate_steps=30"), validation=["hopper_4"], steps=48)
    resume(parts, steps=100)
    assert evaluations(parts) == evaluations(run)
    assert_same(parts, run)


def test_an_evaluation_that_ctrl_c_cuts_short_is_done_by_the_resumed_run(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import os
    import signal

    from morphkit_rl.training import periodic_evaluation

    robots = [load("hopper"), load("hopper_4"), load("hopper_3")]
    calls = 0
    play = periodic_evaluation.play

    def interrupted(*arguments: Any) -> Any:
        nonlocal calls
        calls += 1
        if calls == 3:  # random, first, second evaluation
            os.kill(os.getpid(), signal.SIGINT)
        return play(*arguments)

    monkeypatch.setattr(periodic_evaluation, "play", interrupted)
    parts = tmp_path / "parts"
    summary = train(robots, parts, config("trainer.evaluate_steps=30"), validation=["hopper_4"], steps=100)
    assert summary.interrupted
    assert summary.steps == 60
    resume(parts)
    assert evaluations(parts) == evaluations(run)
    assert_same(parts, run)


def test_validation_robots_are_not_trained_on_and_held_out_ones_never_touched(run: Path, tmp_path: Path) -> None:
    settings = run_settings.load(run)
    assert [robot.name for robot in settings.robots] == ["hopper", "hopper_3"]
    assert [robot.name for robot in settings.validation] == ["hopper_4"]
    robots = [load("hopper"), load("hopper_4"), load("hopper_3")]
    run_config, other = config("trainer.evaluate_steps=30"), tmp_path / "other"
    for chosen, error, message in (
        ({"validation": ["hoper_4"]}, UnknownNameError, "did you mean 'hopper_4'"),
        ({"validation": ["hopper_4"], "hold_out": ["hopper_4"]}, ConfigError, "both held out and"),
        ({"validation": ["hopper", "hopper_4", "hopper_3"]}, ConfigError, "no robot is left"),
    ):
        with pytest.raises(error, match=message):
            train(robots, other, run_config, steps=10, **chosen)
    with pytest.raises(ConfigError, match="evaluate_steps"):
        train(robots, other, config(), validation=["hopper_4"], steps=10)
    assert not other.exists()
    train(robots, other, run_config, hold_out=["hopper_4"], steps=40)
    assert all(list(each) == ["hopper", "hopper_3"] for each in evaluations(other).values())


def test_a_robot_without_an_expert_has_returns_but_no_score(tmp_path: Path) -> None:
    stranger = load("hopper")
    stranger = replace(stranger, info=replace(stranger.info, expert_return=None))
    train([stranger], tmp_path / "run", config("trainer.evaluate_steps=10"), steps=12)
    (result,) = evaluations(tmp_path / "run").values()
    assert result["hopper"]["score"] is None
    assert json.loads(json.dumps(result)) == result
