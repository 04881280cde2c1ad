"""Observation statistics per quantity and component."""

from __future__ import annotations

import numpy as np
import torch

from morphkit.registry import load
from morphkit.tokens.spec import TokenSpec, token_spec
from morphkit_rl.algorithms.normalizer import CLIP, Normalizer, normalize


def spec(name: str) -> TokenSpec:
    from morphkit.readers import read

    return token_spec(read(load(name)))


def test_streamed_statistics_equal_those_of_all_rows_at_once() -> None:
    specs = [spec("cheetah"), spec("hopper")]
    normalizer = Normalizer()
    index = normalizer.index(specs, grow=True)
    rng = np.random.default_rng(0)
    obs = rng.normal(3, 2, (300, len(index))).astype(np.float32) * np.linspace(0.5, 2, len(index), dtype=np.float32)
    for part in np.split(obs, 10):
        normalizer.update(part, index)
    for row in range(len(normalizer.keys)):
        values = obs[:, index == row].astype(np.float64)
        assert np.isclose(normalizer.mean[row], values.mean())
        assert np.isclose(normalizer.m2[row] / normalizer.count[row], values.var())


def test_like_scalars_of_unseen_limbs_have_statistics() -> None:
    normalizer = Normalizer()
    seen = normalizer.index([spec("cheetah")], grow=True)
    normalizer.update(np.random.default_rng(0).normal(5, 3, (100, len(seen))), seen)
    unseen = normalizer.index([spec("humanoid_2d")])
    assert (unseen >= 0).all()
    scale, shift = normalizer.scale_and_shift(unseen)
    assert np.allclose(1 / scale, 3, rtol=0.2)
    assert np.allclose(-shift / scale, 5, rtol=0.2)


def test_a_quantity_without_statistics_passes_unchanged() -> None:
    scale, shift = Normalizer().scale_and_shift(np.array([-1, -1]))
    np.testing.assert_allclose(scale, 1, rtol=1e-3)
    np.testing.assert_allclose(shift, 0, atol=1e-6)


def test_wild_states_are_bounded() -> None:
    rows = normalize(torch.tensor([[1e9, -1e9, 0.5]]), torch.ones(3), torch.zeros(3))
    assert rows.tolist() == [[CLIP, -CLIP, 0.5]]


def test_a_wild_state_hides_nothing_from_the_other_robots() -> None:
    normalizer = Normalizer()
    index = normalizer.index([spec("cheetah")], grow=True)
    obs = np.random.default_rng(0).normal(0, 3, (10_000, len(index))).astype(np.float32)
    obs[17] = 1e10
    normalizer.update(obs, index)
    scale, _ = normalizer.scale_and_shift(index)
    assert (1 / scale < 12).all()
