"""Folders at an fsspec address, for nodes that share no disk."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path, PurePosixPath

from morphkit.errors import ConfigError, OutputError

Chosen = Callable[[str], bool]
_PRIVATE = (".lock", "owner.json")
"""Files that say which process of this machine is at work."""


class Storage:
    """Copies folders to an address and back.

    Args:
        address: Where, such as `s3://bucket/matrix` or `file:///mnt/matrix`; the protocol's package has to be
            installed.

    Raises:
        ConfigError: fsspec is not installed, or knows no such protocol.
    """

    def __init__(self, address: str):
        try:
            import fsspec
        except ImportError:
            raise ConfigError('--storage needs fsspec: pip install "morphkit[cluster]"') from None
        try:
            self._files, self._root = fsspec.core.url_to_fs(address)
        except (ValueError, ImportError) as error:
            raise ConfigError(f"{address}: cannot be used as storage: {error}") from None
        self.address = address
        self._sent: dict[str, tuple[int, int]] = {}

    def push(self, folder: Path, key: str, last: Iterable[str] = ()) -> None:
        """Make what is stored at `key` equal to a folder.

        What points at others has to come `last`: a copy that is cut short then still is one of before.

        Args:
            folder: What to copy.
            key: Where to, below the address.
            last: Paths below the folder that are written after all others.

        Raises:
            OutputError: It cannot be written.
        """
        paths = sorted(path for path in folder.rglob("*") if path.is_file() and path.name not in _PRIVATE)
        names = {path.relative_to(folder).as_posix(): path for path in paths}
        late = [name for name in last if name in names]
        try:
            for name in [*(name for name in names if name not in late), *late]:
                self._send(names[name], f"{self._root}/{key}/{name}")
            for name in self._names(key):
                if name not in names:
                    self._files.rm_file(f"{self._root}/{key}/{name}")
        except OSError as error:
            raise OutputError(f"{self.address}: cannot be written: {error}") from None

    def pull(self, key: str, folder: Path, chosen: Chosen = lambda name: True) -> None:
        """Copy what is stored at `key` into a folder; nothing where nothing is stored.

        Args:
            key: What, below the address.
            folder: Where to.
            chosen: Which files, by their paths below the key.

        Raises:
            OutputError: It cannot be read or written.
        """
        try:
            for name in self._names(key):
                path = PurePosixPath(name)
                if chosen(name) and not path.is_absolute() and ".." not in path.parts:
                    target = folder / path
                    target.parent.mkdir(parents=True, exist_ok=True)
                    part = target.with_name(f".{target.name}.part")
                    self._files.get_file(f"{self._root}/{key}/{name}", str(part))
                    part.replace(target)
        except OSError as error:
            raise OutputError(f"{self.address}: cannot be copied to {folder}: {error}") from None

    def holds(self, key: str) -> bool:
        """Whether anything is stored at `key`."""
        return bool(self._names(key))

    def _send(self, path: Path, target: str) -> None:
        found = path.stat()
        version = found.st_mtime_ns, found.st_size
        if self._sent.get(target) != version:
            self._files.makedirs(target.rpartition("/")[0], exist_ok=True)
            self._files.put_file(str(path), target)
            self._sent[target] = version

    def _names(self, key: str) -> list[str]:
        """Files at a key, by their paths below it."""
        top = f"{self._root}/{key}"
        self._files.invalidate_cache()
        return [name.removeprefix(f"{top}/") for name in sorted(self._files.find(top))]
