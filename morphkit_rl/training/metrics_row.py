"""What a row of `metrics.jsonl` says of a run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from torch import Tensor

from morphkit_rl.training.collector import Collector
from morphkit_rl.training.progress import Progress


def metrics_row(now: Progress, collector: Collector, losses: Mapping[str, Tensor]) -> dict[str, Any]:
    """One row of metrics.

    Args:
        now: How far the run is; rates are those since the row before.
        collector: The environments.
        losses: Scalars of the latest updates.
    """
    robots = len(collector.robots)
    return {
        "steps": now.steps,
        "real_steps": collector.real_steps,
        "updates": now.updates,
        "elapsed_s": round(now.elapsed_s, 3),
        "steps_per_s": round(now.steps_per_s, 1),
        "updates_per_s": round(now.updates_per_s, 2),
        "episodes": collector.episodes,
        "diverged": int(collector.env.diverged.sum()),
        "return_mean": _mean(now.returns, robots),
        "returns": now.returns,
        **_first(now, robots),
        **{name: float(value) for name, value in losses.items()},
    }


def _first(now: Progress, robots: int) -> dict[str, Any]:
    """What a row says of first episodes, until every robot has ended another."""
    if not now.first_returns:
        return {}
    return {
        "first_return_mean": _mean({**now.returns, **now.first_returns}, robots),
        "first_returns": now.first_returns,
    }


def _mean(returns: Mapping[str, float], robots: int) -> float | None:
    """Mean over all robots; None where one is missing."""
    return float(np.mean(list(returns.values()))) if len(returns) == robots else None
