"""Runs on tasks of one's own: kept with the run, resumed exactly, and Python run for those who give it only."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from morphkit.errors import CheckpointError, ConfigError
from morphkit.registry import load
from morphkit_rl.config.train_config import TrainConfig
from morphkit_rl.envs.reward_terms import TERMS
from morphkit_rl.envs.task_settings import Task
from morphkit_rl.evaluation.evaluate import evaluate, record
from morphkit_rl.training.trainer import resume, train
from tests.support.run_folders import assert_same, small_config

TASK = """
episode_seconds = 0.2
[terms]
track_command = 1.0
feet_air_time = { weight = 0.5, least = 0.1 }
[commands]
x = [0.2, 0.6]
seconds = 0.1
[pushes]
seconds = 0.1
speed = 0.3
[randomize]
mass = [0.9, 1.1]
"""
OWN = """
from morphkit_rl.envs.reward_terms import reward_term

@reward_term
def lazy(robot):
    return -abs(robot.action).sum(1)
"""


@pytest.fixture(autouse=True)
def _own_terms() -> Iterator[None]:
    known = TERMS.copy()
    yield
    TERMS.clear()
    TERMS.update(known)


def settings() -> TrainConfig:
    return small_config("trainer.sensors=proprioceptive", "td3.n_step=2")


def write(folder: Path, text: str) -> str:
    (folder / "own.py").write_text(OWN)
    (folder / "mine.toml").write_text(text)
    return str(folder / "mine.toml")


def test_a_run_keeps_its_task_and_continues_exactly(tmp_path: Path) -> None:
    task, quadruped = write(tmp_path, TASK), load("quadruped")
    train([quadruped], tmp_path / "whole", settings(), task=task, steps=48)
    train([quadruped], tmp_path / "parts", settings(), task=task, steps=22)
    (tmp_path / "mine.toml").unlink()
    saved = json.loads((tmp_path / "parts" / "config.json").read_text())
    assert (saved["task"], saved["task_toml"]) == ("mine", TASK)
    resume(tmp_path / "parts", steps=48)
    assert_same(tmp_path / "whole", tmp_path / "parts")
    (result,) = evaluate(tmp_path / "parts", [quadruped], episodes=2)
    assert max(result.lengths) <= 10
    lengths = [len(record(tmp_path / "parts", quadruped, max_steps=15, task=each)[1]) for each in (None, "walk")]
    assert lengths[0] <= 10 < lengths[1]


def test_python_is_run_for_those_who_give_the_file_only(tmp_path: Path) -> None:
    task = write(tmp_path, f'python = ["own.py"]\n{TASK}'.replace("[terms]", "[terms]\nlazy = 0.1"))
    train([load("quadruped")], tmp_path / "run", settings(), task=task, steps=8)
    del TERMS["lazy"]
    with pytest.raises(ConfigError, match=r"own.py are not run because a run says so"):
        evaluate(tmp_path / "run", [load("quadruped")], episodes=1)
    with pytest.raises(ConfigError, match=r"^\S+config.json: there is no term[^~]+: --task FILE.toml$"):
        resume(tmp_path / "run", steps=12)
    other = tmp_path / "other.toml"
    other.write_text(TASK)
    with pytest.raises(ConfigError, match="not the task that the run was begun with"):
        resume(tmp_path / "run", steps=12, task=other)
    assert resume(tmp_path / "run", steps=12, task=Path(task)).steps == 12
    del TERMS["lazy"]
    assert evaluate(tmp_path / "run", [load("quadruped")], episodes=1, task=task)[0].returns


def test_a_task_made_in_python_cannot_be_kept(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="write it to a TOML file"):
        train([load("hopper")], tmp_path / "run", settings(), task=Task("mine", alive_bonus=1.0), steps=8)
    assert not (tmp_path / "run").exists()


def test_a_damaged_task_is_refused(tmp_path: Path) -> None:
    train([load("quadruped")], tmp_path / "run", settings(), task=write(tmp_path, TASK), steps=8)
    config = tmp_path / "run" / "config.json"
    saved = json.loads(config.read_text())
    config.write_text(json.dumps({**saved, "task_toml": "[terms"}))
    with pytest.raises(CheckpointError, match="not valid TOML"):
        resume(tmp_path / "run", steps=12)
