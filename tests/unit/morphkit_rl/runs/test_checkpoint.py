"""Damaged, foreign and failed checkpoints."""

from __future__ import annotations

import json
import os
import random
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from morphkit.errors import CheckpointError, OutputError
from morphkit.registry import load
from morphkit_cli.main import run as command
from morphkit_rl.algorithms.policy import Policy
from morphkit_rl.runs import checkpoint, run_settings, schema
from morphkit_rl.runs.metrics_log import read_metrics
from morphkit_rl.training.session import Session
from morphkit_rl.training.trainer import resume, train
from tests.fuzz.run_folders import attempt_run
from tests.support.run_folders import small_config


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = tmp_path_factory.mktemp("whole") / "run"
    before = os.umask(0o027)
    try:
        train([load("hopper_3")], run, small_config(), steps=20)
    finally:
        os.umask(before)
    return run


@pytest.fixture
def run(whole: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(whole, tmp_path / "run"))


def folder_of(run: Path) -> Path:
    return run / "checkpoints" / (run / "checkpoints" / "latest").read_text().strip()


def listing(run: Path) -> list[str]:
    return sorted(str(p.relative_to(run)) for p in run.rglob("*") if "tensorboard" not in p.parts)


def test_files_have_the_mode_that_the_umask_gives(whole: Path) -> None:
    files = [path for path in whole.rglob("*") if path.is_file() and path.name != ".lock"]
    assert len(files) >= 9
    assert {path.name: path.stat().st_mode & 0o777 for path in files if path.stat().st_mode & 0o777 != 0o640} == {}


def test_every_flipped_bit_of_a_checkpoint_is_noticed(run: Path) -> None:
    draw = random.Random(0)
    for path in sorted(folder_of(run).iterdir()):
        content = path.read_bytes()
        for _ in range(10):
            flipped = bytearray(content)
            flipped[draw.randrange(len(content))] ^= 1 << draw.randrange(8)
            path.write_bytes(flipped)
            if path.suffix == ".json" and json.loads(content) == _json_or_none(flipped):
                continue  # in white space
            with pytest.raises(CheckpointError):
                Policy.load(run)
        path.write_bytes(content)
    Policy.load(run)


def _json_or_none(content: bytes) -> Any:
    try:
        return json.loads(content)
    except ValueError:
        return None


def test_a_flipped_bit_of_the_replay_is_noticed(run: Path) -> None:
    (segment,) = (run / "replay").iterdir()
    content = bytearray(segment.read_bytes())
    content[-5] ^= 1
    segment.write_bytes(content)
    with pytest.raises(CheckpointError, match=f"{segment.name}: damaged: its SHA-256"):
        resume(run, steps=40)


def sign(run: Path) -> None:
    path = folder_of(run) / "state.json"
    state = json.loads(path.read_text())
    state["files"] = {each.name: checkpoint.describe(each) for each in folder_of(run).glob("*.safetensors")}
    for segment in state["segments"]:
        segment.update(checkpoint.describe(run / "replay" / segment["file"]))
    state["sha256"] = schema.digest(state)
    path.write_text(json.dumps(state))


@pytest.mark.parametrize("file", ["policy", "learner", "optimizer", "environments"])
def test_numbers_that_are_none_are_refused_also_with_right_digests(file: str, run: Path) -> None:
    path = folder_of(run) / f"{file}.safetensors"
    arrays = load_file(path)
    name = next(name for name in sorted(arrays) if arrays[name].dtype.kind == "f")
    arrays[name] = np.full_like(arrays[name], np.nan)
    save_file(arrays, path)
    sign(run)
    with pytest.raises(CheckpointError, match="holds what is no finite number"):
        resume(run, steps=40)
    if file == "policy":
        with pytest.raises(CheckpointError, match="holds what is no finite number"):
            Policy.load(run)


STATES = {
    "rng": [], "rng.state.state": -1, "rng.state.inc": 2**128, "rng.uinteger": "a", "rng.bit_generator": "MT19937",
    "schedule": 5, "schedule.name": "rounds", "schedule.first": [[2]], "schedule.first ": [[True]], "steps": 1.5,
    "updates": -1, "recent": [["a"]], "recent ": [], "segments": [{}], "segments ": [], "sweeps": 10**15,
    "elapsed_s": float("nan"), "quantities": ["position/x"], "vocabulary.scalars": 10**15, "precision": "float64",
    "evaluation": None, "evaluation.random": [1.0] * 3, "ended": [1, 2], "ended ": -1,
    "method": ["limb-former"], "files": {}, "files ": {"../../a": 5}, "token_texts": "",
}  # fmt: skip


@pytest.mark.parametrize("place", STATES)
def test_state_that_makes_no_sense_is_refused(place: str, run: Path) -> None:
    path = folder_of(run) / "state.json"
    state = json.loads(path.read_text())
    *way, last = place.strip().split(".")
    part = state
    for key in way:
        part = part[key]
    part[last] = STATES[place]
    state["sha256"] = schema.digest(state)
    path.write_text(json.dumps(state))
    with pytest.raises(CheckpointError):
        resume(run, steps=40)


CONFIGS = {
    "task": ["locomotion"], "device": 5, "seed": -1, "threads": 10**6, "base": "flying", "minutes": "long",
    "robots": [],
    "robots.0.info.healthy_height": ["low", "high"], "robots.0.info.type_words": 5, "robots.0.source": "../../a.xml",
    "robots.0.packages": [], "config.model.d_model": 10**9, "config.model.layers": 10**7, "config.model.heads": "two",
    "config.learner.critic_width": 10**7, "config.trainer.num_envs": 10**8, "config.trainer.schedule": [], "config": [],
    "hold_out": None,
}  # fmt: skip


@pytest.mark.parametrize("place", CONFIGS)
def test_settings_that_make_no_sense_are_refused(place: str, run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = json.loads((run / "config.json").read_text())
    *way, last = place.split(".")
    part: Any = config
    for key in way:
        part = part[int(key) if key.isdecimal() else key]
    part[last] = CONFIGS[place]
    (run / "config.json").write_text(json.dumps(config))
    with pytest.raises(CheckpointError):
        resume(run, steps=40)
    assert command(["train", "--run", str(run), "--resume", "--steps", "40"]) == 2
    assert capsys.readouterr().err.startswith("error: ")


@pytest.mark.parametrize(
    "text", [b"", b"\xff", b"../../away/ck", b"step-1-1", b"step-000000000020-0000000006\n/a", b"."]
)
def test_a_name_of_the_latest_that_is_none_is_refused(text: bytes, run: Path) -> None:
    (run / "checkpoints" / "latest").write_bytes(text)
    with pytest.raises(CheckpointError, match=r"latest: damaged"):
        Policy.load(run)


@pytest.mark.parametrize(
    "text", [b"{}\n", b"\xff\n", b"[]\n", b"5\n", b"[" * 10**5 + b"\n", b'{"steps": 1}\n', b"\n\n"]
)
def test_metrics_that_make_no_sense_are_refused_with_their_line(text: bytes, run: Path) -> None:
    path = run / "metrics.jsonl"
    path.write_bytes(path.read_bytes() + text)
    with pytest.raises(CheckpointError, match=r"metrics\.jsonl:\d+: damaged"):
        read_metrics(run)
    with pytest.raises(CheckpointError, match=r"metrics\.jsonl:\d+: damaged"):
        resume(run, steps=40)


def test_a_last_row_of_metrics_that_was_cut_short_is_left_out(run: Path) -> None:
    rows = read_metrics(run)
    with (run / "metrics.jsonl").open("ab") as file:
        file.write(b'{"steps": 5, "upd')
    assert read_metrics(run) == rows
    resume(run, steps=40)


def test_checkpoints_without_digests_are_still_read_and_get_them(run: Path) -> None:
    path = folder_of(run) / "state.json"
    state = json.loads(path.read_text())
    state["format_version"] = 2
    del state["sha256"]
    state["files"] = {name: file["size"] for name, file in state["files"].items()}
    state["segments"] = [{key: each[key] for key in ("file", "first", "last")} for each in state["segments"]]
    path.write_text(json.dumps(state))
    Policy.load(run)
    resume(run, steps=40)
    _, state = checkpoint.load_state(run)
    assert state["format_version"] == 3
    assert all(len(part["sha256"]) == 64 for part in (*state["files"].values(), *state["segments"]))


def test_state_that_could_not_be_read_again_is_not_written(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    session = Session(run_settings.load(run))
    session.restore(run)
    session.schedule.advance()
    state, before = session.collector.state(), listing(run)
    for wrong in ({"recent": [[float("nan")]]}, {"unknown": 5}, {"steps": "many"}):
        monkeypatch.setattr(session.collector, "state", lambda wrong=wrong: {**state, **wrong})
        with pytest.raises(CheckpointError):
            session.save(run, 1.0)
        assert listing(run) == before
    session.close()


@pytest.mark.parametrize("name", ["save_file", "write_text", "describe"])
@pytest.mark.parametrize("kind", [OSError, KeyboardInterrupt])
@pytest.mark.parametrize("nth", [1, 3])
def test_a_save_that_fails_leaves_no_orphan(
    name: str, kind: type[BaseException], nth: int, run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = Session(run_settings.load(run))
    session.restore(run)
    session.schedule.advance()
    before, calls, whole = listing(run), [0], getattr(checkpoint, name)

    def fail(*arguments: Any, **options: Any) -> Any:
        calls[0] += 1
        if calls[0] == min(nth, 2 if name == "write_text" else nth):
            raise kind(28, "No space left on device")
        return whole(*arguments, **options)

    with monkeypatch.context() as patch:
        patch.setattr(checkpoint, name, fail)
        with pytest.raises(OutputError if kind is OSError else kind):
            session.save(run, 1.0)
    assert listing(run) == before
    checkpoint.load_state(run)
    session.save(run, 1.0)
    session.close()


@pytest.mark.parametrize(
    "case",
    [
        {"changes": [["flip", 3, 100, 1]], "signed": False},
        {"changes": [["json", 0, 40, 9, "set"]], "signed": True},
        {"changes": [["place", 1, "link"]], "signed": False},
        {"changes": [["array", 2, 5, "more"]], "signed": True},
    ],
)
def test_broken_runs_are_used_or_refused(case: dict[str, Any]) -> None:
    """`make fuzz` tries more."""
    attempt_run(json.dumps(case).encode())
