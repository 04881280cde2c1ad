"""A matrix in numbers: per cell, per task and method, per split, and method against method."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Literal

import numpy as np

from morphkit.errors import CheckpointError
from morphkit_rl.benchmark.cells import Status
from morphkit_rl.benchmark.published import OVERALL, Kind, published_returns
from morphkit_rl.benchmark.statistics import (
    Estimate,
    estimate,
    interquartile_mean,
    probability_of_improvement,
)
from morphkit_rl.evaluation.episodes import normalized

Role = Literal["train", "validation", "test"]


@dataclass(frozen=True)
class Entry:
    """One method on one task of one split, over its seeds.

    Attributes:
        split: Name of the split.
        task: Name of the task.
        method: Name of the method.
        cells: Its cells, by seed.
        role: Whether `held_out` is of test or of validation robots.
        training_return: Mean over done seeds of the final training return, with exploration noise.
        training_noise_free: Mean over done seeds of the noise-free return on training robots.
        training_score: Interquartile mean over done seeds and training robots of the noise-free score.
        held_out: Mean over done seeds of the noise-free return on held-out robots; None where there are none.
        held_out_score: As `training_score`, on the held-out robots.
        published_training: What the study reports for `training_return`.
        published_held_out: What the study reports for `held_out` on test robots.
    """

    split: str
    task: str
    method: str
    cells: tuple[Status, ...]
    role: Role
    training_return: Estimate | None
    training_noise_free: Estimate | None
    training_score: Estimate | None
    held_out: Estimate | None
    held_out_score: Estimate | None
    published_training: float | None
    published_held_out: float | None

    @property
    def done(self) -> tuple[Status, ...]:
        """Cells that are trained and evaluated."""
        return tuple(cell for cell in self.cells if cell.state == "done")

    @property
    def has_held_out(self) -> bool:
        """Whether the cells hold robots out at all; the task `hoppers` does not."""
        return any(cell.plan[self.role] for cell in self.cells)

    @property
    def states(self) -> str:
        """`2 of 3 done, 1 running`; `3 done` where all are."""
        states = [cell.state for cell in self.cells]
        if len(self.done) == len(states):
            return f"{len(states)} done"
        rest = [f"{states.count(state)} {state}" for state in dict.fromkeys(states) if state != "done"]
        return ", ".join([f"{len(self.done)} of {len(states)} done", *rest])


@dataclass(frozen=True, slots=True)
class Overall:
    """One method over the tasks of a split.

    Attributes:
        split: Name of the split.
        method: Name of the method.
        tasks: Tasks with held-out robots of which a seed is done.
        of_tasks: Tasks with held-out robots in the split.
        held_out: Mean over tasks and seeds of the return on held-out robots.
        held_out_score: Interquartile mean of the score on held-out robots, stratified by task.
        training_score: The same on training robots.
        published_held_out: What the study reports for `held_out`, over all tasks.
    """

    split: str
    method: str
    tasks: tuple[str, ...]
    of_tasks: int
    held_out: Estimate | None
    held_out_score: Estimate | None
    training_score: Estimate | None
    published_held_out: float | None


@dataclass(frozen=True, slots=True)
class Improvement:
    """Probability that a seed of `better` scores higher than one of `than`, over the tasks that both have."""

    split: str
    better: str
    than: str
    robots: Role
    tasks: tuple[str, ...]
    probability: Estimate


def summarize(cells: Sequence[Status]) -> list[Entry]:
    """One entry a split, task and method, in the order of the cells.

    Raises:
        CheckpointError: A result lacks something.
    """
    keys = dict.fromkeys((each.cell.split, each.cell.task, each.cell.method) for each in cells)
    return [
        _entry([each for each in cells if (each.cell.split, each.cell.task, each.cell.method) == key]) for key in keys
    ]


def overall(entries: Sequence[Entry], of_tasks: Callable[[str], int]) -> list[Overall]:
    """One row a split and method.

    Args:
        entries: Of `summarize`.
        of_tasks: Number of tasks with held-out robots in a split.
    """
    found = []
    for split, method in dict.fromkeys((each.split, each.method) for each in entries):
        own = [each for each in entries if (each.split, each.method) == (split, method) and each.done]
        with_held_out = [each for each in own if each.has_held_out]
        validation = any(each.role == "validation" for each in own)
        found.append(
            Overall(
                split,
                method,
                tuple(each.task for each in with_held_out),
                of_tasks(split),
                _estimate([seed_means(each.done, each.role) for each in with_held_out]),
                _estimate([_scores(each.done, each.role) for each in with_held_out], interquartile_mean),
                _estimate([_scores(each.done, "train") for each in own], interquartile_mean),
                None if validation else published_returns("zero_shot", split, OVERALL).get(method),
            )
        )
    return found


def improvements(entries: Sequence[Entry]) -> list[Improvement]:
    """Every pair of methods of a split that have done tasks in common, on training and on held-out robots."""
    found = []
    for split in dict.fromkeys(each.split for each in entries):
        by_method: dict[str, dict[str, Entry]] = {}
        for each in entries:
            if each.split == split and each.done:
                by_method.setdefault(each.method, {})[each.task] = each
        for better, than in combinations(by_method, 2):
            ours, theirs = by_method[better], by_method[than]
            for held_out in (True, False):
                tasks = tuple(t for t in ours if t in theirs and (not held_out or ours[t].has_held_out))
                role: Role = ours[tasks[0]].role if held_out and tasks else "train"
                sides = [[_scores(side[t].done, role) for t in tasks] for side in (ours, theirs)]
                if not tasks or not all(scores.size for side in sides for scores in side):
                    continue
                means = [[scores.mean(axis=1) for scores in side] for side in sides]
                found.append(Improvement(split, better, than, role, tasks, probability_of_improvement(*means)))
    return found


def robot_rows(cells: Iterable[Status]) -> list[dict[str, Any]]:
    """One row a robot of every done cell."""
    return [
        {
            **{name: getattr(each.cell, name) for name in ("split", "task", "method", "seed")},
            **{key: robot[key] for key in ("robot", "role", "mean", "random_mean", "expert_return")},
            "std": float(np.std(robot["returns"])),
            "score": _score(robot),
            "episodes": len(robot["returns"]),
        }
        for each in cells
        if each.result is not None
        for robot in each.result["robots"]
    ]


def _entry(cells: Sequence[Status]) -> Entry:
    cell = cells[0].cell
    role: Role = "validation" if cells[0].plan["validate"] else "test"
    done = [each for each in cells if each.state == "done"]
    returns = [each.result["training_return"] for each in done if each.result]
    known = [value for value in returns if value is not None]
    # Under validation fewer robots are trained on, and others held out, than in the study.
    kinds: tuple[Kind, ...] = () if role == "validation" else ("train", "zero_shot")
    published = {kind: published_returns(kind, cell.split, cell.task).get(cell.method) for kind in kinds}
    return Entry(
        split=cell.split,
        task=cell.task,
        method=cell.method,
        cells=tuple(cells),
        role=role,
        training_return=_estimate([np.array(known)]),
        training_noise_free=_estimate([seed_means(done, "train")]),
        training_score=_estimate([_scores(done, "train")], interquartile_mean),
        held_out=_estimate([seed_means(done, role)]),
        held_out_score=_estimate([_scores(done, role)], interquartile_mean),
        published_training=published.get("train"),
        published_held_out=published.get("zero_shot"),
    )


def _estimate(strata: Sequence[np.ndarray], *statistic: Any) -> Estimate | None:
    kept = [values for values in strata if values.size]
    return estimate(kept, *statistic) if kept else None


def seed_means(cells: Sequence[Status], role: Role) -> np.ndarray:
    """Mean noise-free return over the robots of a role, (seeds,)."""
    tables = [[robot["mean"] for robot in _robots(each, role)] for each in cells]
    return np.array([np.mean(table) for table in tables if table])


def _scores(cells: Sequence[Status], role: Role) -> np.ndarray:
    """(return - random) / (expert - random), (seeds, robots whose expert return is known)."""
    tables = [[_score(robot) for robot in _robots(each, role)] for each in cells]
    return np.array([[score for score in table if score is not None] for table in tables])


def _score(robot: dict[str, Any]) -> float | None:
    return normalized(robot["mean"], robot["random_mean"], robot["expert_return"])


def _robots(each: Status, role: Role) -> list[dict[str, Any]]:
    try:
        return [robot for robot in (each.result or {})["robots"] if robot["role"] == role]
    except (KeyError, TypeError):
        raise CheckpointError(f"{each.folder / 'result.json'}: damaged: it lists no robots") from None
