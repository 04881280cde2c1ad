"""Folders at an fsspec address: equal copies, in an order that a cut-short copy survives."""

from __future__ import annotations

import sys
from pathlib import Path

import fsspec
import pytest

from morphkit.errors import ConfigError, OutputError
from morphkit_rl.training.cluster.storage import Storage


@pytest.fixture(params=["file", "memory"])
def address(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    return f"file://{tmp_path}/store" if request.param == "file" else f"memory://{tmp_path.name}"


def content(folder: Path) -> dict[str, str]:
    return {path.relative_to(folder).as_posix(): path.read_text() for path in folder.rglob("*") if path.is_file()}


def write(folder: Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)


def test_what_is_pushed_is_pulled_and_follows_changes_and_removals(address: str, tmp_path: Path) -> None:
    here, there, files = tmp_path / "here", tmp_path / "there", {"a": "1", "run/b": "2", "run/c/d": "3"}
    write(here, {**files, ".lock": "", "run/owner.json": "{}"})
    storage = Storage(address)
    assert not storage.holds("1/x")
    storage.push(here, "1/x")
    assert storage.holds("1/x")
    assert not storage.holds("1/y")
    Storage(address).pull("1/x", there)
    assert content(there) == files, "without what says which process is at work"
    write(here, {"a": "longer than before"})
    (here / "run/b").unlink()
    storage.push(here, "1/x")
    Storage(address).pull("1/x", tmp_path / "again")
    assert content(tmp_path / "again") == {"a": "longer than before", "run/c/d": "3"}
    Storage(address).pull("1/x", tmp_path / "some", {"a"}.__contains__)
    assert content(tmp_path / "some") == {"a": "longer than before"}


def test_what_points_at_others_is_written_last_and_nothing_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path / "here", {"a": "", "latest": "", "z": ""})
    storage, sent = Storage(f"file://{tmp_path}/store"), []
    put = type(storage._files).put_file
    monkeypatch.setattr(
        type(storage._files), "put_file", lambda own, path, to: sent.append(Path(to).name) or put(own, path, to)
    )
    storage.push(tmp_path / "here", "k", last=["latest", "absent"])
    assert sent == ["a", "z", "latest"]
    storage.push(tmp_path / "here", "k", last=["latest"])
    assert sent == ["a", "z", "latest"], "what did not change is not sent again"


def test_files_outside_of_the_folder_are_never_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    storage = Storage(f"memory://{tmp_path.name}")
    monkeypatch.setattr(storage, "_names", lambda key: ["../away", "/away", "run/../../away"])
    storage.pull("k", tmp_path / "there" / "k")
    assert content(tmp_path) == {}


def test_a_protocol_that_nobody_knows_is_refused() -> None:
    with pytest.raises(ConfigError, match="nosuch"):
        Storage("nosuch://x")


def test_a_place_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    write(tmp_path, {"store": "a file, where a folder belongs", "here/a": "1"})
    with pytest.raises(OutputError, match="cannot be written"):
        Storage(f"file://{tmp_path}/store").push(tmp_path / "here", "k")


def test_fsspec_is_asked_for_where_it_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    assert fsspec.available_protocols()
    monkeypatch.setitem(sys.modules, "fsspec", None)
    with pytest.raises(ConfigError, match=r"morphkit\[cluster\]"):
        Storage("memory://x")
