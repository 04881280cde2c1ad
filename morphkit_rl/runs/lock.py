"""One process a folder: a lock that the system takes back when its owner dies, and a note of who that is."""

from __future__ import annotations

import json
import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

from filelock import BaseFileLock, FileLock, Timeout

from morphkit.errors import CheckpointError, OutputError
from morphkit.utils.atomic_write import write_text
from morphkit.utils.plain_files import read_plain, require_plain

_LOCK, OWNER = ".lock", "owner.json"
_WAIT_S = 30.0
_PATIENCE_S = 1.0  # another process may hold the lock for a moment, just to see whether it is free


@dataclass(frozen=True, slots=True)
class Owner:
    """Who works, or worked, in a folder: process, host and since when (seconds since 1970)."""

    pid: int
    host: str
    since: float

    def __post_init__(self) -> None:
        kinds = (int, str, int | float)
        if not all(map(isinstance, (self.pid, self.host, self.since), kinds)) or not self.host.isprintable():
            raise TypeError("no owner")

    def __str__(self) -> str:
        return f"process {self.pid} on {self.host}"


@contextmanager
def hold(folder: Path) -> Iterator[bool]:
    """Hold a folder for this process while the block runs.

    Yields:
        False where another process holds it; the block must then leave the folder alone. A process that was killed
        holds nothing.

    Raises:
        CheckpointError: The folder holds links.
        OutputError: The file system knows no locks.
    """
    lock = _acquire(folder, _PATIENCE_S)
    if lock is None:
        yield False
        return
    try:
        note = asdict(Owner(os.getpid(), socket.gethostname(), time.time()))
        write_text(folder / OWNER, json.dumps(note) + "\n")
        yield True
    finally:
        (folder / OWNER).unlink(missing_ok=True)
        lock.release()


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Work in a folder alone while the block runs.

    Raises:
        OutputError: Another process works there, or the file system knows no locks.
    """
    with hold(folder) as ours:
        if not ours:
            who, _ = owner(folder)
            raise OutputError(f"{folder}: {who or 'another process'} is at work there; wait for it, or stop it first")
        yield


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Write to a folder alone while the block runs, which takes a moment only; waits for others.

    Raises:
        OutputError: Another process holds the folder for long, or the file system knows no locks.
    """
    lock = _acquire(folder, _WAIT_S)
    if lock is None:
        raise OutputError(f"{folder}: another process has it locked")
    try:
        yield
    finally:
        lock.release()


def _acquire(folder: Path, timeout_s: float) -> BaseFileLock | None:
    lock = _lock_of(folder)
    try:
        lock.acquire(timeout=timeout_s)
    except Timeout:
        return None
    except NotImplementedError:
        raise OutputError(f"{folder}: lies on a file system without locks; choose a folder on another one") from None
    return lock


def _lock_of(folder: Path) -> BaseFileLock:
    """The lock of a folder that holds no links; some versions of filelock empty the file that they lock."""
    require_plain(folder, CheckpointError)
    path = folder / _LOCK
    for own in (path, folder / OWNER):
        if own.exists() and not own.is_file():
            raise CheckpointError(f"{own}: is no file, and so no lock of morphkit; remove it")
    if path.is_file() and path.stat().st_size and path.stat().st_nlink > 1:
        raise CheckpointError(f"{path}: is another name of a file with content, not a lock of morphkit; remove it")
    return FileLock(path)


def owner(folder: Path) -> tuple[Owner | None, bool]:
    """Who left a note in a folder, and whether that process still works there.

    Returns:
        The owner, or None; and False where it died without a word.
    """
    try:
        found = Owner(**json.loads(read_plain(folder / OWNER)))
    except (OSError, ValueError, TypeError, RecursionError):
        return None, False
    lock = _lock_of(folder)
    try:
        lock.acquire(timeout=0)
    except (Timeout, OSError):  # held, or in another user's folder, where the note is all there is to go by
        return found, True
    lock.release()
    return found, False
