"""Embeddings on disk: one SQLite file per model and pooling. Whatever happens to the file, encoding goes on."""

from __future__ import annotations

import logging
import sqlite3
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from morphkit.utils.cache_dir import cache_dir

logger = logging.getLogger(__name__)

_FORMAT = 1
_BUSY_S = 10.0
_TABLE = "CREATE TABLE IF NOT EXISTS embeddings (text TEXT PRIMARY KEY, vector BLOB NOT NULL, crc INTEGER NOT NULL)"
_MADE = "SELECT 1 FROM sqlite_master WHERE name = 'embeddings'"


class EmbeddingCache:
    """Text -> float32 vector, kept on disk.

    A damaged file is deleted and built anew. A folder that cannot be written, a full disk or a database that stays
    locked costs one warning and the speed, never the run. Several processes may share a file.

    Args:
        name: What the vectors depend on besides the text; becomes the file's name.
        size: Length of a vector.
        folder: Where the file lies; default `cache_dir()`.
    """

    def __init__(self, name: str, size: int, folder: Path | None = None) -> None:
        self.file = (cache_dir() if folder is None else Path(folder)) / f"{name}-v{_FORMAT}.sqlite3"
        self.size = size
        self._warned = False

    def get(self, texts: Iterable[str]) -> dict[str, np.ndarray]:
        """Return the vectors, shape (size,), of those texts that are there."""
        try:
            if self.file.is_file():
                with self._connection() as connection:
                    if connection.execute(_MADE).fetchone():  # Another process may have the file open to make it.
                        return self._select(connection, texts)
        except (sqlite3.Error, OSError) as error:
            self._handle(error)
        return {}

    def put(self, vectors: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Keep vectors of shape (size,), but for texts that another process has kept meanwhile.

        The same text may have other last bits from another batch; who comes first is right, so that a run that goes on
        later reads what it began with.

        Returns:
            The vectors that count; those given where they cannot be kept, which costs a warning.
        """
        for _ in range(2):  # The second time on a new file, where the first one turned out to be damaged.
            try:
                self.file.parent.mkdir(parents=True, exist_ok=True)
                with self._connection() as connection, connection:
                    connection.execute(_TABLE)
                    connection.execute("BEGIN IMMEDIATE")
                    kept = self._select(connection, vectors)
                    rows = [(text, *self._pack(text, vectors[text])) for text in vectors.keys() - kept.keys()]
                    connection.executemany("INSERT OR REPLACE INTO embeddings VALUES (?, ?, ?)", rows)
                return {**vectors, **kept}
            except (sqlite3.Error, OSError) as error:
                if not self._handle(error):
                    break
        return dict(vectors)

    def _select(self, connection: sqlite3.Connection, texts: Iterable[str]) -> dict[str, np.ndarray]:
        """The vectors of those texts that are there, and whole."""
        found: dict[str, np.ndarray] = {}
        for text in texts:
            row = connection.execute("SELECT vector, crc FROM embeddings WHERE text = ?", (text,)).fetchone()
            vector = None if row is None else self._unpack(text, *row)
            if vector is not None:
                found[text] = vector
        return found

    @contextmanager
    def _connection(self) -> Iterator[sqlite3.Connection]:
        connection = sqlite3.connect(self.file, timeout=_BUSY_S)
        try:
            yield connection
        finally:
            connection.close()

    def _pack(self, text: str, vector: np.ndarray) -> tuple[bytes, int]:
        blob = np.ascontiguousarray(vector, dtype="<f4").tobytes()
        return blob, zlib.crc32(text.encode() + blob)

    def _unpack(self, text: str, blob: object, crc: object) -> np.ndarray | None:
        if not isinstance(blob, bytes) or len(blob) != 4 * self.size or zlib.crc32(text.encode() + blob) != crc:
            return None
        return np.frombuffer(blob, dtype="<f4").astype(np.float32)

    def _handle(self, error: Exception) -> bool:
        """Delete a damaged file (True: worth another try) or warn once that the cache is not in use."""
        damaged = isinstance(error, sqlite3.DatabaseError) and getattr(error, "sqlite_errorcode", None) in (
            sqlite3.SQLITE_CORRUPT,
            sqlite3.SQLITE_NOTADB,
            sqlite3.SQLITE_ERROR,  # Another table than ours.
        )
        if damaged:
            try:
                self.file.unlink(missing_ok=True)
                self.file.with_name(self.file.name + "-journal").unlink(missing_ok=True)
            except OSError as failed:
                error = failed
            else:
                logger.warning("the embedding cache %s was damaged (%s) and is built anew", self.file, error)
                return True
        if not self._warned:
            self._warned = True
            logger.warning(
                "the embedding cache %s is not in use (%s); texts are encoded again in every run. "
                "Set MORPHKIT_CACHE to a folder of your own that can be written",
                self.file,
                error,
            )
        return False
