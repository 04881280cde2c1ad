"""Estimates over seeds: mean, interquartile mean and probability of improvement, with bootstrap intervals.

After Agarwal et al. 2021, "Deep Reinforcement Learning at the Edge of the Statistical Precipice". A stratum is a task
in a split. What is resampled in it are seeds: a seed is one policy, and its robots stay together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

RESAMPLES = 10_000
LEVEL = 0.95
_BATCH = 1000

Statistic = Callable[[Sequence[np.ndarray]], np.ndarray]
"""Takes an array (..., values) a stratum, gives (...)."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number with its 95 % interval; no interval where a stratum has a single seed."""

    value: float
    low: float | None = None
    high: float | None = None


def interquartile_mean(strata: Sequence[np.ndarray]) -> np.ndarray:
    """Mean of the middle half of all values of all strata together; a quarter, rounded down, goes at either end."""
    return np.asarray(stats.trim_mean(np.concatenate(strata, axis=-1), 0.25, axis=-1))


def mean_of_means(strata: Sequence[np.ndarray]) -> np.ndarray:
    """Mean over the strata of the mean of each, whatever number of values each has."""
    return np.mean([values.mean(axis=-1) for values in strata], axis=0)


def estimate(strata: Sequence[np.ndarray], statistic: Statistic = mean_of_means) -> Estimate:
    """A statistic with its percentile bootstrap interval, the same for the same numbers.

    Args:
        strata: A stratum each, (seeds,) or (seeds, robots).
        statistic: Of all strata.

    Raises:
        ValueError: There is no stratum, or an empty one.
    """
    tables = [np.asarray(values, float) for values in strata]
    if not tables or any(table.size == 0 for table in tables):
        raise ValueError("an estimate needs at least one value a stratum")
    tables = [table.reshape(len(table), -1) for table in tables]

    def of_seeds(*chosen: np.ndarray, axis: int = -1) -> np.ndarray:
        del axis  # scipy says -1
        pools = [table[seeds] for table, seeds in zip(tables, chosen, strict=True)]
        return statistic([pool.reshape(*pool.shape[:-2], -1) for pool in pools])

    return _bootstrapped([len(table) for table in tables], of_seeds)


def estimate_curve(values: np.ndarray, statistic: Statistic) -> tuple[np.ndarray, np.ndarray | None, np.ndarray | None]:
    """A statistic at every point of a curve, with the percentile bootstrap interval of the seeds' whole curves.

    Args:
        values: (seeds, points, robots) of one stratum.
        statistic: Of the stratum.

    Returns:
        Values, low and high ends, (points,); no ends for a single seed.
    """
    by_point = np.swapaxes(values, 0, 1)
    points, seeds = by_point.shape[:2]

    def of_seeds(chosen: np.ndarray) -> np.ndarray:
        return statistic([by_point[:, chosen].reshape(points, -1)])

    whole = of_seeds(np.arange(seeds))
    if seeds < 2:
        return whole, None, None
    draws = np.random.default_rng(0).integers(seeds, size=(RESAMPLES, seeds))
    # Few draws differ: of 3 seeds, 10 do.
    distinct, which = np.unique(np.sort(draws, axis=1), axis=0, return_inverse=True)
    found = np.stack([of_seeds(chosen) for chosen in distinct])
    tail = 50 * (1 - LEVEL)
    low, high = np.percentile(found[which.reshape(-1)], [tail, 100 - tail], axis=0)
    return whole, low, high


def probability_of_improvement(ours: Sequence[np.ndarray], theirs: Sequence[np.ndarray]) -> Estimate:
    """Probability that a random seed of ours beats a random one of theirs, averaged over strata; ties count a half.

    Args:
        ours: A stratum each, (seeds,): one score a seed.
        theirs: The same strata in the same order; another number of seeds is fine.

    Raises:
        ValueError: There is no stratum, or an empty one.
    """
    xs, ys = ([np.asarray(values, float) for values in side] for side in (ours, theirs))
    if not xs or len(xs) != len(ys) or any(values.size == 0 for values in (*xs, *ys)):
        raise ValueError("an improvement needs the same strata on both sides, none of them empty")

    def of_seeds(*chosen: np.ndarray, axis: int = -1) -> np.ndarray:
        del axis
        pairs = zip(xs, ys, chosen[: len(xs)], chosen[len(xs) :], strict=True)
        return np.mean([_beats(x[i], y[j]) for x, y, i, j in pairs], axis=0)

    return _bootstrapped([len(values) for values in (*xs, *ys)], of_seeds)


def _beats(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Share of pairs that x wins: the Mann-Whitney U over the number of pairs, (..., n) and (..., m) to (...)."""
    left, right = x[..., :, None], y[..., None, :]
    return np.mean((left > right) + 0.5 * (left == right), axis=(-2, -1))


def _bootstrapped(sizes: Sequence[int], of_seeds: Callable[..., np.ndarray]) -> Estimate:
    """The statistic of all seeds, and its interval when the seeds of each stratum are drawn with replacement."""
    seeds = tuple(np.arange(size) for size in sizes)
    value = float(of_seeds(*seeds))
    if min(sizes) < 2:
        return Estimate(value)
    found = stats.bootstrap(
        seeds, of_seeds, n_resamples=RESAMPLES, batch=_BATCH, vectorized=True, confidence_level=LEVEL,
        method="percentile", rng=np.random.default_rng(0),
    )  # fmt: skip
    return Estimate(value, float(found.confidence_interval.low), float(found.confidence_interval.high))
