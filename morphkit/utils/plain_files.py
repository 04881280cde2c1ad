"""Folders that may come from strangers: archives and version control keep links, and a link leads out of its folder."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from morphkit.errors import MorphkitError

_NO_FOLLOW = getattr(os, "O_NOFOLLOW", 0)
_NO_WAIT = getattr(os, "O_NONBLOCK", 0)  # a pipe that nobody writes to would keep the reader waiting


def require_plain(folder: Path, kind: type[MorphkitError], *, top: Path | None = None) -> None:
    """Refuse a folder that is a link, or that holds anything but folders and regular files, at any depth.

    A folder that does not exist holds nothing.

    Args:
        folder: The folder.
        kind: The error to raise.
        top: A folder above; those on the way from there are looked at as well.

    Raises:
        MorphkitError: Of the given kind, with the place of what is not plain.
    """
    require_plain_way(folder, kind, top=top)
    waiting = [folder]
    while waiting:
        try:
            with os.scandir(waiting.pop()) as entries:
                for entry in entries:
                    if entry.is_dir(follow_symlinks=False):
                        waiting.append(Path(entry.path))
                    elif not entry.is_file(follow_symlinks=False):
                        raise _refusal(Path(entry.path), kind)
        except (FileNotFoundError, NotADirectoryError):  # Others may be at work there.
            continue
        except OSError as error:
            if isinstance(error, MorphkitError):
                raise
            raise kind(f"{error.filename or folder}: cannot be read: {error.strerror}") from None


def require_plain_way(path: Path, kind: type[MorphkitError], *, top: Path | None = None) -> None:
    """Refuse a path that is a link, or that has links on the way from `top`.

    Raises:
        MorphkitError: Of the given kind, with the place of the link.
    """
    way = [path, *path.parents]
    for part in way[: way.index(top) + 1] if top is not None else [path]:
        if part.is_symlink():
            raise _refusal(part, kind)


def read_plain(path: Path) -> bytes:
    """The bytes of a regular file that is no link.

    Raises:
        OSError: It cannot be read, is a link, or is no regular file.
    """
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | _NO_FOLLOW | _NO_WAIT)
    with open(descriptor, "rb") as file:  # noqa: PTH123 - of a descriptor
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise OSError(0, "is no regular file", str(path))
        return file.read()


def append_plain(path: Path, text: str) -> None:
    """Append UTF-8 text to a file that is no link, in one write; it is made where it is missing.

    Raises:
        OSError: It cannot be written, or is a link.
    """
    flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC | _NO_FOLLOW | _NO_WAIT
    with open(os.open(path, flags, 0o666), "ab", buffering=0) as file:  # noqa: PTH123 - of a descriptor
        file.write(text.encode())


def _refusal(path: Path, kind: type[MorphkitError]) -> MorphkitError:
    if path.is_symlink():
        return kind(f"{path}: is a link to {str(path.readlink())!r}; expected a file or folder that lies there itself")
    return kind(f"{path}: is neither a file nor a folder; remove it")
