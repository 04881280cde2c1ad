"""`zoo:NAME` wherever a run works, on a policy of a few steps."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import add_to_zoo
import pytest

from morphkit_cli.main import run
from morphkit_rl.runs import zoo

TINY = ("model.d_model=8", "model.layers=1", "model.feedforward=8", "td3.batch_size=4", "trainer.num_envs=1")


@pytest.fixture(scope="module")
def policies(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A zoo with one policy, `hoppers`."""
    folder = tmp_path_factory.mktemp("zoo")
    settings = [word for setting in TINY for word in ("--set", setting)]
    made = str(folder / "run")
    training = ["hopper_3", "hopper_4", "--hold-out", "hopper_4", "--run", made, "--steps", "4", "--quiet"]
    assert run(["train", *training, *settings]) == 0
    words = ["add_to_zoo", made, "hoppers", "hopper_4", "--summary", "Hops.", "--command", "morphkit train ..."]
    before, sys.argv = sys.argv, [*words, "--episodes", "2", "--output", str(folder)]
    try:
        assert add_to_zoo.main() == 0
        assert add_to_zoo.main() == 2  # it exists
    finally:
        sys.argv = before
    return folder


@pytest.fixture(autouse=True)
def own_zoo(policies: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(zoo, "_folder", lambda: policies)


def test_it_is_listed_with_what_was_measured(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["zoo"]) == 0
    heading, _, row = capsys.readouterr().out.splitlines()
    assert heading.split() == ["policy", "method", "bodies", "steps", "held", "out", "normalized"]
    assert row.split()[:5] == ["zoo:hoppers", "limb-former", "1", "4", "1"]
    assert run(["zoo", "--json"]) == 0
    (listed,) = json.loads(capsys.readouterr().out)
    assert (listed["trained_on"], listed["held_out"]) == (["hopper_3"], ["hopper_4"])
    assert {row["robot"]: len(row["returns"]) for row in listed["evaluation"]} == {"hopper_3": 2, "hopper_4": 2}


def test_its_card_says_how_it_was_made(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["show", "zoo:hoppers"]) == 0
    card = capsys.readouterr().out
    for words in ("Hops.", "| held out | hopper_4 |", "| seed | 0 |", "$ morphkit train ...", "| license | MIT |"):
        assert words in card
    assert [line.split(" | ")[:2] for line in card.splitlines() if line.startswith("| hopper")] == [
        ["| hopper_4", "never"],
        ["| hopper_3", "yes"],
    ]
    assert run(["show", "zoo:hoppers", "--web"]) == 2
    assert "is a policy" in capsys.readouterr().err


def test_it_is_evaluated_and_trained_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["evaluate", "zoo:hoppers", "hopper_3", "hopper_5", "--episodes", "1", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["run"] == "zoo:hoppers"
    assert {row["robot"]: row["trained_on"] for row in found["robots"]} == {"hopper_3": True, "hopper_5": False}
    assert run(["evaluate", "zoo:hoppers", "hopper_3", "--track", "tensorboard"]) == 2
    assert "zoo:hoppers is a policy without its run" in capsys.readouterr().err
    tuned = tmp_path / "tuned"
    words = ["train", "hopper_5", "--run", str(tuned), "--from", "zoo:hoppers", "--steps", "4", "--quiet"]
    assert run(words) == 0
    assert run(["evaluate", str(tuned), "hopper_5", "--episodes", "1"]) == 0
    assert run(["train", "--run", str(tuned), "--resume", "--from", "zoo:hoppers"]) == 2
    assert "leave out --from" in capsys.readouterr().err


@pytest.mark.parametrize("words", [["evaluate", "zoo:hopers", "hopper_3"], ["show", "zoo:hopers"]])
def test_an_unknown_name_is_one_line(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(words) == 2
    expected = "error: zoo:hopers: no such policy ships with morphkit; did you mean 'hoppers'?\n"
    assert capsys.readouterr().err == expected
