"""Training, killing, resuming and evaluating through the installed command."""

from __future__ import annotations

import json
import random
import shutil
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from safetensors.numpy import load_file

from .conftest import Run, listing

TINY = (
    *("--set", "model.d_model=16", "--set", "model.layers=1", "--set", "model.feedforward=16"),
    *("--set", "td3.batch_size=16", "--set", "trainer.start_steps=100", "--set", "trainer.num_envs=2"),
    *("--set", "trainer.checkpoint_seconds=0.05", "--set", "trainer.updates_per_sweep=1"),
)


def weights(run: Path) -> dict[str, np.ndarray]:
    folder = run / "checkpoints" / (run / "checkpoints" / "latest").read_text().strip()
    return {f"{path.stem}/{k}": a for path in folder.glob("*.safetensors") for k, a in load_file(path).items()}


def test_a_run_killed_at_a_random_moment_and_resumed_equals_one_that_was_never_killed(
    morphkit: Run, start: Callable[..., subprocess.Popen[bytes]], tmp_path: Path
) -> None:
    arguments = ("train", "hopper", "arm", "--steps", 1500, *TINY)
    morphkit(*arguments, "--run", "whole")
    killed = 0
    process = start(*arguments, "--run", "killed")
    for _ in range(2):
        deadline = time.monotonic() + 300
        while not (tmp_path / "killed/checkpoints/latest").exists() and process.poll() is None:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        time.sleep(random.uniform(0, 1.5))
        killed += process.poll() is None
        process.kill()
        process.wait()
        process = start("train", "--run", "killed", "--resume")
    assert killed, "the run ended before it could be killed; raise --steps"
    assert process.wait(300) == 0
    whole, resumed = weights(tmp_path / "whole"), weights(tmp_path / "killed")
    assert whole.keys() == resumed.keys()
    for key in whole:
        np.testing.assert_array_equal(whole[key], resumed[key], err_msg=key)
    rows = [json.loads(line) for line in (tmp_path / "killed/metrics.jsonl").read_text().splitlines()]
    assert [row["steps"] for row in rows] == sorted({row["steps"] for row in rows})


def test_sigterm_ends_a_run_at_a_checkpoint(start: Callable[..., subprocess.Popen[bytes]], tmp_path: Path) -> None:
    process = start("train", "hopper", "--steps", 10**9, *TINY, "--run", "run")
    while not (tmp_path / "run/checkpoints/latest").exists():
        assert process.poll() is None
        time.sleep(0.02)
    process.terminate()
    assert process.wait(60) == 143
    steps = json.loads((tmp_path / "run/metrics.jsonl").read_text().splitlines()[-1])["steps"]
    (folder,) = (tmp_path / "run/checkpoints").glob("step-*")
    assert json.loads((folder / "state.json").read_text())["real_steps"] == steps


def test_a_resume_with_nothing_left_changes_nothing(morphkit: Run, tmp_path: Path) -> None:
    morphkit("train", "hopper", "--steps", 150, *TINY, "--run", "run")

    def content() -> dict[str, bytes]:
        return {name: (tmp_path / "run" / name).read_bytes() for name in listing(tmp_path / "run") if "." in name[-8:]}

    before = content()
    done = morphkit("train", "--run", "run", "--resume")
    assert "nothing left to do" in done.stderr
    assert content() == before
    shutil.rmtree(tmp_path / "run/checkpoints")
    assert "there is nothing to resume from" in morphkit("train", "--run", "run", "--resume", code=2).stderr


def test_a_two_joint_arm_and_a_cheetah_family_in_one_run(morphkit: Run, tmp_path: Path) -> None:
    morphkit("ablate", "cheetah", "--all", "--min-limbs", 6, "--output", "family")
    held_out = json.loads((tmp_path / "family/manifest.json").read_text())["variants"][0]["name"]
    done = morphkit(
        *("train", "family", "cheetah", "arm", "--hold-out", held_out, "--run", "run", "--steps", 400, "--json"), *TINY
    )
    assert json.loads(done.stdout)["steps"] >= 400
    evaluated = morphkit("evaluate", "run", "arm", "family", "walker_2_main", "--episodes", 2, "--json")
    results = {result["robot"]: result for result in json.loads(evaluated.stdout)["robots"]}
    assert results["arm"]["trained_on"]
    assert not results[held_out]["trained_on"]
    assert not results["walker_2_main"]["trained_on"]
    assert all(len(result["returns"]) == 2 for result in results.values())
    table = morphkit("evaluate", "run", "arm", "--episodes", 1).stdout
    assert "arm" in table
    assert "random" in table


def test_a_robot_of_ones_own_trains_without_a_robot_toml(morphkit: Run, tmp_path: Path) -> None:
    import morphkit_robots

    shipped = Path(morphkit_robots.__file__).parent / "quadruped" / "quadruped.urdf"
    (tmp_path / "dog.urdf").write_bytes(shipped.read_bytes())
    for base in ("free", "planar"):
        run = f"run-{base}"
        morphkit(
            *("train", "dog.urdf", "--base", base, "--task", "locomotion", "--run", run, "--steps", 150, "--quiet"),
            *TINY,
        )
        morphkit("evaluate", run, "dog.urdf", "--base", base, "--task", "locomotion", "--episodes", 1)


def test_bad_training_input_leaves_nothing_behind(morphkit: Run, tmp_path: Path) -> None:
    (tmp_path / "stick.xml").write_text(
        "<mujoco><worldbody><body name='stick'><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
    )
    before = listing(tmp_path)
    for arguments, message in (
        (("train", "stick.xml", "--run", "run"), "actuators"),
        (("train", "hopper", "--run", "run", "--set", "td3.taux=1"), "did you mean"),
        (("train", "hopper", "--run", "run", "--preset", "defualt"), "preset"),
        (("train", "hopper", "--run", "run", "--task", "swimming"), "swimming"),
        (("train", "hopper", "--run", "run", "--hold-out", "hoper"), "did you mean"),
        (("train", "hopper", "--run", "run", "--hold-out", "hopper"), "no robot is left"),
        (("train", "hopper", "arm", "--run", "run", "--validate", "arm"), "evaluate_steps"),
        (("train", "hopper", "arm", "--run", "run", "--set", "model.method=amorpheus"), "limb-former can control"),
        (("train", "--run", "run", "--resume"), "no such run folder"),
        (("evaluate", "run", "hopper"), "no such run folder"),
    ):
        done = morphkit(*arguments, code=2)
        assert message in done.stderr, arguments
        assert done.stderr.startswith("error:")
        assert listing(tmp_path) == before, arguments


def test_a_checkpoint_cut_short_is_named(morphkit: Run, tmp_path: Path) -> None:
    morphkit("train", "hopper", "--run", "run", "--steps", 120, *TINY)
    policy = next((tmp_path / "run/checkpoints").glob("step-*/policy.safetensors"))
    policy.write_bytes(policy.read_bytes()[:-100])
    for arguments in (("evaluate", "run", "hopper"), ("train", "--run", "run", "--resume", "--steps", 200)):
        assert "policy.safetensors: cut short" in morphkit(*arguments, code=2).stderr


def test_validation_robots_are_evaluated_while_the_others_train(morphkit: Run, in_process: Run, tmp_path: Path) -> None:
    settings = ("evaluate_steps=60", "evaluate_episodes=1", "keep=best")
    evaluate = [word for setting in settings for word in ("--set", f"trainer.{setting}")]
    arguments = ("hopper", "hopper_3", "hopper_4", "--validate", "hopper_4", "--hold-out", "hopper_3", *TINY, *evaluate)
    done = morphkit("train", *arguments, "--run", "run", "--steps", 130, "--json")
    assert list(json.loads(done.stdout)["returns"]) in ([], ["hopper"])
    rows = [json.loads(line) for line in (tmp_path / "run/metrics.jsonl").read_text().splitlines()]
    evaluations = [row for row in rows if "evaluation" in row]
    assert [row["steps"] for row in evaluations] == [60, 120]
    assert all(list(row["evaluation"]) == ["hopper", "hopper_4"] for row in evaluations)
    worth = {row["steps"]: row["evaluation"]["hopper_4"]["score"] for row in evaluations}
    best = json.loads(
        in_process("evaluate", "run", "hopper_3", "--episodes", 1, "--checkpoint", "best", "--json").stdout
    )
    assert best["steps"] == max(worth, key=lambda steps: worth[steps])
    assert best["elapsed_s"] > 0
    done = in_process("evaluate", "run", "hopper_3", "--episodes", 1)
    assert "trained for 130 steps, in " in done.stderr


def test_a_method_and_a_robot_that_do_not_fit_are_named(morphkit: Run) -> None:
    rounds = ("--set", "model.method=amorpheus", "--set", "trainer.schedule=rounds", "--set", "trainer.num_envs=1")
    morphkit("train", "hopper", "--run", "run", "--steps", 60, *TINY, *rounds)
    done = morphkit("evaluate", "run", "arm", code=2)
    assert done.stderr.startswith("error: ")
    assert "method 'amorpheus'" in done.stderr


def test_a_run_that_diverges_fails_with_exit_code_1_and_keeps_no_poisoned_checkpoint(
    morphkit: Run, tmp_path: Path
) -> None:
    wild = ("--set", "td3.learning_rate=1e30", "--set", "trainer.start_steps=4")
    done = morphkit("train", "hopper", "--run", "run", "--steps", 4000, *TINY, *wild, code=1)
    assert "training diverged" in done.stderr
    assert (
        not any((tmp_path / "run/checkpoints").glob("step-*"))
        or np.isfinite(np.concatenate([array.ravel() for array in weights(tmp_path / "run").values()])).all()
    )
