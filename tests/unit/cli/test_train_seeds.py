"""`morphkit train --seeds`: what each seed is asked for."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from morphkit_cli import main
from morphkit_cli.train_seeds import _anywhere, train_seeds


@pytest.fixture
def given(tmp_path: Path) -> dict[str, Any]:
    options = dict.fromkeys(("minutes", "encoder", "preset", "task", "start", "device", "seed"))
    flags = dict.fromkeys(("quiet", "as_json", "resume"), False)
    return {"robots": ["hopper"], "run": tmp_path / "run", "steps": 100, **options, **flags}


def test_each_seed_has_a_folder_of_its_own_and_goes_on_where_it_was(given: dict[str, Any], tmp_path: Path) -> None:
    calls: list[dict[str, Any]] = []
    (tmp_path / "run/seed-5").mkdir(parents=True)
    (tmp_path / "run/seed-5/config.json").write_text("{}")
    train_seeds(lambda **order: calls.append(order), {**given, "seed": 4}, 2, None, 1)
    fresh, begun = calls
    assert (fresh["run"], fresh["seed"], fresh["robots"]) == (tmp_path / "run/seed-4", 4, ["hopper"])
    resumed = {"minutes": None, "steps": 100, "encoder": None, "quiet": False}
    assert begun == {"run": tmp_path / "run/seed-5", "resume": True, **resumed}


def test_a_node_gets_paths_that_hold_anywhere_and_names_as_they_are(
    given: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.xml").write_text("")
    order = _anywhere({**given, "robots": ["hopper", "mine.xml"], "task": "walk", "run": Path("run")})
    assert order["robots"] == ["hopper", str(tmp_path / "mine.xml")]
    assert (order["task"], order["run"]) == ("walk", tmp_path / "run")


@pytest.mark.parametrize("words", [["--ray", "--seeds", "2", "--json"], ["--seeds", "2", "--resume"], ["--ray"]])
def test_what_does_not_go_together_is_refused(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main.run(["train", "hopper", "--run", str(tmp_path / "run"), *words]) == 2
    assert "--seeds" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_ray_without_an_address_is_this_machine() -> None:
    assert main._with_values(["run", "--ray"]) == ["run", "--ray=local"]
    assert main._with_values(["run", "--ray", "--seeds", "2"]) == ["run", "--ray=local", "--seeds", "2"]
    assert main._with_values(["run", "--ray", "host:1", "--ray"]) == ["run", "--ray", "host:1", "--ray=local"]
    assert main._with_values([]) == []
    assert "[ADDRESS]" in CliRunner().invoke(main.app, ["train", "--help"], terminal_width=200).stdout
