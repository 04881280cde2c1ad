"""Files that are whole or not there at all."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from morphkit.errors import OutputError
from morphkit.utils import atomic_write
from morphkit.utils.atomic_write import temporary_names, write_atomically, write_output, write_text


def test_a_file_that_cannot_be_written_whole_leaves_the_old_one_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    write_text(tmp_path / "file", "old")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        write_text(tmp_path / "file", "new", durable=True)
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("file", "old")]


def test_the_temporary_file_keeps_the_ending(tmp_path: Path) -> None:
    seen: list[Path] = []

    def write(target: Path) -> None:
        seen.append(target)
        target.write_bytes(b"x")

    write_output(tmp_path / "a.mp4", write)
    assert seen[0].suffix == ".mp4"
    assert (tmp_path / "a.mp4").read_bytes() == b"x"


def test_a_file_where_a_folder_should_be_is_explained(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    with pytest.raises(OutputError, match="cannot write"):
        write_output(tmp_path / "file" / "a.txt", lambda path: path.write_text("y"))


@pytest.mark.parametrize("umask", [0o022, 0o027, 0o077, 0o002])
def test_a_file_has_the_mode_that_the_umask_gives(tmp_path: Path, umask: int) -> None:
    def private(target: Path) -> None:
        other = target.with_name("other")
        other.write_bytes(b"x")
        other.chmod(0o600)
        other.replace(target)

    before = os.umask(umask)
    try:
        write_atomically(tmp_path / "a", private)
        write_text(tmp_path / "b", "x")
    finally:
        os.umask(before)
    for name in ("a", "b"):
        assert (tmp_path / name).stat().st_mode & 0o777 == 0o666 & ~umask


def test_a_temporary_name_that_is_taken_is_left_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mine").write_text("mine")
    (tmp_path / ".file.00000000.txt").symlink_to(tmp_path / "mine")
    (tmp_path / ".file.11111111.txt").write_text("mine too")
    tokens = iter(("00000000", "11111111", "22222222"))
    monkeypatch.setattr("secrets.token_hex", lambda _: next(tokens))
    write_text(tmp_path / "file.txt", "new")
    assert (tmp_path / "file.txt").read_text() == "new"
    assert (tmp_path / "mine").read_text() == "mine"
    assert (tmp_path / ".file.11111111.txt").read_text() == "mine too"


def test_names_of_temporary_files_are_known(tmp_path: Path) -> None:
    for name in ("metrics.jsonl", "latest", "long" * 40 + ".txt"):
        seen: list[str] = []
        write_atomically(tmp_path / name, lambda file, seen=seen: (seen.append(file.name), file.write_text("x")))
        assert re.fullmatch(temporary_names(tmp_path / name), seen[0])
        assert not re.fullmatch(temporary_names(tmp_path / name), name)


@pytest.mark.skipif(os.name != "posix", reason="needs file locks")
def test_what_a_killed_process_left_is_swept_and_what_is_being_written_stays(tmp_path: Path) -> None:
    program = (
        "import pathlib, sys, time; from morphkit.utils.atomic_write import write_output\n"
        "write = lambda file: (file.write_text('half'), print(flush=True), time.sleep(99))\n"
        "write_output(pathlib.Path(sys.argv[1]), write)"
    )
    mine = tmp_path / ".film.0123.mp4"
    mine.write_text("mine")

    def begin() -> tuple[subprocess.Popen[bytes], Path]:
        before = {*tmp_path.iterdir()}
        process = subprocess.Popen([sys.executable, "-c", program, tmp_path / "film.mp4"], stdout=subprocess.PIPE)
        assert process.stdout
        process.stdout.readline()
        (temporary,) = {*tmp_path.iterdir()} - before
        return process, temporary

    killed, left = begin()
    killed.kill()
    killed.wait()
    assert left.read_text() == "half"
    other, being_written = begin()
    try:
        assert not left.exists()
        write_output(tmp_path / "film.mp4", lambda file: file.write_text("whole"))
        assert {*tmp_path.iterdir()} == {mine, being_written, tmp_path / "film.mp4"}
    finally:
        other.kill()
        other.wait()


@pytest.mark.skipif(os.name != "posix", reason="needs file locks")
@pytest.mark.parametrize("swept", ["before it was locked", "while another held it"])
def test_a_temporary_file_that_another_process_swept_is_made_again(
    swept: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lock, made = atomic_write._lock, list[Path]()

    def late(descriptor: int) -> bool | None:
        made.extend(tmp_path.glob(".file.*"))
        if len(made) > 1:
            return lock(descriptor)
        if swept == "before it was locked":
            made[0].unlink()
            return lock(descriptor)
        return False

    monkeypatch.setattr(atomic_write, "_lock", late)
    write_text(tmp_path / "file.txt", "whole")
    assert len(set(made)) == 2
    assert {*tmp_path.iterdir()} == {tmp_path / "file.txt"}
    assert (tmp_path / "file.txt").read_text() == "whole"
