"""Files that are whole or not there at all: written under a temporary name, then renamed.

The writing process keeps the temporary file locked. A killed one leaves its file, but not the lock.
"""

from __future__ import annotations

import contextlib
import os
import re
import secrets
import stat
from collections.abc import Callable
from pathlib import Path

from morphkit.errors import MorphkitError, OutputError

_STEM, _TOKEN_BYTES = 40, 4  # in bytes, names are bounded
_EXCLUSIVE = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC | getattr(os, "O_NOFOLLOW", 0)


def write_atomically(path: Path, write: Callable[[Path], object], *, durable: bool = False) -> Path:
    """Let `write` fill a temporary file in the folder of `path`, then rename it; a failure leaves nothing behind.

    The file gets the mode that the user's umask gives, whatever `write` does. A link at `path` is replaced.

    Args:
        path: The file, which is replaced where it exists.
        write: Fills the file that it is given, which is empty, and whose name has the suffix of `path`.
        durable: Whether the content is flushed to disk before the renaming, so that a power cut leaves the old file or
            the new one.

    Returns:
        `path`.

    Raises:
        OSError: The disk is full or the folder cannot be written.
    """
    temporary, mode, lock = _make_temporary(path)
    try:
        write(temporary)
        if stat.S_IMODE(temporary.stat().st_mode) != mode:
            temporary.chmod(mode)
        if durable:
            flush(temporary)
        temporary.replace(path)
    finally:
        if temporary.parent.is_dir():
            temporary.unlink(missing_ok=True)
        if lock is not None:
            os.close(lock)
    return path


def temporary_names(path: Path) -> re.Pattern[str]:
    """What the names of temporary files for `path` look like, which a killed process may leave."""
    return re.compile(rf"\.{re.escape(path.stem[:_STEM])}\.[0-9a-f]{{{2 * _TOKEN_BYTES}}}{re.escape(path.suffix)}")


def write_text(path: Path, text: str, *, durable: bool = False) -> Path:
    """`write_atomically` with UTF-8 text, line ends as they are."""
    return write_atomically(path, lambda file: file.write_text(text, encoding="utf-8", newline=""), durable=durable)


def write_output(path: Path, write: Callable[[Path], object]) -> Path:
    """`write_atomically` for what a user asked for: the folder of `path` is made where it is missing.

    What killed processes left of the same file goes.

    Raises:
        OutputError: The file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _sweep(path)
        return write_atomically(path, write)
    except MorphkitError:
        raise
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror or error}") from error


def flush(path: Path) -> None:
    """Wait until what was written to a file is on disk, so that a power cut leaves it whole."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _make_temporary(path: Path) -> tuple[Path, int, int | None]:
    """A new empty file next to `path`, never one that somebody put there, its mode, and a descriptor that locks it."""
    while True:
        temporary = path.with_name(f".{path.stem[:_STEM]}.{secrets.token_hex(_TOKEN_BYTES)}{path.suffix}")
        try:
            descriptor = os.open(temporary, _EXCLUSIVE, 0o666)
        except FileExistsError:
            continue
        mode = stat.S_IMODE(os.fstat(descriptor).st_mode)
        locked = _lock(descriptor)
        if locked and temporary.exists():
            return temporary, mode, descriptor
        os.close(descriptor)
        if locked is None:
            return temporary, mode, None
        temporary.unlink(missing_ok=True)  # another process took it for a dead one's, before it was locked


def _lock(descriptor: int) -> bool | None:
    """Lock an open file until it is closed; False where another process has it locked, None where nothing can be."""
    if os.name != "posix":
        return None
    import fcntl

    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return None
    return True


def _sweep(path: Path) -> None:
    """Remove the temporary files of `path` that nobody writes any more."""
    if os.name != "posix":  # where no lock says so
        return
    names = temporary_names(path)
    for left in path.parent.iterdir():
        if not names.fullmatch(left.name):
            continue
        with contextlib.suppress(OSError):
            descriptor = os.open(left, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOFOLLOW)
            try:
                found = os.fstat(descriptor)
                ours = stat.S_ISREG(found.st_mode) and found.st_uid == os.getuid()
                if ours and _lock(descriptor):
                    left.unlink()
            finally:
                os.close(descriptor)
