"""Token texts into standardized embeddings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from morphkit_rl.text.baselines import EmbeddingSource


class TokenEmbedder:
    """A frozen encoder whose components are standardized over the texts that training knew.

    Token texts of robots are so alike that their raw embeddings differ little; standardized, the differences are what
    the policy reads.

    Args:
        source: The frozen text encoder, or what replaces it.
        mean: (size,) mean over the training texts.
        std: (size,) standard deviation over the training texts.
        components: (size, kept) matrix onto principal components; None keeps the standardized embeddings.
    """

    def __init__(
        self, source: EmbeddingSource, mean: np.ndarray, std: np.ndarray, components: np.ndarray | None = None
    ):
        self.source, self.mean, self.std, self.components = source, mean, std, components

    @classmethod
    def fit(
        cls, source: EmbeddingSource, texts: Sequence[str], *, standardize: bool = True, components: int = 0
    ) -> TokenEmbedder:
        """Make the embedder for training texts.

        Args:
            source: The frozen text encoder.
            texts: The training texts; duplicates count once.
            standardize: Whether to take mean and standard deviation over them; else 0 and 1.
            components: Principal components to keep; 0 for all numbers of an embedding. There are at most as many as
                texts. They are scaled together, so that their mean square is 1.
        """
        distinct = sorted(set(texts))
        mean, std = np.zeros(source.size, np.float32), np.ones(source.size, np.float32)
        if standardize:
            embeddings = source.encode(distinct).astype(np.float64)
            spread = embeddings.std(0)
            mean = embeddings.mean(0).astype(np.float32)
            std = np.maximum(spread, 1e-3 * spread.max() + 1e-6).astype(np.float32)
        embedder = cls(source, mean, std)
        if components:
            embedder.components = principal_components(embedder(distinct), components)
        return embedder

    @property
    def size(self) -> int:
        """Size of an embedding."""
        return self.source.size if self.components is None else self.components.shape[1]

    def __call__(self, texts: Sequence[str]) -> np.ndarray:
        """float32 (texts, size)."""
        standardized = (self.source.encode(texts) - self.mean) / self.std
        return standardized if self.components is None else standardized @ self.components


def principal_components(embeddings: np.ndarray, kept: int) -> np.ndarray:
    """Matrix (size, kept) that maps embeddings (texts, size) onto the directions in which they vary most.

    What it gives for these embeddings has a mean square of 1. Fewer columns where there are fewer texts or numbers.
    """
    centered = embeddings.astype(np.float64) - embeddings.mean(0, dtype=np.float64)
    _, sizes, directions = np.linalg.svd(centered, full_matrices=False)
    matrix = directions[:kept].T
    matrix = matrix * np.sign(matrix[np.abs(matrix).argmax(0), np.arange(matrix.shape[1])])
    size = np.sqrt(np.square(sizes[:kept]).sum() / (len(embeddings) * matrix.shape[1]))
    return (matrix / max(size, 1e-6)).astype(np.float32)
