"""Interquartile mean, intervals and probability of improvement, against brute force."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy import stats

from morphkit_rl.benchmark.statistics import (
    Estimate,
    estimate,
    estimate_curve,
    interquartile_mean,
    mean_of_means,
    probability_of_improvement,
)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def test_interquartile_mean_is_the_mean_of_the_middle_half_of_all_values(rng: np.random.Generator) -> None:
    strata = [rng.normal(size=5), rng.normal(size=7)]
    pooled = sorted(np.concatenate(strata))
    assert estimate(strata, interquartile_mean).value == pytest.approx(np.mean(pooled[3:9]))
    assert interquartile_mean([np.array([1.0, 2.0, 9.0])]) == pytest.approx(4.0), "a quarter of 3, rounded down, is 0"


def test_interval_of_a_mean_covers_every_resample_that_can_be_drawn() -> None:
    values = np.array([1.0, 4.0, 10.0])
    means = sorted(np.mean(draw) for draw in itertools.product(values, repeat=3))
    found = estimate([values])
    assert found.value == 5.0
    # 1/27 of the resamples is all ones and 1/27 all tens: more than 2.5 % each, so the interval reaches both.
    assert (found.low, found.high) == (means[0], means[-1])


def test_interval_is_the_percentiles_of_all_resamples_of_two_strata(rng: np.random.Generator) -> None:
    strata = [rng.normal(size=4), rng.normal(2, 3, size=3)]
    every = [
        np.mean([np.mean(a), np.mean(b)])
        for a in itertools.product(strata[0], repeat=4)
        for b in itertools.product(strata[1], repeat=3)
    ]
    found = estimate(strata)
    assert found.value == pytest.approx(np.mean([s.mean() for s in strata]))
    np.testing.assert_allclose((found.low, found.high), np.percentile(every, [2.5, 97.5]), atol=0.12)


def test_a_seed_keeps_its_robots_together() -> None:
    # Robots differ by 100, seeds by nothing: drawing single values would give an interval, drawing seeds gives none.
    scores = np.array([[0.0, 100.0], [0.0, 100.0], [0.0, 100.0]])
    assert estimate([scores]) == Estimate(50.0, 50.0, 50.0)


def test_tasks_weigh_the_same_in_the_mean_and_robots_in_the_interquartile_mean() -> None:
    strata = [np.array([[0.0] * 6, [0.0] * 6]), np.array([[8.0, 8.0], [8.0, 8.0]])]
    assert estimate(strata, mean_of_means).value == 4.0
    assert estimate(strata, interquartile_mean).value == 0.0, "12 zeros and 4 eights: the middle eight are zeros"


def test_strata_are_resampled_each_on_its_own() -> None:
    # Two constant strata far apart: pooling them before drawing would spread the mean, stratified drawing does not.
    assert estimate([np.zeros(3), np.full(3, 10.0)]) == Estimate(5.0, 5.0, 5.0)


def test_a_curve_is_the_estimate_at_every_point(rng: np.random.Generator) -> None:
    values = rng.normal(size=(4, 6, 3))
    for statistic in (mean_of_means, interquartile_mean):
        found, low, high = estimate_curve(values, statistic)
        assert low is not None
        assert high is not None
        for point in range(6):
            single = estimate([values[:, point]], statistic)
            assert found[point] == pytest.approx(single.value)
            assert (low[point], high[point]) == pytest.approx((single.low, single.high), abs=0.05)
    alone, low, high = estimate_curve(values[:1], mean_of_means)
    np.testing.assert_allclose(alone, values[0].mean(axis=1))
    assert low is None
    assert high is None


def test_a_single_seed_has_no_interval() -> None:
    assert estimate([np.array([3.0])]) == Estimate(3.0)
    assert estimate([np.array([3.0]), np.array([1.0, 2.0])]) == Estimate(2.25)
    assert probability_of_improvement([np.array([3.0])], [np.array([1.0, 2.0])]) == Estimate(1.0)


def test_probability_of_improvement_is_mann_whitney(rng: np.random.Generator) -> None:
    ours = [rng.integers(0, 6, 5).astype(float), rng.integers(0, 6, 4).astype(float)]
    theirs = [rng.integers(0, 6, 3).astype(float), rng.integers(0, 6, 6).astype(float)]
    shares = [stats.mannwhitneyu(x, y).statistic / (len(x) * len(y)) for x, y in zip(ours, theirs, strict=True)]
    brute = np.mean(
        [
            np.mean([1.0 if a > b else 0.5 if a == b else 0.0 for a in x for b in y])
            for x, y in zip(ours, theirs, strict=True)
        ]
    )
    found = probability_of_improvement(ours, theirs)
    assert found.value == pytest.approx(np.mean(shares)) == pytest.approx(brute)
    assert found.low is not None
    assert found.high is not None
    assert found.low < found.value < found.high
    other = probability_of_improvement(theirs, ours)
    assert other.value == pytest.approx(1 - found.value)


def test_the_same_numbers_give_the_same_interval(rng: np.random.Generator) -> None:
    strata = [rng.normal(size=(5, 3))]
    assert estimate(strata, interquartile_mean) == estimate(strata, interquartile_mean)


@pytest.mark.parametrize("strata", [[], [np.array([])], [np.array([1.0]), np.empty((2, 0))]])
def test_nothing_to_estimate_is_refused(strata: list[np.ndarray]) -> None:
    with pytest.raises(ValueError, match="at least one value"):
        estimate(strata)
    with pytest.raises(ValueError, match="same strata"):
        probability_of_improvement([np.ravel(values) for values in strata], [np.array([])] * len(strata))
