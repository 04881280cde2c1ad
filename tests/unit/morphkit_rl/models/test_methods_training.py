"""Checkpoints of every method, and what happens where method, tokens and robot do not fit each other."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from morphkit.errors import CheckpointError, ConfigError
from morphkit.registry import load
from morphkit_rl.algorithms.policy import Policy
from morphkit_rl.config.methods import method_names
from morphkit_rl.config.train_config import TrainConfig, load_config
from morphkit_rl.evaluation.evaluate import evaluate
from morphkit_rl.runs import run_settings
from morphkit_rl.training.trainer import resume, train
from tests.support.networks import tiny_overrides
from tests.support.run_folders import assert_same

ROUNDS = (
    "trainer.schedule=rounds",
    "trainer.num_envs=1",
    "trainer.normalize=false",
    "trainer.start_steps_per_robot=60",
)


def config(method: str, *overrides: str) -> TrainConfig:
    small = ("td3.batch_size=4", "trainer.num_envs=2", "trainer.start_steps=8")
    settings = ("trainer.updates_per_sweep=1", "trainer.precision=float32")
    return load_config(overrides=[*tiny_overrides(method), *small, *settings, *overrides])


@pytest.mark.parametrize(("schedule", "steps"), [((), 32), (ROUNDS, 96)], ids=["sweeps", "rounds"])
@pytest.mark.parametrize("method", method_names())
def test_every_method_trains_saves_resumes_exactly_loads_and_evaluates(
    tmp_path: Path, method: str, schedule: tuple[str, ...], steps: int
) -> None:
    robots = [load("hopper"), load("hopper_3")]
    settings = config(method, *schedule)
    assert train(robots, tmp_path / "whole", settings, steps=steps).updates > 5
    train(robots, tmp_path / "parts", settings, steps=20)
    resume(tmp_path / "parts", steps=steps)
    assert_same(tmp_path / "whole", tmp_path / "parts")
    seen, unseen = evaluate(tmp_path / "whole", [load("hopper_3"), load("hopper_4")], episodes=1)
    assert (seen.trained_on, unseen.trained_on) == (True, False)
    assert np.isfinite([*seen.returns, *unseen.returns]).all()


@pytest.mark.parametrize(
    "options",
    [
        ("model.method=ma-bert", "text.tune=residual", "td3.reset_updates=3"),
        ("model.method=limb-former", "text.tune=residual", "text.control=shuffled"),
        ("model.method=limb-former", "text.control=one-hot", "td3.reset_updates=2"),
        ("model.method=anymorph", "text.control=random", "trainer.replay_dtype=float16"),
    ],
)
def test_options_of_texts_and_learning_resume_exactly_too(tmp_path: Path, options: tuple[str, ...]) -> None:
    robots, settings = [load("hopper"), load("hopper_3")], config("limb-former", *options)
    train(robots, tmp_path / "whole", settings, steps=32)
    train(robots, tmp_path / "parts", settings, steps=20)
    resume(tmp_path / "parts", steps=32)
    assert_same(tmp_path / "whole", tmp_path / "parts")
    (unseen,) = evaluate(tmp_path / "whole", [load("hopper_4")], episodes=1)
    assert np.isfinite(unseen.returns).all()


def test_noise_of_methods_that_act_by_limb_falls_on_columns_without_a_motor_too(tmp_path: Path) -> None:
    from morphkit_rl.training.session import Session

    train([load("hopper_3")], tmp_path / "run", config("amorpheus"), steps=20)
    session = Session(run_settings.load(tmp_path / "run"))
    session.restore(tmp_path / "run")
    buffer, spec = session.collector.buffers[0], session.agent.robots.layout.specs[0]
    assert buffer.action.shape[1] == len(spec.limbs) == len(spec.actuators) + 1
    assert np.ptp(buffer.action[: len(buffer)], axis=0).min() > 0.1
    assert buffer.obs.shape[1] == len(spec.sensors)


def test_a_checkpoint_of_another_method_is_refused(tmp_path: Path) -> None:
    train([load("hopper_3")], tmp_path / "run", config("amorpheus"), steps=12)
    path = tmp_path / "run" / "config.json"
    saved = json.loads(path.read_text())
    saved["config"]["model"] = config("smp").to_dict()["model"]
    path.write_text(json.dumps(saved))
    for attempt in (Policy.load, lambda run: resume(run, steps=20)):
        with pytest.raises(CheckpointError, match="method 'amorpheus', but the run says 'smp'"):
            attempt(tmp_path / "run")


def test_a_checkpoint_for_other_tokens_is_refused(tmp_path: Path) -> None:
    train([load("hopper_3")], tmp_path / "run", config("limb-former"), steps=12)
    path = tmp_path / "run" / "config.json"
    saved = json.loads(path.read_text())
    saved["config"]["trainer"]["sensors"] = ["no_ltv"]
    path.write_text(json.dumps(saved))
    with pytest.raises(CheckpointError, match="other tokens"):
        resume(tmp_path / "run", steps=20)


@pytest.mark.parametrize("method", ["amorpheus", "limb-former"])
def test_a_policy_refuses_tokens_that_it_was_trained_without(tmp_path: Path, method: str) -> None:
    train([load("hopper_3")], tmp_path / "run", config(method, 'trainer.sensors=["no_ltv"]'), steps=12)
    policy = Policy.load(tmp_path / "run")
    less, whole = (run_settings.prepare_robot(each, load("hopper_3")).spec for each in (policy.config, config(method)))
    assert policy.act(less, np.zeros(len(less.sensors))).shape == (len(less.actuators),)
    with pytest.raises(ConfigError, match="type"):
        policy.act(whole, np.zeros(len(whole.sensors)))


@pytest.mark.parametrize("method", [name for name in method_names() if name != "limb-former"])
def test_a_method_says_which_robot_it_cannot_express(tmp_path: Path, method: str) -> None:
    with pytest.raises(ConfigError, match=f"method {method!r}.*limb-former can control"):
        train([load("hopper_3"), load("arm")], tmp_path / "run", config(method), steps=12)
    assert not (tmp_path / "run").exists()
    train([load("hopper_3")], tmp_path / "run", config(method), steps=12)
    with pytest.raises(ConfigError, match=f"method {method!r}"):
        evaluate(tmp_path / "run", [load("arm")], episodes=1)
    validated = config(method, "trainer.evaluate_steps=8")
    with pytest.raises(ConfigError, match=f"method {method!r}"):
        train([load("hopper_3"), load("arm")], tmp_path / "other", validated, validation=["arm"], steps=12)
    assert not (tmp_path / "other").exists()


def test_a_device_that_is_not_there_is_named_before_anything_is_written(tmp_path: Path) -> None:
    for precision in ("auto", "float32"):
        settings = config("smp", f"trainer.precision={precision}")
        with pytest.raises(ConfigError, match="device 'cuda:99'"):
            train([load("hopper_3")], tmp_path / "run", settings, steps=12, device="cuda:99")
        assert not (tmp_path / "run").exists()
