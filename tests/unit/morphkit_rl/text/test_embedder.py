"""Principal components of token embeddings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from morphkit_rl.text.embedder import TokenEmbedder, principal_components
from tests.support.networks import SIZE, embed

TEXTS = [f"limb {number} angle" for number in range(30)]


class Source:
    """Embeddings of which most numbers follow from three."""

    size = SIZE

    def encode(self, texts: Sequence[str]) -> np.ndarray:
        mix = np.random.default_rng(5).standard_normal((3, SIZE))
        return (embed(texts)[:, :3] @ mix + 1e-3 * embed(texts)).astype(np.float32)


def test_components_keep_the_distances_between_texts() -> None:
    whole, fewer = (TokenEmbedder.fit(Source(), TEXTS, components=n) for n in (0, 3))
    assert (whole.size, fewer.size) == (SIZE, 3)

    def distances(vectors: np.ndarray) -> np.ndarray:
        return np.linalg.norm(vectors[:, None] - vectors[None], axis=-1)

    full, reduced = distances(whole([*TEXTS, "hand"])), distances(fewer([*TEXTS, "hand"]))
    others = ~np.eye(len(TEXTS) + 1, dtype=bool)
    ratio = reduced[others] / full[others]
    np.testing.assert_allclose(ratio, ratio.mean(), rtol=0.01)
    np.testing.assert_allclose(np.square(fewer(TEXTS)).mean(), 1, rtol=1e-4)


def test_components_are_uncorrelated_and_ordered_by_their_variance() -> None:
    values = embed(TEXTS) @ principal_components(embed(TEXTS), 4)
    covariance = np.cov(values.T)
    np.testing.assert_allclose(covariance - np.diag(np.diag(covariance)), 0, atol=1e-5)
    assert (np.diff(np.diag(covariance)) < 0).all()


def test_more_components_than_numbers_are_all() -> None:
    assert TokenEmbedder.fit(Source(), TEXTS, components=500).size == SIZE
