"""Policy folders: a run's policy without the rest, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from morphkit.errors import CheckpointError, OutputError, UnknownNameError
from morphkit.registry import load
from morphkit_rl.algorithms.policy import Policy
from morphkit_rl.runs import run_settings, saved_policy, zoo
from morphkit_rl.training.trainer import train
from tests.support.run_folders import small_config


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("saved") / "run"
    train([load("hopper_3"), load("hopper_4")], folder, small_config(), steps=16)
    return folder


def test_a_policy_folder_acts_as_its_run_and_says_nothing_of_this_machine(run: Path, tmp_path: Path) -> None:
    folder = tmp_path / "policy"
    saved_policy.save(saved_policy.load(run), folder, {saved_policy.CARD: "a card\n"})
    names = {path.name for path in folder.iterdir()}
    assert names == {"config.json", "policy.json", "policy.safetensors", "robots", "README.md"}
    keys = saved_policy.load(folder).arrays.keys()
    assert {key.partition("/")[0] for key in keys} == {"actor", "normalizer", "embedding"}
    own, policy = Policy.load(run), Policy.load(folder)
    (robot,) = policy.prepare([load("hopper_4")])
    obs = np.random.default_rng(0).standard_normal((5, len(robot.spec.sensors))).astype(np.float32)
    np.testing.assert_array_equal(policy.act(robot.spec, obs), own.act(robot.spec, obs))
    assert str(load("hopper_3").folder) in (run / "config.json").read_text()
    assert "/" not in "".join(str(robot["folder"]) for robot in saved_policy.load(folder).settings["robots"])
    assert [robot.name for robot in run_settings.load(folder).robots] == ["hopper_3", "hopper_4"]
    assert saved_policy.read_card(folder) == "a card\n"
    assert saved_policy.read_evaluation(folder) is None


def test_damage_is_found_and_nothing_is_overwritten(run: Path, tmp_path: Path) -> None:
    folder = tmp_path / "policy"
    saved_policy.save(saved_policy.load(run), folder)
    with pytest.raises(OutputError, match="policy: exists"):
        saved_policy.save(saved_policy.load(run), folder)
    arrays = folder / saved_policy.ARRAYS
    content = bytearray(arrays.read_bytes())
    content[-1] ^= 1
    arrays.write_bytes(content)
    with pytest.raises(CheckpointError, match=r"policy\.safetensors: damaged: its SHA-256"):
        Policy.load(folder)
    arrays.unlink()
    with pytest.raises(CheckpointError, match="damaged or missing"):
        Policy.load(folder)
    (folder / "policy.json").write_text('{"format_version": 1}')
    with pytest.raises(CheckpointError, match=r"policy\.json: damaged: it lacks"):
        Policy.load(folder)
    with pytest.raises(CheckpointError, match=r"README\.md: damaged or missing"):
        saved_policy.read_card(folder)


def test_a_shipped_policy_is_found_by_name(run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(zoo, "_folder", lambda: tmp_path)
    with pytest.raises(UnknownNameError, match="zoo:hoppers: no such policy ships with morphkit; none ships"):
        Policy.load("zoo:hoppers")
    saved_policy.save(saved_policy.load(run), tmp_path / "hoppers")
    (tmp_path / "no-policy").mkdir()
    assert zoo.names() == ["hoppers"]
    assert Policy.load("zoo:hoppers").trained_on == ("hopper_3", "hopper_4")
    with pytest.raises(UnknownNameError, match=r"zoo:hopers: .*; did you mean 'hoppers'\?"):
        Policy.load(Path("zoo:hopers"))


def test_every_policy_that_ships_is_whole_and_small() -> None:
    held_out: set[str] = set()
    for name in zoo.names():
        policy = saved_policy.load(f"{zoo.PREFIX}{name}")
        evaluation = saved_policy.read_evaluation(policy.folder)
        assert evaluation is not None
        evaluated = {row["robot"] for row in evaluation["robots"]}
        assert evaluated >= set(policy.robots)
        held_out |= evaluated - set(policy.robots)
        assert saved_policy.read_card(policy.folder).startswith("---\nlicense: mit\n")
        assert run_settings.load(policy.folder).seed >= 0
        assert sum(path.stat().st_size for path in policy.folder.rglob("*")) < 2_000_000
    assert held_out
