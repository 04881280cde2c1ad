"""Run folders of robots with awkward names, runs that diverge, and Ctrl-C."""

from __future__ import annotations

import os
import platform
import signal
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from morphkit.description import Description
from morphkit.errors import OutputError, TrainingError
from morphkit.registry import load
from morphkit_rl.config.train_config import TrainConfig, load_config
from morphkit_rl.evaluation.evaluate import evaluate
from morphkit_rl.runs import checkpoint, run_settings
from morphkit_rl.runs.git_commit import git_commit
from morphkit_rl.runs.machine import machine
from morphkit_rl.runs.metrics_log import read_metrics
from morphkit_rl.training.collector import Collector
from morphkit_rl.training.session import Session
from morphkit_rl.training.trainer import resume, train
from tests.support.run_folders import assert_same


def config(*overrides: str) -> TrainConfig:
    tiny = ("model.d_model=16", "model.layers=1", "model.feedforward=16", "td3.batch_size=4", "trainer.num_envs=2")
    return load_config(overrides=[*tiny, "trainer.start_steps=8", "trainer.updates_per_sweep=1", *overrides])


NAMES = ("a/b\\c", "../../up", 'say "hi"\n', "🤖", "🦿", "long" * 200, "", "con.", "A B", "a b")


def test_robots_with_any_name_have_files_of_their_own(tmp_path: Path) -> None:
    robots = [replace(load("hopper_3"), name=name) for name in NAMES]
    train(robots[:-1], tmp_path / "run", config(), steps=30)
    files = sorted((tmp_path / "run" / "robots").iterdir())
    assert len(files) == len(NAMES) - 1
    assert all(len(file.name) < 64 and file.name.isascii() and " " not in file.name for file in files)
    assert [robot.name for robot in run_settings.load(tmp_path / "run").robots] == list(NAMES[:-1])
    resume(tmp_path / "run", steps=60)


def test_robots_keep_what_their_files_refer_to(tmp_path: Path) -> None:
    robot = replace(load("hopper_3"), packages={"meshes": tmp_path / "some" / "folder"})
    train([robot], tmp_path / "run", config(), steps=4)
    assert run_settings.load(tmp_path / "run").robots == (robot,)


def test_the_commit_of_a_checkout_that_something_was_installed_into_is_not_recorded(tmp_path: Path) -> None:
    def git(*arguments: str) -> str:
        name = ("-c", "user.name=a", "-c", "user.email=a@b")
        return subprocess.run(
            ["git", *name, *arguments], cwd=tmp_path, check=True, capture_output=True, text=True
        ).stdout

    for file in ("own.py", "installed.py"):
        (tmp_path / file).touch()
    git("init")
    git("add", "own.py")
    git("commit", "-m", "a")
    assert git_commit(tmp_path / "own.py") == git("rev-parse", "HEAD").strip()
    assert git_commit(tmp_path / "installed.py") is None


def test_a_run_says_what_it_is_computed_on(tmp_path: Path) -> None:
    train([load("hopper_3")], tmp_path / "run", config(), steps=20)
    recorded = run_settings.read(tmp_path / "run")["machine"]
    assert recorded == machine()
    assert recorded["processor"]
    resume(tmp_path / "run", steps=40)
    assert run_settings.read(tmp_path / "run")["machine"] == recorded


def test_the_processor_is_called_what_the_system_calls_it(tmp_path: Path) -> None:
    (tmp_path / "cpuinfo").write_text("processor\t: 0\nmodel name\t: Abacus: 9\nflags\t\t: fpu\n\nprocessor\t: 1\n")
    assert machine(tmp_path / "cpuinfo")["processor"] == "Abacus: 9"
    assert machine(tmp_path / "cpuinfo")["cores"] == len(os.sched_getaffinity(0))
    assert machine(tmp_path / "missing")["processor"] in (platform.processor(), platform.machine())


def test_a_run_folder_takes_one_process_at_a_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two that resume one run would each delete what the other's checkpoints need."""
    run, refused = tmp_path / "run", []
    train([load("hopper_3")], run, config(), steps=20)

    def intrude(_: object) -> None:
        if not refused:
            with pytest.raises(OutputError, match=f"process {os.getpid()} on .* is at work there") as caught:
                resume(run, steps=1000)
            refused.append(caught)

    monkeypatch.setattr("morphkit_rl.training.trainer.REPORT_SECONDS", 0.0)
    assert resume(run, steps=30, progress=intrude).steps == 30
    assert refused
    assert resume(run, steps=40).steps == 40


EXPLOSIVE = """
<mujoco>
  <option timestep="0.01"/>
  <worldbody>
    <body name="post"><geom size=".1" mass="1"/>
      <body name="tip" pos="0 0 .1"><joint name="hinge" axis="0 1 0"/><geom size=".1" pos="0 0 .3" mass="1e-3"/></body>
    </body>
  </worldbody>
  <actuator><motor name="wild" joint="hinge" gear="1e13" ctrlrange="-1 1" ctrllimited="true"/></actuator>
</mujoco>"""


@pytest.fixture
def explosive(tmp_path: Path) -> Description:
    path = tmp_path / "explosive.xml"
    path.write_text(EXPLOSIVE)
    return load(path)


@pytest.mark.parametrize("schedule", ["sweeps", "rounds"])
def test_a_diverging_simulation_is_counted_and_poisons_nothing(
    explosive: Description, tmp_path: Path, schedule: str
) -> None:
    run = tmp_path / "run"
    settings = config(f"trainer.schedule={schedule}", "trainer.evaluate_steps=40", "trainer.evaluate_episodes=1")
    with pytest.raises(TrainingError, match="diverged in every episode of explosive"):
        train([explosive, load("hopper_3")], run, settings, steps=80)
    assert read_metrics(run)[-1]["diverged"] > 0
    session = Session(run_settings.load(run))
    session.restore(run)
    for buffer in session.collector.buffers:
        for name in ("obs", "action", "reward", "newest"):
            assert np.isfinite(getattr(buffer, name)).all()
        assert np.isfinite(buffer.finals.obs).all()
    assert all(torch.isfinite(p).all() for net in session.agent.learner.networks().values() for p in net.parameters())
    assert np.isfinite(session.agent.normalizer.mean).all()
    (result,) = evaluate(run, [explosive], episodes=2)
    assert np.isfinite(result.returns).all()


def test_a_run_whose_numbers_are_no_longer_finite_fails_and_keeps_its_last_checkpoint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = tmp_path / "run"
    train([load("hopper_3")], run, config(), steps=40)
    _, before = checkpoint.load_state(run)
    advance = Collector.advance

    def poison(self: Collector, action: np.ndarray) -> Any:
        return advance(self, np.full_like(action, np.nan) if self.steps >= 60 else action)

    monkeypatch.setattr(Collector, "advance", poison)
    with pytest.raises(TrainingError, match="not finite after 60 steps"):
        resume(run, steps=400)
    assert checkpoint.load_state(run)[1] == before


def test_no_checkpoint_is_written_once_a_loss_is_not_finite(tmp_path: Path) -> None:
    run = tmp_path / "run"
    train([load("hopper_3")], run, config("td3.gradient_clip=0.0"), steps=4)
    with pytest.raises(TrainingError, match=r"critic_loss is nan|critic_loss is inf|actions are not finite"):
        train([load("hopper_3")], tmp_path / "wild", config("td3.learning_rate=1e30"), steps=400)
    assert not checkpoint.has_checkpoint(tmp_path / "wild")


def test_no_checkpoint_is_written_once_a_weight_is_not_finite(tmp_path: Path) -> None:
    """The loss of the update that spoils the weights is still finite."""
    with pytest.raises(TrainingError, match="weights of critic are not finite after 10 steps"):
        train([load("hopper_3")], tmp_path / "wild", config("learner.critic_learning_rate=1e39"), steps=10)
    assert not checkpoint.has_checkpoint(tmp_path / "wild")


def test_ctrl_c_in_the_middle_of_a_piece_stops_behind_it_and_the_run_goes_on_exactly(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    robots, settings = [load("hopper_3")], config()
    train(robots, tmp_path / "whole", settings, steps=80)
    advance = Collector.advance

    def interrupt(self: Collector, action: np.ndarray) -> Any:
        if self.steps == 30:
            os.kill(os.getpid(), signal.SIGINT)
        return advance(self, action)

    with monkeypatch.context() as patch:
        patch.setattr(Collector, "advance", interrupt)
        summary = train(robots, tmp_path / "parts", settings, steps=80)
    assert summary.interrupted
    assert summary.steps == 32
    assert not resume(tmp_path / "parts").interrupted
    assert_same(tmp_path / "whole", tmp_path / "parts")


def test_a_second_ctrl_c_stops_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stuck(self: Collector, action: np.ndarray) -> Any:
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)
        raise AssertionError("went on")

    before = signal.getsignal(signal.SIGINT)
    monkeypatch.setattr(Collector, "advance", stuck)
    with pytest.raises(KeyboardInterrupt):
        train([load("hopper_3")], tmp_path / "run", config(), steps=80)
    assert signal.getsignal(signal.SIGINT) is before
