"""Folders that appear whole or not at all: written next to their place, then moved there in one step.

Until then they lie in a hidden stage next to the place, with a file that the writing process keeps locked. A killed
process leaves its stage, but not the lock: the next one that writes to the same place removes what is unlocked.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from morphkit.errors import OutputError

_AT_FDCWD = -100
_RENAME_EXCHANGE = 2
_SUFFIX = ".morphkit"
_LOCK, _UNLOCKED, _CONTENT, _OLD = "lock", "unlocked", "content", "old"
_SIGNING_S = 60.0  # Longer than any process needs from making a stage to locking it.
_held: set[int] = set()  # descriptors of the locks of this process


def _leave_locks_to_the_parent() -> None:
    """Close inherited locks: a worker that outlives its killed parent must not keep the parent's stage."""
    while _held:
        os.close(_held.pop())


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_leave_locks_to_the_parent)


def require_text(path: Path) -> None:
    """Refuse a path that MuJoCo and other libraries cannot take.

    Raises:
        OutputError: Its bytes are no UTF-8.
    """
    try:
        str(path).encode()
    except UnicodeEncodeError as error:
        raise OutputError(f"{ascii(str(path))[1:-1]}: is no UTF-8 text; choose another name") from error


@contextmanager
def staged_folder(folder: Path) -> Iterator[Path]:
    """Give an empty folder to write into; at the end of the block it takes the place of `folder`.

    It is next to `folder`, on the same file system. An existing `folder` is replaced with all it holds; the caller has
    to make sure that it may be. A killed run leaves the old folder or the new one; when the block raises, nothing
    is left.

    Raises:
        OutputError: The folder cannot be written.
    """
    folder = folder.absolute()
    try:
        with stage(folder) as own:
            content = own / _CONTENT
            content.mkdir()
            yield content
            put(content, folder)
    except OSError as error:
        if isinstance(error, OutputError) or error.errno is None:
            raise
        raise OutputError(f"{folder}: cannot be written: {error.strerror}") from error


@contextmanager
def stage(place: Path) -> Iterator[Path]:
    """Give a hidden folder next to `place`, for what is to be moved there; it goes at the end of the block.

    Missing folders above `place` are made; they go too where they stay empty.

    Raises:
        OSError: It cannot be made.
    """
    made = _make_parents(place.parent)
    own: Path | None = None
    lock: int | None = None
    try:
        clear_leftovers(place)
        own = Path(tempfile.mkdtemp(prefix=_prefix(place), suffix=_SUFFIX, dir=place.parent))
        lock = _lock(own, place)
        yield own
    finally:
        if own is not None:
            _remove(own)
        if lock in _held:
            _held.remove(lock)
            os.close(lock)
        for parent in reversed(made):
            if not any(parent.iterdir()):
                parent.rmdir()


def clear_leftovers(place: Path, undo: Callable[[Path], None] | None = None) -> None:
    """Remove the stages of killed processes that wrote to `place`; what one of them had moved away comes back.

    A stage counts as left where it says that it belongs to `place`, has the same owner as this process, and is locked
    by no process. One that was not signed yet has to be empty and a minute old.

    Args:
        place: The file or folder.
        undo: Called with each such stage before it is removed.
    """
    try:
        beside = sorted(place.parent.iterdir())
    except OSError:
        return
    for own in beside:
        if not (own.name.startswith(_prefix(place)) and own.name.endswith(_SUFFIX)):
            continue
        lock = _take_over(own, place)
        if lock is None:
            _clear_unlocked(own, place)
            continue
        try:
            with contextlib.suppress(OSError):
                if undo is not None:
                    undo(own)
                if (own / _OLD).is_dir() and not os.path.lexists(place):
                    os.rename(own / _OLD, place)  # noqa: PTH104 - as in `put`
                _remove(own)
        finally:
            os.close(lock)


def put(content: Path, folder: Path) -> None:
    """Move `content`, which lies in a stage, to `folder`; what was there is then in the stage.

    Raises:
        OSError: It cannot be moved; `folder` is as it was.
    """
    try:
        os.rename(content, folder)  # noqa: PTH104 - replaces an empty folder, which Path.rename does not promise
    except OSError as error:
        if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
            raise
        if not _exchange(content, folder):
            # Where the system cannot swap two names, the old folder waits in the stage, from where it can come back.
            old = content.parent / _OLD
            folder.rename(old)
            try:
                content.rename(folder)
            except OSError:
                old.rename(folder)
                raise


@contextmanager
def in_turn(folder: Path) -> Iterator[None]:
    """Wait until no other process is in such a block for `folder`; no wait where the system cannot lock folders."""
    if os.name != "posix":
        yield
        return
    import fcntl

    descriptor = os.open(folder, os.O_RDONLY)
    try:
        with contextlib.suppress(OSError):
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def _prefix(place: Path) -> str:
    return f".{place.name[:40]}-"  # in bytes, names are bounded


def _sign(place: Path) -> bytes:
    return b"morphkit writes " + os.fsencode(place.name)


def _lock(own: Path, place: Path) -> int:
    """Sign a stage and lock it as long as this process lives; return what holds the lock."""
    unlocked = own / _UNLOCKED
    descriptor = os.open(unlocked, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o600)
    _held.add(descriptor)
    try:
        os.write(descriptor, _sign(place))
        if os.name == "posix":
            import fcntl

            with contextlib.suppress(OSError):  # Where nobody can lock, nobody can take over either.
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        unlocked.rename(own / _LOCK)  # Under this name it is never seen unlocked while this process lives.
    except BaseException:
        _held.discard(descriptor)
        os.close(descriptor)
        raise
    return descriptor


def _take_over(own: Path, place: Path) -> int | None:
    """Lock the stage of a process that is gone; None where it is not surely one."""
    if os.name != "posix":
        return None
    import fcntl

    try:
        if own.is_symlink():
            return None
        descriptor = os.open(own / _LOCK, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError:
        return None
    try:
        mine = os.fstat(descriptor).st_uid == os.getuid()
        if mine and os.read(descriptor, 4096) == _sign(place):
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return descriptor
    except OSError:
        pass  # locked: it is being written
    os.close(descriptor)
    return None


def _clear_unlocked(own: Path, place: Path) -> None:
    """Remove a stage whose process was killed between making and locking it, or between unlocking and removing it."""
    with contextlib.suppress(OSError):
        found = own.lstat()
        if own.is_symlink() or found.st_uid != os.getuid() or time.time() - found.st_mtime < _SIGNING_S:
            return
        unlocked = own / _UNLOCKED
        if [*own.iterdir()] == [unlocked] and _sign(place).startswith(unlocked.read_bytes()):
            unlocked.unlink()
        own.rmdir()  # fails where it holds anything


def _remove(own: Path) -> None:
    """Remove a stage, its lock last, so that one that a kill interrupts stays recognizable."""
    for path in own.iterdir():
        if path.name == _LOCK:
            continue
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)
    shutil.rmtree(own, ignore_errors=True)


def _make_parents(folder: Path) -> list[Path]:
    """Make `folder` and what is missing above it; return what was made, topmost first."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()][::-1]
    folder.mkdir(parents=True, exist_ok=True)
    return missing


def _exchange(first: Path, second: Path) -> bool:
    """Swap two names in one step; False where the system cannot."""
    try:
        renameat2 = ctypes.CDLL(None, use_errno=True).renameat2
    except (OSError, AttributeError):
        return False
    code = renameat2(_AT_FDCWD, os.fsencode(first), _AT_FDCWD, os.fsencode(second), ctypes.c_uint(_RENAME_EXCHANGE))
    return bool(code == 0)
