"""Token texts into standardised embeddings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from morphkit_rl.text.encoder import TextEncoder


class TokenEmbedder:
    """A frozen encoder whose components are standardised over the texts that training knew.

    Token texts of robots are so alike that their raw embeddings differ little; standardised, the differences are what
    the policy reads.

    Args:
        encoder: The frozen text encoder.
        mean: (size,) mean over the training texts.
        std: (size,) standard deviation over the training texts.
    """

    def __init__(self, encoder: TextEncoder, mean: np.ndarray, std: np.ndarray):
        self.encoder, self.mean, self.std = encoder, mean, std

    @classmethod
    def fit(cls, encoder: TextEncoder, texts: Sequence[str]) -> TokenEmbedder:
        """Take mean and standard deviation over the distinct `texts`."""
        embeddings = encoder.encode(sorted(set(texts))).astype(np.float64)
        mean, std = embeddings.mean(0), embeddings.std(0)
        return cls(encoder, mean.astype(np.float32), np.maximum(std, 1e-3 * std.max() + 1e-6).astype(np.float32))

    @property
    def size(self) -> int:
        """Size of an embedding."""
        return self.encoder.size

    def __call__(self, texts: Sequence[str]) -> np.ndarray:
        """float32 (texts, size)."""
        return (self.encoder.encode(texts) - self.mean) / self.std
