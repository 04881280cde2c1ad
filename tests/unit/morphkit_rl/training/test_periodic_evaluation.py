"""Noise-free evaluation while training, on training and validation robots."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from morphkit.errors import CheckpointError, ConfigError, UnknownNameError
from morphkit.registry import load
from morphkit_rl.algorithms.policy import Policy
from morphkit_rl.config.train_config import TrainConfig, load_config
from morphkit_rl.evaluation.evaluate import evaluate
from morphkit_rl.runs import checkpoint, run_folder, run_settings
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


HOPPERS = ("hopper", "hopper_3", "hopper_4")
KEEP_BEST = ("trainer.evaluate_steps=20", "trainer.evaluate_episodes=1", "trainer.keep=best")


@pytest.fixture
def worth(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """What evaluations are worth, in turn; they go on being made."""
    values = [1.0, 3.0, 2.0, 4.0, 0.0]
    monkeypatch.setattr("morphkit_rl.training.periodic_evaluation._worth", lambda results: values[len(seen(results))])
    found: list[Any] = []

    def seen(results: Any) -> list[Any]:
        assert len(results) == 1, "the validation body alone"
        found.append(results)
        return found[:-1]

    return values


@pytest.mark.usefixtures("worth")
def test_the_best_checkpoint_is_that_of_the_best_evaluation_also_after_a_resume(tmp_path: Path) -> None:
    run = tmp_path / "run"
    robots = [load(name) for name in HOPPERS]
    train(robots, run, config(*KEEP_BEST), validation=["hopper_4"], steps=60)
    assert [path.name for path in sorted((run / "checkpoints").iterdir())][:2] == ["best", "latest"]
    best, state = checkpoint.load_state(run, "best")
    latest, _ = checkpoint.load_state(run)
    assert state["steps"] == 40
    assert state["evaluation"]["best"] == 3.0
    assert run_folder.checkpoint_names(run) == [best.name, latest.name]
    policy = Policy.load(run, checkpoint="best")
    assert not torch.equal(*(next(each.actor.parameters()) for each in (policy, Policy.load(run))))
    resume(run, steps=100)
    assert checkpoint.load_state(run, "best")[1]["steps"] == 80
    assert len(run_folder.checkpoint_names(run)) == 2
    assert evaluate(run, [load("hopper_5")], episodes=1, checkpoint="best")[0].returns
    with pytest.raises(CheckpointError, match=r"no checkpoint 'bset'; did you mean 'best'"):
        Policy.load(run, checkpoint="bset")


def test_the_best_checkpoint_is_never_lost_to_one_of_the_same_moment(tmp_path: Path) -> None:
    run = tmp_path / "run"
    robots = [load(name) for name in HOPPERS]
    train(robots, run, config(*KEEP_BEST), validation=["hopper_4"], steps=20)
    assert [checkpoint.load_state(run, which)[1]["steps"] for which in ("best", "latest")] == [20, 20]
    assert [name.count("-again") for name in run_folder.checkpoint_names(run)] == [0, 1]


def test_several_checkpoints_are_kept_and_only_the_newest_resumes(tmp_path: Path) -> None:
    run = tmp_path / "run"
    settings = config("trainer.keep=3", "trainer.checkpoint_seconds=0")
    train([load("hopper")], run, settings, steps=40)
    names = run_folder.checkpoint_names(run)
    assert len(names) == 3
    steps = [checkpoint.load_state(run, name)[1]["steps"] for name in names]
    assert steps == sorted(steps)
    assert steps[0] >= 36, "the newest"
    assert checkpoint.load_state(run)[0].name == names[-1]
    Policy.load(run, checkpoint=names[0])
    assert resume(run, steps=60).steps == 60
    assert len(run_folder.checkpoint_names(run)) == 3
    with pytest.raises(CheckpointError, match="holds no best checkpoint"):
        Policy.load(run, checkpoint="best")


def test_nothing_is_best_without_validation_bodies(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"trainer\.keep=best needs validation robots .* held out choose nothing"):
        train([load("hopper"), load("hopper_3")], tmp_path / "run", config(*KEEP_BEST), hold_out=["hopper_3"], steps=20)
    assert not (tmp_path / "run").exists()
    with pytest.raises(ConfigError, match="expected one of last, best, or a number of at least 1"):
        config("trainer.keep=worst")
    with pytest.raises(ConfigError, match="at least 1"):
        config("trainer.keep=0")
