"""Folders that appear whole or not at all: written beside their place, then moved there in one step."""

from __future__ import annotations

import ctypes
import errno
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from morphkit.errors import OutputError

_AT_FDCWD = -100
_RENAME_EXCHANGE = 2


@contextmanager
def staged_folder(folder: Path) -> Iterator[Path]:
    """Give an empty folder to write into; at the end of the block it takes the place of `folder`.

    It lies beside `folder`, on the same file system. An existing `folder` is replaced with all it holds; the caller has
    to make sure that it may be. A killed run leaves the old folder or the new one; when the block raises, nothing
    is left.

    Raises:
        OutputError: The folder cannot be written.
    """
    folder = folder.absolute()
    made: list[Path] = []
    stage: Path | None = None
    try:
        made = _make_parents(folder.parent)
        stage = Path(tempfile.mkdtemp(prefix=f".{folder.name[:80]}-", dir=folder.parent))
        stage.chmod(0o777 & ~_umask())
        yield stage
        _put(stage, folder)
        made = []
    except OSError as error:
        if isinstance(error, OutputError) or error.errno is None:
            raise
        raise OutputError(f"{folder}: cannot be written: {error.strerror}") from error
    finally:
        if stage is not None:
            shutil.rmtree(stage, ignore_errors=True)
        for parent in reversed(made):
            if not any(parent.iterdir()):
                parent.rmdir()


def _make_parents(folder: Path) -> list[Path]:
    """Make `folder` and what is missing above it; return what was made, topmost first."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()][::-1]
    folder.mkdir(parents=True, exist_ok=True)
    return missing


def _put(stage: Path, folder: Path) -> None:
    """Move `stage` to `folder`; what was there is then at `stage`, or gone where it was an empty folder."""
    try:
        os.rename(stage, folder)  # noqa: PTH104 - replaces an empty folder, which Path.rename does not promise
    except OSError as error:
        if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
            raise
        if not _exchange(stage, folder):
            # Where the system cannot swap two names, the old folder stays beside the place until the new one is there.
            old = Path(tempfile.mkdtemp(prefix=f".{folder.name[:80]}-old-", dir=folder.parent))
            folder.rename(old / folder.name)
            stage.rename(folder)
            shutil.rmtree(old, ignore_errors=True)


def _exchange(first: Path, second: Path) -> bool:
    """Swap two names in one step; False where the system cannot."""
    try:
        renameat2 = ctypes.CDLL(None, use_errno=True).renameat2
    except (OSError, AttributeError):
        return False
    code = renameat2(_AT_FDCWD, os.fsencode(first), _AT_FDCWD, os.fsencode(second), ctypes.c_uint(_RENAME_EXCHANGE))
    return bool(code == 0)


def _umask() -> int:
    mask = os.umask(0o022)
    os.umask(mask)
    return mask
