"""Token texts into standardised embeddings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from morphkit_rl.text.baselines import Source


class TokenEmbedder:
    """A frozen encoder whose components are standardised over the texts that training knew.

    Token texts of robots are so alike that their raw embeddings differ little; standardised, the differences are what
    the policy reads.

    Args:
        source: The frozen text encoder, or what stands in for it.
        mean: (size,) mean over the training texts.
        std: (size,) standard deviation over the training texts.
    """

    def __init__(self, source: Source, mean: np.ndarray, std: np.ndarray):
        self.source, self.mean, self.std = source, mean, std

    @classmethod
    def fit(cls, source: Source, texts: Sequence[str], *, standardize: bool = True) -> TokenEmbedder:
        """Take mean and standard deviation over the distinct `texts`; without `standardize`, 0 and 1."""
        if not standardize:
            return cls(source, np.zeros(source.size, np.float32), np.ones(source.size, np.float32))
        embeddings = source.encode(sorted(set(texts))).astype(np.float64)
        mean, std = embeddings.mean(0), embeddings.std(0)
        return cls(source, mean.astype(np.float32), np.maximum(std, 1e-3 * std.max() + 1e-6).astype(np.float32))

    @property
    def size(self) -> int:
        """Size of an embedding."""
        return self.source.size

    def __call__(self, texts: Sequence[str]) -> np.ndarray:
        """float32 (texts, size)."""
        return (self.source.encode(texts) - self.mean) / self.std
