"""Compiling the kernels: once, in the background, and what happens without a compiler that works."""

from __future__ import annotations

import ctypes
import functools
import hashlib
import os
import select
import shutil
import subprocess
import time
from pathlib import Path

import pytest

from morphkit_rl.kernels import library
from tests.support.kernels import LOAD, compiled

CDLL = ctypes.CDLL
needs_compiler = pytest.mark.skipif(not (shutil.which("g++") or shutil.which("c++")), reason="no C++ compiler")


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
    left = [path.name for path in suited.rglob("cache/*/*")]
    assert not [name for name in left if name.startswith("making-")]


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
    small(suited, monkeypatch)
    monkeypatch.setenv("CXX", compiler(suited, f'echo >> {suited}/calls; exec {os.environ.get("CXX", "c++")} "$@"'))
    for _ in range(2):
        library_ = LOAD.__wrapped__()
        assert library_ is not None
        assert library_.answer() == 42
    assert len((suited / "calls").read_text().splitlines()) == 2  # compiled and linked
    (made,) = (suited / "cache").glob("*/*")
    made.unlink()
    made.write_text("damaged")
    again = LOAD.__wrapped__()
    assert again is not None
    assert again.answer() == 42
    monkeypatch.setenv("MORPHKIT_CACHE", str(suited / "calls" / "under-a-file"))
    again = LOAD.__wrapped__()
    assert again is not None
    assert again.answer() == 42


def small(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Kernels that are made in no time and answer 42."""
    monkeypatch.setattr(library, "_SOURCES", ("small.cpp",))
    monkeypatch.setattr(library, "_HEADERS", ())
    monkeypatch.setattr(library.resources, "files", lambda package: folder)
    (folder / "small.cpp").write_text('extern "C" { int answer() { return 42; } }')


def plant(folder: Path, code: str) -> Path:
    """A library that another user made."""
    (folder / "planted.cpp").write_text(code)
    command = [*os.environ.get("CXX", "c++").split(), "-shared", "-fPIC", "-o", "planted.so", "planted.cpp"]
    subprocess.run(command, cwd=folder, check=True)
    return folder / "planted.so"


@needs_compiler
@pytest.mark.parametrize("how", ["folder", "link", "file", "contents", "old name"])
def test_planted_kernels_are_not_loaded(how: str, suited: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    small(suited, monkeypatch)

    def load_copy(path: str) -> ctypes.CDLL:
        copies = len(list(suited.glob("copy*")))  # of one name the system loads only one
        return CDLL(shutil.copy(path, suited / f"copy{copies}"))

    monkeypatch.setattr(library.ctypes, "CDLL", load_copy)
    cache = suited / "cache"
    cache.mkdir()
    cache.chmod(0o777)
    assert LOAD.__wrapped__() is not None
    (folder,) = cache.iterdir()
    (made,) = folder.iterdir()
    assert (folder.stat().st_mode & 0o777, made.stat().st_mode & 0o022) == (0o700, 0)
    code = f'static FILE* f = fopen("{suited}/owned", "w"); extern "C" {{ int answer() {{ return 666; }} }}'
    planted = plant(suited, f"#include <cstdio>\n{code}").read_bytes()
    if how == "old name":
        (cache / f"{made.name[:24]}.so").write_bytes(planted)
    else:
        made.unlink()
        made.write_bytes(planted)
    if how == "link":
        folder.rename(suited / "elsewhere")
        folder.symlink_to(suited / "elsewhere")
    elif how != "contents":
        digest = hashlib.sha256(planted).hexdigest()
        if made.exists():
            made = made.rename(made.with_name(f"{made.stem.rpartition('-')[0]}-{digest}.so"))
        (folder if how == "folder" else made).chmod(0o777)
    again = LOAD.__wrapped__()
    assert again is not None
    assert again.answer() == 42
    assert not (suited / "owned").exists()
