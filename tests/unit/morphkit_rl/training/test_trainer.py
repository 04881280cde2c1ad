"""Training, resuming and evaluating small runs."""

from __future__ import annotations

import json
import math
import os
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import torch

from morphkit.errors import CheckpointError, ConfigError, OutputError, UnknownNameError
from morphkit.naming.limbs import canonical_limb_names
from morphkit.readers import read
from morphkit.registry import load
from morphkit.tokens.spec import token_spec
from morphkit_rl.algorithms.policy import Policy
from morphkit_rl.config.train_config import TrainConfig, load_config
from morphkit_rl.evaluation.evaluate import evaluate, record
from morphkit_rl.runs import checkpoint, run_settings
from morphkit_rl.training.session import Session
from morphkit_rl.training.trainer import resume, train
from tests.support.run_folders import assert_same, weights

ROBOTS = ("hopper", "arm")


@pytest.fixture
def config() -> TrainConfig:
    return load_config(
        overrides=[
            *("model.d_model=16", "model.layers=1", "model.feedforward=16"),
            *("td3.batch_size=16", "td3.n_step=3", "trainer.start_steps=40", "trainer.num_envs=2"),
            *("trainer.checkpoint_seconds=0.2", "trainer.updates_per_sweep=1"),
        ]
    )


@pytest.fixture
def run(tmp_path: Path, config: TrainConfig) -> Path:
    train([load(name) for name in ROBOTS], tmp_path / "run", config, steps=200)
    return tmp_path / "run"


def test_a_resumed_run_equals_one_that_never_stopped(tmp_path: Path, config: TrainConfig, run: Path) -> None:
    robots = [load(name) for name in ROBOTS]
    train(robots, tmp_path / "parts", config, steps=72)
    resume(tmp_path / "parts", steps=120)
    summary = resume(tmp_path / "parts", steps=200)
    assert summary.steps == 200
    assert_same(run, tmp_path / "parts")


@pytest.mark.parametrize(("device", "hint"), [("gpu", "; a GPU is called 'cuda'"), ("cpu:7", ""), ("meta", "")])
def test_a_device_that_is_not_there_is_refused_in_one_line(
    device: str, hint: str, tmp_path: Path, config: TrainConfig
) -> None:
    with pytest.raises(ConfigError, match=rf"device '{device}': PyTorch has none .* here{hint}; it has cpu") as error:
        train([load("hopper")], tmp_path / "run", config, steps=16, device=device)
    assert "\n" not in str(error.value)
    assert not (tmp_path / "run").exists()


def test_a_replay_that_does_not_fit_is_refused_before_texts_are_encoded(tmp_path: Path, config: TrainConfig) -> None:
    large = load_config(overrides=[*_overrides(config), "trainer.replay_capacity=10_000_000_000_000"])
    with pytest.raises(ConfigError, match=r"does not fit into memory .*; set trainer\.replay_capacity to less"):
        train([load("hopper")], tmp_path / "run", large, steps=16)
    assert not (tmp_path / "run").exists()


def test_an_average_of_weights_and_falling_rates_resume_exactly(tmp_path: Path, config: TrainConfig) -> None:
    options = ["learner.actor_average=0.9", "learner.final_learning_rate=0.1", "trainer.checkpoint_seconds=1000"]
    options += ["learner.final_discount=0.998", "learner.discount_updates=30", "td3.discount=0.95"]
    changed, robots = load_config(overrides=[*_overrides(config), *options]), [load(name) for name in ROBOTS]
    train(robots, tmp_path / "whole", changed, steps=160)
    train(robots, tmp_path / "parts", changed, steps=160)
    session = Session(run_settings.load(tmp_path / "parts"))
    for sweep in range(20):
        session.agent.learner.set_rates(sweep * 4 / 160)
        session.schedule.advance()
    session.save(tmp_path / "parts", 1.0)
    session.close()
    resume(tmp_path / "parts")
    assert_same(tmp_path / "whole", tmp_path / "parts")
    saved = weights(tmp_path / "whole")
    assert not np.array_equal(*(saved[f"{part}/head.weight"] for part in ("policy/actor", "learner/actor_online")))


def test_a_replay_that_wrapped_round_resumes_exactly(tmp_path: Path, config: TrainConfig) -> None:
    small = load_config(overrides=[*_overrides(config), "trainer.replay_capacity=48"])
    robots = [load(name) for name in ROBOTS]
    train(robots, tmp_path / "whole", small, steps=240)
    train(robots, tmp_path / "parts", small, steps=100)
    resume(tmp_path / "parts", steps=240)
    assert_same(tmp_path / "whole", tmp_path / "parts")
    _, state = checkpoint.load_state(tmp_path / "parts")
    assert {file.name for file in (tmp_path / "parts" / "replay").iterdir()} == {s["file"] for s in state["segments"]}
    held_sweeps = 48 // len(ROBOTS) // small.trainer.num_envs
    assert state["sweeps"] == 60
    assert state["segments"][0]["last"] > 60 - held_sweeps, "segments that were overwritten must go"


def _overrides(config: TrainConfig) -> list[str]:
    return [f"{s}.{k}={json.dumps(v)}" for s, values in config.to_dict().items() for k, v in values.items()]


def test_another_seed_gives_other_weights(tmp_path: Path, config: TrainConfig, run: Path) -> None:
    train([load(name) for name in ROBOTS], tmp_path / "other", config, steps=200, seed=1)
    assert not np.array_equal(*(weights(r)["policy/actor/encoder.value.weight"] for r in (run, tmp_path / "other")))


def test_run_folder_tells_what_was_done(run: Path) -> None:
    saved = json.loads((run / "config.json").read_text())
    assert [robot["name"] for robot in saved["robots"]] == list(ROBOTS)
    assert saved["versions"]["torch"] == torch.__version__
    rows = [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]
    assert rows[-1]["steps"] == 200
    assert rows[-1]["updates"] == (200 - 40) // 4
    assert list((run / "tensorboard").iterdir())
    assert len([p for p in (run / "checkpoints").iterdir() if p.is_dir()]) == 1


def test_policy_acts_alone_and_in_batches_within_the_control_ranges(run: Path) -> None:
    policy = Policy.load(run)
    for name in ("arm", "hopper", "cheetah", "quadruped"):
        spec = token_spec(read(load(name)), naming=policy.config.text.naming, canonical=load(name).info.canonical)
        obs = np.random.default_rng(0).standard_normal((4, len(spec.sensors)))
        actions = policy.act(spec, obs)
        assert actions.shape == (4, len(spec.actuators))
        assert actions.dtype == np.float32
        np.testing.assert_allclose(policy.act(spec, obs[0]), actions[0], rtol=1e-4, atol=1e-5)
        low = np.array([a.low if a.low is not None else -1 for a in spec.actuators])
        high = np.array([a.high if a.high is not None else 1 for a in spec.actuators])
        assert (actions >= low - 1e-6).all()
        assert (actions <= high + 1e-6).all()
    with pytest.raises(ConfigError, match="expected observations of width"):
        policy.act(spec, obs[:, 1:])


def test_robots_that_differ_in_what_their_file_includes_are_told_apart(run: Path, tmp_path: Path) -> None:
    policy = Policy.load(run)
    controls = {}
    for bound in (1, 50):
        folder = tmp_path / str(bound)
        folder.mkdir()
        motor = f'<motor joint="hip" ctrlrange="-{bound} {bound}"/>'
        (folder / "motors.xml").write_text(f"<mujoco><actuator>{motor}</actuator></mujoco>")
        (folder / "robot.xml").write_text(
            '<mujoco><include file="motors.xml"/><worldbody><body name="base"><geom size=".1"/>'
            '<body name="leg"><joint name="hip"/><geom size=".1"/></body></body></worldbody></mujoco>'
        )
        spec = token_spec(read(load(folder / "robot.xml")))
        controls[bound] = policy.act(spec, np.ones(len(spec.sensors)))
    np.testing.assert_allclose(controls[50], 50 * controls[1], rtol=1e-5)


def test_evaluation_covers_seen_and_unseen_robots_and_repeats_itself(run: Path) -> None:
    robots = [load("hopper"), load("hopper_4")]
    first, second = evaluate(run, robots, episodes=3), evaluate(run, robots, episodes=3)
    assert first == second
    assert [result.trained_on for result in first] == [True, False]
    for result in first:
        assert len(result.returns) == len(result.random_returns) == 3
        low, high = result.random_interval
        assert low <= result.random_mean <= high
        expert = load(result.robot).info.expert_return
        assert math.isclose(result.normalized, (result.mean - result.random_mean) / (expert - result.random_mean))


def test_a_recording_holds_the_poses_of_one_episode(run: Path) -> None:
    simulation, qpos, rate = record(run, load("arm"), max_steps=7)
    assert qpos.shape == (8, simulation.model.nq)
    assert np.isfinite(qpos).all()
    assert rate > 0


def test_evaluation_refuses_what_makes_no_sense(run: Path) -> None:
    for wrong in ({"episodes": 0}, {"seed": -1}):
        with pytest.raises(ConfigError, match=f"{next(iter(wrong))} is"):
            evaluate(run, [load("arm")], **wrong)


def test_evaluation_takes_task_and_base_of_the_run(tmp_path: Path, config: TrainConfig) -> None:
    robot = load("quadruped")
    assert (robot.info.task, robot.info.base) == ("walk", "free")
    run = tmp_path / "run"
    train([robot], run, config, task="raise", base="fixed", steps=20)
    own, same = (evaluate(run, [robot], episodes=2, **named) for named in ({}, {"task": "raise", "base": "fixed"}))
    assert own == same
    assert evaluate(run, [robot], episodes=2, task="walk", base="free") != own
    assert record(run, robot, max_steps=2)[0].base == "fixed"


def test_held_out_robots_are_not_trained_on(tmp_path: Path, config: TrainConfig) -> None:
    robots = [load("hopper"), load("arm")]
    train(robots, tmp_path / "run", config, hold_out=["arm"], steps=20)
    assert [robot.name for robot in run_settings.load(tmp_path / "run").robots] == ["hopper"]
    with pytest.raises(UnknownNameError, match="did you mean 'arm'"):
        train(robots, tmp_path / "other", config, hold_out=["amr"], steps=20)
    assert not (tmp_path / "other").exists()


def test_a_robot_without_actuators_is_refused_before_anything_is_written(tmp_path: Path, config: TrainConfig) -> None:
    path = tmp_path / "stick.xml"
    path.write_text(
        "<mujoco><worldbody><body name='stick'><freejoint/><geom size='.1'/>"
        "<body name='tip'><joint/><geom size='.1'/></body></body></worldbody></mujoco>"
    )
    with pytest.raises(ConfigError, match="no actuators"):
        train([load(path)], tmp_path / "run", config, steps=20)
    assert not (tmp_path / "run").exists()


def test_an_existing_run_is_not_overwritten(run: Path, config: TrainConfig) -> None:
    with pytest.raises(OutputError, match="--resume"):
        train([load("arm")], run, config, steps=20)


@pytest.mark.parametrize("file", ["policy.safetensors", "optimizer.safetensors", "state.json"])
def test_a_checkpoint_cut_short_is_refused(run: Path, file: str) -> None:
    folder, _ = checkpoint.load_state(run)
    whole = (folder / file).read_bytes()
    (folder / file).write_bytes(whole[: len(whole) // 2])
    with pytest.raises(CheckpointError, match=file.replace(".", r"\.")):
        Policy.load(run)
    with pytest.raises(CheckpointError, match=file.replace(".", r"\.")):
        resume(run, steps=300)


def test_a_checkpoint_that_lacks_something_or_has_another_size_is_refused_in_a_line(run: Path) -> None:
    config = json.loads((run / "config.json").read_text())
    config["config"]["model"]["d_model"] = 32
    (run / "config.json").write_text(json.dumps(config))
    with pytest.raises(CheckpointError, match=r"another method or size: .*size mismatch") as caught:
        Policy.load(run)
    assert len(str(caught.value)) < len(str(run)) + 450
    path = checkpoint.load_state(run)[0] / "state.json"
    path.write_text(path.read_text().replace('"vocabulary"', '"words"'))
    with pytest.raises(CheckpointError, match="lacks 'vocabulary'"):
        Policy.load(run)


def test_a_replay_segment_cut_short_is_refused(run: Path) -> None:
    segment = next((run / "replay").iterdir())
    segment.write_bytes(segment.read_bytes()[:100])
    with pytest.raises(CheckpointError, match=segment.name):
        resume(run, steps=300)


def test_a_full_disk_leaves_the_last_checkpoint_whole(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = weights(run)
    session = Session(run_settings.load(run))
    session.restore(run)
    session.schedule.advance()

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(checkpoint, "save_file", full)
        with pytest.raises(OutputError, match="No space left on device"):
            session.save(run, 1.0)
    after = weights(run)
    assert all(np.array_equal(before[key], after[key]) for key in before)
    assert not [path for path in (run / "checkpoints").iterdir() if path.name.endswith(".tmp")]


def test_a_checkpoint_is_on_disk_before_it_replaces_the_last(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else a power cut could leave an empty file in the new one, with the old one gone."""
    session, flushed = Session(run_settings.load(run)), set()
    session.restore(run)
    session.schedule.advance()

    def sync(descriptor: int) -> None:
        flushed.add(os.fstat(descriptor).st_ino)

    monkeypatch.setattr(os, "fsync", sync)
    session.save(run, 1.0)
    folder, state = checkpoint.load_state(run)
    files = [*folder.iterdir(), run / "checkpoints" / "latest", run / "replay" / state["segments"][-1]["file"]]
    assert len(files) == 7
    assert [file.name for file in files if file.stat().st_ino not in flushed] == []


def test_diverging_or_foreign_run_folders_are_named(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match="no such run folder"):
        Policy.load(tmp_path / "nothing")
    with pytest.raises(CheckpointError, match="not a run folder"):
        Policy.load(tmp_path)


def test_a_checkpoint_of_the_same_moment_never_replaces_the_latest_in_place(run: Path) -> None:
    session = Session(run_settings.load(run))
    elapsed_s = session.restore(run)
    names = [checkpoint.load_state(run)[0].name]
    for _ in range(3):
        session.save(run, elapsed_s)
        names.append(checkpoint.load_state(run)[0].name)
        assert [path.name for path in (run / "checkpoints").iterdir() if path.is_dir()] == names[-1:]
    assert all(one != other for one, other in pairwise(names))


def test_a_run_keeps_the_canonical_names_of_its_robots(
    tmp_path: Path, config: TrainConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    named = load_config(overrides=[*_overrides(config), "text.naming=canonical"])
    arm = load("arm")
    train([arm], tmp_path / "run", named, steps=20)
    saved = run_settings.load(tmp_path / "run").robots
    assert saved[0].info.canonical == canonical_limb_names(read(arm), arm.info.canonical)
    vocabulary = Policy.load(tmp_path / "run").vocabulary
    assert vocabulary is not None

    later = {limb.name: f"part {number}" for number, limb in enumerate(read(arm).limbs)}
    monkeypatch.setattr("morphkit.tokens.names.canonical_limb_names", lambda morphology, given: later | dict(given))
    assert token_spec(read(arm), naming="canonical").sensors[0].text == "part 0 position x"
    assert resume(tmp_path / "run", steps=22).steps >= 22
    seen: list[str] = []
    act = Policy.act
    monkeypatch.setattr(Policy, "act", lambda self, spec, obs: seen.extend(spec.texts) or act(self, spec, obs))
    record(tmp_path / "run", arm, max_steps=2)
    assert set(seen) == {text for text in vocabulary.texts if text in seen} != set()
