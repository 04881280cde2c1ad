"""Learning curves of a cell, and of several seeds together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from morphkit_rl.benchmark.cells import Status
from morphkit_rl.benchmark.statistics import Statistic, estimate_curve

Measure = Literal["return", "score"]

_POINTS = 80


@dataclass(frozen=True, slots=True)
class SeedCurve:
    """Counted steps (points,) and values (points, robots); a single column where the value is of all robots."""

    steps: np.ndarray
    values: np.ndarray


@dataclass(frozen=True, slots=True)
class Band:
    """Steps, values and 95 % interval (points,) over seeds; no interval for a single seed."""

    steps: np.ndarray
    values: np.ndarray
    low: np.ndarray | None
    high: np.ndarray | None


def seed_curve(cell: Status, measure: Measure) -> SeedCurve | None:
    """The curve of one cell, as far as it has got; None before the first point.

    Args:
        cell: The cell.
        measure: `return`: mean return of training episodes, with exploration noise. `score`: (return - random) /
            (expert - random), noise-free, of each validation robot, or training robot where there are none, whose
            expert return is known.
    """
    rows = cell.metrics
    if measure == "return":
        points = [(row["steps"], [row["return_mean"]]) for row in rows if row.get("return_mean") is not None]
    else:
        robots = list(cell.plan["validation"] or cell.plan["train"])
        evaluated = [(row["steps"], row["evaluation"]) for row in rows if row.get("evaluation")]
        points = [(steps, [found[name]["score"] for name in robots if name in found]) for steps, found in evaluated]
        points = [(steps, [score for score in scores if score is not None]) for steps, scores in points]
    points = [(steps, values) for steps, values in points if values and np.isfinite(values).all()]
    if not points:
        return None
    steps, values = zip(*points, strict=True)
    return SeedCurve(np.array(steps, float), np.array(values, float))


def band(curves: Sequence[SeedCurve], statistic: Statistic) -> Band | None:
    """Several seeds as one curve, where all of them have values; None where they have nowhere.

    Args:
        curves: One a seed.
        statistic: How seeds and robots become one number at each point.
    """
    first, last = max(curve.steps[0] for curve in curves), min(curve.steps[-1] for curve in curves)
    if first > last:
        return None
    grid = np.linspace(first, last, _POINTS) if last > first else np.array([first])
    on_grid = [np.stack([np.interp(grid, c.steps, column) for column in c.values.T], axis=1) for c in curves]
    return Band(grid, *estimate_curve(np.stack(on_grid), statistic))
