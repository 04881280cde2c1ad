"""Learning curves of a cell, and of several seeds together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from morphkit_rl import runs
from morphkit_rl.benchmark.cells import RUN, Status
from morphkit_rl.benchmark.statistics import Statistic, estimate

Measure = Literal["return", "score"]

_POINTS = 80
_RESAMPLES = 1000


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
        measure: `return`: mean return of training episodes, with exploration noise. `score`: noise-free return / expert
            return of each training robot whose expert return is known.
    """
    rows = cell.metrics
    if measure == "return":
        points = [(row["steps"], [row["return_mean"]]) for row in rows if row.get("return_mean") is not None]
    else:
        if not any(row.get("evaluation") for row in rows):
            return None
        known = {each["name"]: each["info"]["expert_return"] for each in runs.read(cell.folder / RUN)["robots"]}
        experts = {name: expert for name, expert in known.items() if expert}
        points = [
            (row["steps"], [row["evaluation"][name]["mean"] / expert for name, expert in experts.items()])
            for row in rows
            if row.get("evaluation") and experts.keys() <= row["evaluation"].keys()
        ]
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
    on_grid = [np.stack([np.interp(grid, c.steps, column) for column in c.values.T]) for c in curves]
    found = [
        estimate([np.stack([values[:, point] for values in on_grid])], statistic, resamples=_RESAMPLES)
        for point in range(len(grid))
    ]
    values = np.array([each.value for each in found])
    if any(each.low is None for each in found):
        return Band(grid, values, None, None)
    low, high = (np.array([getattr(each, end) for each in found], float) for end in ("low", "high"))
    return Band(grid, values, low, high)
