"""Run folders of strangers: links lead nowhere, and only what morphkit makes is removed."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from morphkit.errors import CheckpointError, MorphkitError, OutputError
from morphkit.registry import load
from morphkit_rl.algorithms.policy import Policy
from morphkit_rl.benchmark.cells import create, read_matrix
from morphkit_rl.runs import checkpoint
from morphkit_rl.runs.lock import hold
from morphkit_rl.runs.metrics_log import read_metrics
from morphkit_rl.training.trainer import resume, train
from tests.support.benchmark_matrix import make_matrix
from tests.support.run_folders import small_config

Attack = Callable[[Path, Path], None]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = tmp_path_factory.mktemp("whole") / "run"
    train([load("hopper_3")], run, small_config(), steps=20)
    return run


@pytest.fixture
def run(whole: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(whole, tmp_path / "run"))


@pytest.fixture
def treasure(tmp_path: Path) -> Path:
    """A folder of the user that no run has any business with."""
    folder = tmp_path / "treasure"
    (folder / "step-000000000020-0000000003").mkdir(parents=True)
    (folder / "thesis").mkdir()
    for name in ("thesis/text", "step-000000000020-0000000003/data", "sweeps-0000000000-0000000010.safetensors", "a"):
        (folder / name).write_text(f"mine: {name}")
    return folder


def content(folder: Path) -> dict[str, bytes | None]:
    return {str(p.relative_to(folder)): None if p.is_dir() else p.read_bytes() for p in sorted(folder.rglob("*"))}


def replace_by_link(name: str, target: str = ".") -> Attack:
    def attack(run: Path, treasure: Path) -> None:
        place = run / name
        if place.is_dir():
            shutil.rmtree(place)
        else:
            place.unlink(missing_ok=True)
        place.symlink_to(treasure / target)

    return attack


def link_in_checkpoint(run: Path, treasure: Path) -> None:
    policy = next((run / "checkpoints").glob("step-*/policy.safetensors"))
    policy.unlink()
    policy.symlink_to(treasure / "a")


def link_as_checkpoint(run: Path, treasure: Path) -> None:
    folder = next((run / "checkpoints").glob("step-*"))
    folder.rename(treasure / "moved")
    folder.symlink_to(treasure / "moved")


def latest_that_leads_out(run: Path, treasure: Path) -> None:
    folder = next((run / "checkpoints").glob("step-*"))
    folder.rename(treasure / "step-000000000020-0000000003" / "ck")
    (run / "checkpoints" / "latest").write_text("../../treasure/step-000000000020-0000000003/ck\n")


def run_itself(run: Path, treasure: Path) -> None:
    run.rename(treasure / "run")
    run.symlink_to(treasure / "run")


def pipe(name: str) -> Attack:
    def attack(run: Path, _: Path) -> None:
        (run / name).unlink(missing_ok=True)
        os.mkfifo(run / name)

    return attack


ATTACKS: dict[str, Attack] = {
    "checkpoints": replace_by_link("checkpoints"),
    "replay": replace_by_link("replay"),
    "robots": replace_by_link("robots"),
    "tensorboard": replace_by_link("tensorboard"),
    "owner": replace_by_link("owner.json", "a"),
    "lock": replace_by_link(".lock", "a"),
    "config": replace_by_link("config.json", "a"),
    "metrics": replace_by_link("metrics.jsonl", "a"),
    "temporary metrics": replace_by_link(".metrics.jsonl.tmp", "a"),
    "latest": replace_by_link("checkpoints/latest", "a"),
    "dangling": replace_by_link("metrics.jsonl", "none"),
    "file of a checkpoint": link_in_checkpoint,
    "folder of a checkpoint": link_as_checkpoint,
    "latest leads out": latest_that_leads_out,
    "stage of a checkpoint": replace_by_link("checkpoints/.step-000000000040-0000000008.tmp"),
    "run": run_itself,
    "pipe as metrics": pipe("metrics.jsonl"),
    "pipe as lock": pipe(".lock"),
}


@pytest.mark.parametrize("name", ATTACKS)
def test_a_run_folder_that_leads_out_is_refused_and_nothing_is_touched(name: str, run: Path, treasure: Path) -> None:
    ATTACKS[name](run, treasure)
    before = content(run.parent / "treasure")
    links = sorted(str(path) for path in run.rglob("*"))
    for use in (lambda: resume(run, steps=60), lambda: Policy.load(run), lambda: checkpoint.load_state(run)):
        with pytest.raises(MorphkitError, match=r"is a link to|is no name of a checkpoint|is neither a file nor a"):
            use()
    with pytest.raises(MorphkitError):
        train([load("hopper_3")], run, small_config(), steps=20)
    if name != "latest leads out":
        with pytest.raises(CheckpointError):
            read_metrics(run)
    assert content(run.parent / "treasure") == before
    assert sorted(str(path) for path in run.rglob("*")) == links


@pytest.mark.parametrize("name", ["metrics.jsonl", "owner.json", "config.json", "checkpoints/latest"])
def test_a_file_with_a_second_name_elsewhere_is_replaced_and_not_written_into(name: str, run: Path) -> None:
    mine = run.parent / "mine"
    if (run / name).exists():
        (run / name).rename(mine)
    else:
        mine.write_text("mine")
    (run / name).hardlink_to(mine)
    before = mine.read_bytes()
    resume(run, steps=40)
    assert mine.read_bytes() == before


def test_a_lock_that_is_a_second_name_of_a_file_is_refused(run: Path) -> None:
    mine = run.parent / "mine"
    mine.write_text("mine")
    (run / ".lock").unlink(missing_ok=True)
    (run / ".lock").hardlink_to(mine)
    with pytest.raises(CheckpointError, match=r"\.lock: is another name of a file"):
        resume(run, steps=40)
    assert mine.read_text() == "mine"


def test_only_what_a_run_makes_itself_is_removed(run: Path) -> None:
    kept = ["checkpoints/notes/text", "checkpoints/step-1/text", "checkpoints/a.txt", "replay/a.safetensors", "b/c/d"]
    for name in kept:
        (run / name).parent.mkdir(parents=True, exist_ok=True)
        (run / name).write_text("mine")
    left = ["checkpoints/.step-000000000099-0000000099.tmp/a", "checkpoints/step-000000000001-0000000001/a"]
    left += [
        "replay/sweeps-0000000000-0000000099.safetensors",
        "replay/.sweeps-0000000000-0000000099.01234567.safetensors",
    ]
    left += ["checkpoints/.latest.0123abcd", ".metrics.0123abcd.jsonl", ".config.0123abcd.json"]
    for name in left:
        (run / name).parent.mkdir(parents=True, exist_ok=True)
        (run / name).write_text("left by a killed process")
    resume(run, steps=40)
    assert all((run / name).read_text() == "mine" for name in kept)
    assert [name for name in left if (run / name).exists()] == []


CELL = "1/hoppers/limb-former/seed-0"


@pytest.mark.parametrize("place", ["1", "1/hoppers", CELL, f"{CELL}/run"])
def test_a_matrix_that_leads_out_is_refused(place: str, tmp_path: Path) -> None:
    plans = make_matrix(tmp_path / "matrix", tasks=["hoppers"], seeds=1)
    moved = tmp_path / "moved"
    (tmp_path / "matrix" / place).rename(moved)
    (tmp_path / "matrix" / place).symlink_to(moved)
    before = content(moved)
    for use in (lambda: read_matrix(tmp_path / "matrix"), lambda: create(plans, tmp_path / "matrix")):
        with pytest.raises(CheckpointError, match=f"{place}: is a link to"):
            use()
    assert content(moved) == before


def test_a_folder_of_somebody_else_s_where_a_cell_trains_is_left_alone(tmp_path: Path) -> None:
    from morphkit_rl.benchmark import runner

    plans = make_matrix(
        tmp_path / "matrix", tasks=["hoppers"], seeds=1, states={("hoppers", "limb-former", 0): "not started"}
    )
    mine = tmp_path / "matrix" / CELL / "run" / "mine"
    mine.parent.mkdir()
    mine.write_text("mine")
    with pytest.raises(OutputError, match="not empty"):
        runner._train(plans[0], mine.parent, "cpu", lambda _: None)
    assert mine.read_text() == "mine"


@pytest.mark.parametrize("made", [(), ("checkpoints",), ("checkpoints", "replay", "robots")])
def test_a_folder_left_before_its_first_file_can_be_trained_into(made: tuple[str, ...], tmp_path: Path) -> None:
    run = tmp_path / "run"
    run.mkdir()
    for name in made:
        (run / name).mkdir()
    assert train([load("hopper_3")], run, small_config(), steps=4).steps == 4


def test_a_folder_with_a_file_cannot_be_trained_into(tmp_path: Path) -> None:
    (tmp_path / "run" / "robots").mkdir(parents=True)
    (tmp_path / "run" / "robots" / "mine.xml").write_text("mine")
    with pytest.raises(OutputError, match="not empty"):
        train([load("hopper_3")], tmp_path / "run", small_config(), steps=4)


@pytest.mark.parametrize("make", [Path.mkdir, os.mkfifo])
@pytest.mark.parametrize("name", [".lock", "owner.json"])
def test_a_lock_that_is_no_file_is_refused(name: str, tmp_path: Path, make: Callable[[Path], None]) -> None:
    make(tmp_path / name)
    with (
        pytest.raises(CheckpointError, match=r"is no file, and so no lock|neither a file nor a folder"),
        hold(tmp_path),
    ):
        pass


def test_metrics_that_are_no_file_are_refused(run: Path) -> None:
    (run / "metrics.jsonl").unlink()
    (run / "metrics.jsonl").mkdir()
    with pytest.raises(CheckpointError, match=r"metrics\.jsonl: cannot be read"):
        resume(run, steps=40)


BEFORE_CONFIG = ("robots/000-hopper.xml", "robots/.001-a.0123abcd.xml", ".config.0123abcd.json", ".lock",
                 "start/policy.json", "start/robots/000-a.xml")  # fmt: skip


@pytest.mark.parametrize("left", BEFORE_CONFIG)
def test_a_run_killed_before_its_settings_begins_anew(left: str, tmp_path: Path) -> None:
    run = tmp_path / "run"
    (run / left).parent.mkdir(parents=True)
    (run / left).write_text("left")
    train([load("hopper_3")], run, small_config(), steps=8)
    assert not (run / left).exists() or left == ".lock"
    assert checkpoint.load_state(run)[1]["steps"] >= 8


@pytest.mark.parametrize("name", ["robots/thesis.txt", "start/thesis.txt", "thesis", "checkpoints/latest", "a/b"])
def test_a_folder_with_other_files_is_no_run_that_was_killed(name: str, tmp_path: Path) -> None:
    run = tmp_path / "run"
    for each in (name, "robots/000-hopper.xml"):
        (run / each).parent.mkdir(parents=True, exist_ok=True)
        (run / each).write_text("mine")
    before = content(run)
    with pytest.raises(OutputError, match="not empty"):
        train([load("hopper_3")], run, small_config(), steps=8)
    assert content(run) == before


def test_a_tracker_that_cannot_write_is_an_error_of_one_line(run: Path) -> None:
    shutil.rmtree(run / "tensorboard")
    (run / "tensorboard").write_text("")
    with pytest.raises(OutputError, match="cannot write metrics"):
        resume(run, steps=40)
