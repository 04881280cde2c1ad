"""Curves, settings, tables and films on TensorBoard, Weights & Biases and Trackio."""

from __future__ import annotations

import json
import sqlite3
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from morphkit.errors import DependencyError, OutputError
from morphkit.registry import load
from morphkit.viewer.media import write_video
from morphkit_cli.main import run as command
from morphkit_rl.runs import trackers
from morphkit_rl.runs.run_folder import TRACKED
from morphkit_rl.training.trainer import resume, train
from tests.support.run_folders import small_config


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run of two parts."""
    train([load("hopper_3")], tmp_path / "run", small_config(), steps=20)
    resume(tmp_path / "run", steps=40)
    return tmp_path / "run"


@pytest.fixture
def film(tmp_path: Path) -> Path:
    return write_video(np.zeros((3, 16, 16, 3), np.uint8), tmp_path / "film.gif", 10)


def finish(run: Path, service: trackers.Service, film: Path) -> None:
    """What `morphkit evaluate --track` shows."""
    tracker = trackers.open_tracker(run, service)
    tracker.table("evaluation", ("body", "return"), [("hopper_3", 5.0)], 40)
    tracker.film("film/hopper_3", film, 40)
    tracker.close()


def test_files_of_tensorboard_are_in_order_however_fast_they_follow_each_other(tmp_path: Path) -> None:
    begun = []
    for _ in range(3):
        trackers.open_tracker(tmp_path, "tensorboard", 0).close()
        begun.append({file.name.split(".")[3] for file in (tmp_path / "tensorboard").iterdir()})
    assert [len(seconds) for seconds in begun] == [1, 2, 3]


def test_tensorboard_has_settings_curves_table_and_film(run: Path, film: Path) -> None:
    finish(run, "tensorboard", film)
    events = EventAccumulator(str(run / "tensorboard")).Reload()
    steps = [event.step for event in events.Scalars("updates")]
    rows = [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]
    assert steps == [row["steps"] for row in rows], "each row once, also that which the run was resumed from"
    text = {tag: [event.tensor_proto.string_val[0].decode() for event in events.Tensors(tag)] for tag in
            events.Tags()["tensors"]}  # fmt: skip
    assert json.loads((run / "config.json").read_text())["seed"] == 0
    assert '"seed": 0' in text["config/text_summary"][0]
    assert len(text["training returns/text_summary"]) == 2
    assert text["evaluation/text_summary"] == ["| body | return |\n| --- | --- |\n| hopper_3 | 5.0 |\n"]
    (image,) = events.Images("film/hopper_3")
    assert image.encoded_image_string == film.read_bytes()


def test_one_that_is_not_installed_is_named_before_anything_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "wandb", None)
    with pytest.raises(DependencyError, match=r'--track wandb needs pip install "morphkit\[wandb\]"'):
        trackers.require("wandb")
    assert command(["train", "hopper_3", "--run", str(tmp_path / "run"), "--track", "wandb", "--steps", "20"]) == 2
    assert not (tmp_path / "run").exists()
    assert capsys.readouterr().err.count("\n") == 1


class Recorder:
    """Stands in for the modules of both services."""

    Settings = SimpleNamespace

    def __init__(self) -> None:
        self.begun: list[dict[str, Any]] = []
        self.logged: list[tuple[dict[str, Any], int | None]] = []
        self.finished = 0

    def init(self, project: str, **options: Any) -> Recorder:
        if not options.get("settings"):
            print("* Trackio project initialized")  # as Trackio does
        self.begun.append({"project": project, **options})
        return self

    def define_metric(self, *_: Any, **__: Any) -> None:
        pass

    def log(self, values: dict[str, Any], step: int | None = None) -> None:
        self.logged.append((values, step))

    def finish(self) -> None:
        self.finished += 1

    def Table(self, columns: list[str], data: list[list[Any]]) -> Any:
        return columns, data

    def Video(self, path: str | Path, format: str) -> Any:
        return Path(path), format


@pytest.fixture(params=["wandb", "trackio"])
def service(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> tuple[Any, Recorder]:
    recorder = Recorder()
    monkeypatch.setitem(sys.modules, request.param, recorder)
    return request.param, recorder


def test_a_service_is_told_everything_and_knows_a_run_again(
    service: tuple[trackers.Service, Recorder], tmp_path: Path, film: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name, recorder = service
    run = tmp_path / "a run"
    train([load("hopper_3")], run, small_config(f"trainer.track={name}"), steps=20)
    resume(run, steps=40)
    finish(run, name, film)
    assert recorder.finished == 3
    assert not capsys.readouterr().out, "results alone"
    assert {begun["project"] for begun in recorder.begun} == {"morphkit"}
    assert {begun["name"] for begun in recorder.begun} == {(run / TRACKED).read_text().strip()}
    assert {begun["resume"] for begun in recorder.begun} == {"allow"}
    assert [begun["config"]["steps"] for begun in recorder.begun] == [20, 40, 40]
    curves = [(values, values.get("steps", step)) for values, step in recorder.logged if "updates" in values]
    rows = [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]
    assert [(values["updates"], step) for values, step in curves] == [(row["updates"], row["steps"]) for row in rows]
    shown = {key: value for values, _ in recorder.logged for key, value in values.items()}
    assert shown["evaluation"] == (["body", "return"], [["hopper_3", 5.0]])
    assert shown["training returns"][0] == ["body", "return"]
    assert shown["film/hopper_3"] == (film, "gif")
    assert not (run / "tensorboard").exists()


def test_what_a_service_refuses_is_one_line(
    service: tuple[trackers.Service, Recorder], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name, recorder = service
    refusal = type("CommError", (Exception,), {"__module__": f"{name}.errors"})

    def refuse(*_: Any, **__: Any) -> None:
        raise refusal("no API key\nlog in first")

    run, accept = tmp_path / "run", recorder.init
    message = f"run: cannot track with {name}: no API key$"
    monkeypatch.setattr(recorder, "init", refuse)
    with pytest.raises(OutputError, match=message):
        train([load("hopper_3")], run, small_config(f"trainer.track={name}"), steps=20)
    assert not run.exists(), "the same command works after a login"
    monkeypatch.setattr(recorder, "init", accept)
    train([load("hopper_3")], run, small_config(f"trainer.track={name}"), steps=20)
    kept = (run / "metrics.jsonl").read_text()
    monkeypatch.setattr(recorder, "init", refuse)
    with pytest.raises(OutputError, match=message):
        resume(run, steps=40)
    assert (run / "metrics.jsonl").read_text() == kept
    monkeypatch.setattr(recorder, "init", accept)
    assert resume(run, steps=40).steps == 40


def test_wandb_offline(tmp_path: Path, film: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("wandb")
    monkeypatch.setenv("WANDB_MODE", "offline")
    monkeypatch.setenv("WANDB_DIR", str(tmp_path))
    train([load("hopper_3")], tmp_path / "run", small_config("trainer.track=wandb"), steps=20)
    finish(tmp_path / "run", "wandb", film)
    resume(tmp_path / "run", steps=40)
    first, second, third = sorted((tmp_path / "wandb").glob("offline-run-*"), key=lambda path: path.stat().st_mtime)
    tracked = (tmp_path / "run" / TRACKED).read_text().strip()
    assert all(path.name.endswith(f"-{tracked}") for path in (first, second, third)), "parts of one run"
    assert b"critic_loss" in b"".join(path.read_bytes() for path in third.glob("*.wandb"))
    written = b"".join(path.read_bytes() for path in first.glob("*.wandb"))
    for part in (b"critic_loss", b"replay_capacity", b"training returns"):
        assert part in written
    assert list((second / "files/media/videos/film").glob("*.gif"))
    assert list((second / "files/media/table").glob("evaluation*.json"))


def test_trackio_offline(tmp_path: Path, film: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    utils = pytest.importorskip("trackio.utils")
    for module in [each for name, each in sys.modules.items() if name.startswith("trackio")]:
        for attribute, folder in (("TRACKIO_DIR", tmp_path / "t"), ("MEDIA_DIR", tmp_path / "t/media")):
            if hasattr(module, attribute):
                monkeypatch.setattr(module, attribute, folder)
    assert tmp_path / "t" == utils.TRACKIO_DIR
    train([load("hopper_3")], tmp_path / "run", small_config("trainer.track=trackio"), steps=20)
    finish(tmp_path / "run", "trackio", film)
    resume(tmp_path / "run", steps=40)
    (database,) = (tmp_path / "t").glob("morphkit*.db")
    with sqlite3.connect(database) as connection:
        names = {row[0] for row in connection.execute("select distinct run_name from metrics")}
        last = max(row[0] for row in connection.execute("select step from metrics"))
        text = "".join(str(row) for row in connection.execute("select * from metrics"))
    assert names == {(tmp_path / "run" / TRACKED).read_text().strip()}, "a resumed run is no second one"
    assert last == 40
    for part in ("critic_loss", "training returns", "evaluation", "film/hopper_3"):
        assert part in text
