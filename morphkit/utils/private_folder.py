"""A folder whose files nobody but this user (and root) can have made: what is run is kept there."""

from __future__ import annotations

import contextlib
import os
import stat
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def private_folder(path: Path) -> Iterator[int]:
    """Open a folder, made where there is none; POSIX only.

    Args:
        path: The folder. It is no link, belongs to this user and is open to nobody else (0700), whoever can write to
            the folders above it.

    Yields:
        A descriptor of the folder: what `path` leads to later may be another.

    Raises:
        OSError: It cannot be made, or is not private.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with contextlib.suppress(FileExistsError):
        path.mkdir(mode=0o700)
    folder = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        state = os.fstat(folder)
        if state.st_uid != os.geteuid() or stat.S_IMODE(state.st_mode) & 0o077:
            raise PermissionError(f"{path} belongs to another user, or others may enter it")
        yield folder
    finally:
        os.close(folder)


@contextlib.contextmanager
def private_file(folder: int, name: str) -> Iterator[int]:
    """Open a file of a private folder for reading.

    Raises:
        OSError: There is none, or it is no regular file of this user that only this user can write to.
    """
    file = os.open(name, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, dir_fd=folder)
    try:
        state = os.fstat(file)
        if not stat.S_ISREG(state.st_mode) or state.st_uid != os.geteuid() or stat.S_IMODE(state.st_mode) & 0o022:
            raise PermissionError(f"{name} is no file of this user, or others may write to it")
        yield file
    finally:
        os.close(file)
