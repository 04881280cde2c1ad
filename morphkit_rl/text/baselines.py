"""Stand-ins for a text encoder that tell whether the text matters at all."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from typing import Literal, Protocol

import numpy as np

Control = Literal["none", "random", "shuffled", "one-hot"]


class EmbeddingSource(Protocol):
    """Texts to vectors."""

    @property
    def size(self) -> int:
        """Length of a vector."""
        ...

    def encode(self, texts: Sequence[str]) -> np.ndarray:
        """float32 (texts, size)."""
        ...


class RandomTexts:
    """A fixed random vector for each text, normally distributed and without any relation to the text."""

    def __init__(self, size: int):
        self.size = size

    def encode(self, texts: Sequence[str]) -> np.ndarray:
        """float32 (texts, size)."""
        rows = [np.random.default_rng(zlib.crc32(text.encode())).standard_normal(self.size) for text in texts]
        return np.array(rows, dtype=np.float32).reshape(-1, self.size)


class ShuffledTexts:
    """The vectors of a true encoder, but each known text gets that of another known text.

    Texts that are not known keep their own vectors.
    """

    def __init__(self, source: EmbeddingSource, known: Sequence[str]):
        self.source, self.size = source, source.size
        ordered = sorted(set(known))
        moved = np.roll(np.random.default_rng(0).permutation(len(ordered)), 1)
        back = np.roll(moved, -1)
        self.other = {ordered[own]: ordered[other] for own, other in zip(moved, back, strict=True)}

    def encode(self, texts: Sequence[str]) -> np.ndarray:
        """float32 (texts, size)."""
        return self.source.encode([self.other.get(text, text) for text in texts])


class OneHotTexts:
    """A component of its own for each known text; zeros for any other."""

    def __init__(self, known: Sequence[str]):
        self.row = {text: number for number, text in enumerate(sorted(set(known)))}
        self.size = len(self.row)

    def encode(self, texts: Sequence[str]) -> np.ndarray:
        """float32 (texts, size)."""
        table = np.eye(self.size + 1, self.size, dtype=np.float32)
        return table[[self.row.get(text, self.size) for text in texts]]


def controlled(source: EmbeddingSource, control: Control, known: Sequence[str]) -> EmbeddingSource:
    """What replaces `source`, given the texts that training knows."""
    if control == "random":
        return RandomTexts(source.size)
    if control == "shuffled":
        return ShuffledTexts(source, known)
    return OneHotTexts(known) if control == "one-hot" else source
