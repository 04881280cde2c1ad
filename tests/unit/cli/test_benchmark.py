"""`morphkit benchmark` in this process: the bodies, validation, failures and bad input."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from morphkit_cli.main import run
from morphkit_rl.benchmark.cells import read_matrix
from morphkit_rl.training import trainer

TINY = (
    *("--set", "model.d_model=16", "--set", "model.layers=1", "--set", "model.feedforward=16"),
    *("--set", "td3.batch_size=16", "--set", "trainer.start_steps=40", "--set", "trainer.num_envs=2"),
    *("--set", "trainer.updates_per_sweep=1", "--set", "trainer.evaluate_steps=60"),
    *("--set", "trainer.evaluate_episodes=1", "--steps", "120", "--episodes", "1", "--quiet"),
)


@pytest.fixture(autouse=True)
def in_an_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def matrix(*arguments: str) -> int:
    return run(["benchmark", "run", "--method", "limb-former", *arguments, *TINY])


def roles(folder: Path) -> dict[str, str]:
    result = json.loads((folder / "result.json").read_text())
    return {robot["robot"]: robot["role"] for robot in result["robots"]}


def test_validation_leaves_the_test_set_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("mine.toml").write_text("[splits.mine.hoppers]\ntrain = ['hopper_3', 'hopper_4']\ntest = ['hopper_5']\n")
    own = ("--task", "hoppers", "--split", "mine", "--file", "mine.toml", "--seeds", "1")
    cell = Path("mine/hoppers/limb-former/seed-0")
    assert matrix(*own, "--out", "v", "--validate") == 0
    assert sorted(roles("v" / cell).values()) == ["train", "validation"]
    metrics = ("v" / cell / "run/metrics.jsonl").read_text()
    assert '"evaluation"' in metrics
    assert "hopper_5" not in metrics + ("v" / cell / "run/config.json").read_text()
    assert matrix(*own, "--out", "v") == 2
    assert "choose another --out" in capsys.readouterr().err
    assert matrix(*own, "--out", "t") == 0
    assert roles("t" / cell) == {"hopper_3": "train", "hopper_4": "train", "hopper_5": "test"}


def test_bodies_cut_out_of_training_robots_train_but_are_no_result(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = ("--task", "hoppers", "--split", "1", "--seeds", "1", "--out", "c")
    cell = Path("c/1/hoppers/limb-former/seed-0")
    assert matrix(*own, "--cuts", "2") == 0
    assert roles(cell) == {"hopper_3": "train", "hopper_4": "train", "hopper_5": "train"}
    trained = [robot["name"] for robot in json.loads((cell / "run/config.json").read_text())["robots"]]
    assert trained[3:] == ["hopper_3-no-foot", "hopper_4-no-foot"]
    assert matrix(*own) == 2
    assert "train on bodies cut out of training robots; choose another --out" in capsys.readouterr().err
    assert run(["benchmark", "report", "c"]) == 0
    assert "Not the published protocol" in Path("c/report/report.md").read_text()


def test_a_failed_cell_stops_no_other_and_is_tried_again_while_a_done_one_is_left(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    hoppers = ("--task", "hoppers", "--split", "1", "--seeds", "2", "--out", "m")
    train = trainer.train

    def breaks(*arguments: Any, seed: int, **options: Any) -> Any:
        if seed == 0:
            raise RuntimeError("the disk is on fire")
        return train(*arguments, seed=seed, **options)

    with monkeypatch.context() as patch:
        patch.setattr(trainer, "train", breaks)
        assert matrix(*hoppers) == 1
    first, second = read_matrix(Path("m"))
    assert (first.state, first.detail) == ("failed", "RuntimeError: the disk is on fire")
    assert second.state == "done"
    assert "Traceback" in json.loads((first.folder / "failure.json").read_text())["traceback"]
    evaluated = (second.folder / "result.json").stat().st_mtime_ns
    assert matrix(*hoppers) == 0
    assert [each.state for each in read_matrix(Path("m"))] == ["done", "done"]
    assert (second.folder / "result.json").stat().st_mtime_ns == evaluated, "the test set is met once"
    capsys.readouterr()
    assert run(["benchmark", "status", "m"]) == 0
    shown = capsys.readouterr()
    assert shown.out.count("done") == 2
    assert "2 cells: 2 done" in shown.err


def test_a_run_killed_while_its_folder_was_made_starts_again() -> None:
    half = Path("m/1/hoppers/limb-former/seed-0/run/robots")
    half.mkdir(parents=True)
    assert matrix("--task", "hoppers", "--split", "1", "--seeds", "1", "--out", "m") == 0


def test_the_bodies_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["benchmark", "robots", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert len(found["robots"]) == 32
    by_name = {row["name"]: row for row in found["robots"]}
    assert by_name["cheetah_3_balanced"] == {
        "name": "cheetah_3_balanced",
        "group": "cheetahs",
        "limbs": ["torso", "bthigh", "fthigh"],
        "expert_return": 2126.0,
        "splits": {"1": "test", "2": "train", "3": "test"},
    }
    assert found["unseen_limbs"]["2"]["walkers"] == ["left3", "right3"]
    assert run(["benchmark", "robots"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 2 + 32


HOPPERS = ("run", "--task", "hoppers", "--split", "1", "--method", "limb-former")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("run", "--task", "hopper", "--split", "1", "--method", "limb-former"), "did you mean 'hoppers'"),
        (("run", "--task", "hoppers", "--split", "9", "--method", "limb-former"), "no split '9'"),
        (("run", "--task", "hoppers", "--split", "1", "--method", "limbformer"), "did you mean 'limb-former'"),
        ((*HOPPERS, "--set", "td3.taux=1"), "did you mean"),
        ((*HOPPERS, "--file", "no.toml"), "no.toml"),
        ((*HOPPERS, "--preset", "no.toml"), "no.toml"),
        ((*HOPPERS, "--preset", ""), "no preset ''"),
        ((*HOPPERS, "--seeds", "0"), "greater than or equal to 1"),
        (("status", "m"), "no such folder"),
        (("report", "m"), "no such folder"),
        (("robots", "--png", "bodies.txt"), "must end in .png"),
    ],
)
def test_bad_input_is_named_and_leaves_nothing_behind(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], message: str
) -> None:
    assert run(["benchmark", *arguments]) == 2
    shown = capsys.readouterr().err
    assert message in shown
    assert "error:" in shown
    assert not list(tmp_path.iterdir())
