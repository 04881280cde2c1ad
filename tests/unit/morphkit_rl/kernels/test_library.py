"""Compiling the kernels: once, in the background, and what happens without a compiler that works."""

from __future__ import annotations

import functools
import os
import select
import subprocess
import time
from pathlib import Path

import pytest

from morphkit_rl.kernels import library
from tests.support.kernels import LOAD, compiled


def test_kernels_that_are_being_made_are_made_once(monkeypatch: pytest.MonkeyPatch) -> None:
    made = []

    def make() -> object:
        made.append(object())
        time.sleep(0.2)
        return made[0]

    monkeypatch.setattr(library, "load", functools.cache(library.load.__wrapped__))
    monkeypatch.setattr(library, "_suits_processor", lambda: True)
    monkeypatch.setattr(library, "_open", lambda: made[0] if made else make())
    monkeypatch.delenv(library.SWITCH, raising=False)
    thread = library.prepare()
    assert library.load() is made[0]
    thread.join()
    assert len(made) == 1


@pytest.fixture
def suited(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A processor that kernels could be made for, and a cache without them."""
    monkeypatch.setattr(library, "_suits_processor", lambda: True)
    monkeypatch.setenv("MORPHKIT_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv(library.SWITCH, raising=False)
    return tmp_path


def compiler(folder: Path, script: str) -> str:
    file = folder / "compiler"
    file.write_text(f"#!/bin/sh\n{script}\n")
    file.chmod(0o755)
    return str(file)


@pytest.mark.parametrize(
    "script", ["exit 1", "sleep 60", "exit 0", 'for a; do last=$a; done; echo no library > "$last"']
)
def test_a_compiler_that_does_not_work_costs_the_speed_only(
    script: str, suited: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(library, "_TIMEOUT_S", 0.5)
    monkeypatch.setenv("CXX", compiler(suited, script))
    assert LOAD.__wrapped__() is None
    assert not list(suited.glob("cache/kernels-*/*"))


def test_a_compiler_that_hangs_is_ended_with_what_it_started(suited: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    alive, held = os.pipe()
    monkeypatch.setattr(library, "_TIMEOUT_S", 0.5)
    monkeypatch.setattr(library.subprocess, "Popen", functools.partial(subprocess.Popen, pass_fds=[held]))
    monkeypatch.setenv("CXX", compiler(suited, "sleep 600 & wait"))
    assert library.load.__wrapped__() is None
    os.close(held)
    assert select.select([alive], [], [], 100)[0]  # All that held the pipe have gone.
    os.close(alive)


def test_without_a_compiler_or_where_switched_off_there_are_no_kernels(
    suited: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CXX", str(suited / "missing"))
    assert LOAD.__wrapped__() is None
    monkeypatch.setenv("CXX", compiler(suited, f"touch {suited}/called"))
    monkeypatch.setenv(library.SWITCH, "0")
    assert LOAD.__wrapped__() is None
    assert not (suited / "called").exists()
    assert not (suited / "cache").exists()


@compiled
def test_kernels_are_made_once_and_anew_where_the_cache_cannot_be_used(
    suited: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(library, "_SOURCES", ("small.cpp",))
    monkeypatch.setattr(library, "_HEADERS", ())
    monkeypatch.setattr(library.resources, "files", lambda package: suited)
    (suited / "small.cpp").write_text('extern "C" { int answer() { return 42; } }')
    monkeypatch.setenv("CXX", compiler(suited, f'echo >> {suited}/calls; exec {os.environ.get("CXX", "c++")} "$@"'))
    for _ in range(2):
        library_ = LOAD.__wrapped__()
        assert library_ is not None
        assert library_.answer() == 42
    assert len((suited / "calls").read_text().splitlines()) == 2  # compiled and linked
    (made,) = (suited / "cache").iterdir()
    made.unlink()
    made.write_text("damaged")
    again = LOAD.__wrapped__()
    assert again is not None
    assert again.answer() == 42
    monkeypatch.setenv("MORPHKIT_CACHE", str(suited / "calls" / "under-a-file"))
    again = LOAD.__wrapped__()
    assert again is not None
    assert again.answer() == 42
