"""Matrices that look as if they had been trained, in every state that a cell can be in."""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from morphkit_rl.benchmark import cells
from morphkit_rl.benchmark.cells import Cell, MatrixPlan
from morphkit_rl.benchmark.definition import load_benchmark
from morphkit_rl.benchmark.planning import plan_matrix

Level = Callable[[Cell], float]


def make_matrix(
    folder: Path,
    *,
    tasks: Sequence[str],
    methods: Sequence[str] = ("limb-former",),
    splits: Sequence[str] = ("1",),
    seeds: int = 3,
    steps: int = 3_000_000,
    validate: bool = False,
    states: Mapping[tuple[str, str, int], str] | None = None,
    level: Level | None = None,
    file: Path | None = None,
    overrides: Sequence[str] = (),
) -> list[MatrixPlan]:
    """Write a matrix whose cells are done, but for those in `states` (task, method, seed).

    Curves rise to `level` (3000 by default), noisily; held-out robots get a third of it. `file` defines tasks and
    splits besides the published ones; `overrides` are settings.
    """
    plans = plan_matrix(
        load_benchmark(file),
        tasks=tasks,
        splits=splits,
        methods=["limb-former"],
        seeds=seeds,
        steps=steps,
        validate=validate,
        overrides=overrides,
    )
    plans = [
        MatrixPlan(
            Cell(p.cell.split, p.cell.task, method, p.cell.seed), p.bodies, p.config, steps, None, p.episodes, validate
        )
        for p in plans
        for method in methods
    ]
    cells.create(plans, folder)
    for plan in plans:
        cell = plan.cell
        state = (states or {}).get((cell.task, cell.method, cell.seed), "done")
        write_cell(plan, cell.folder(folder), state, level(cell) if level else 3000.0)
    return plans


def write_cell(plan: MatrixPlan, folder: Path, state: str, level: float) -> None:
    """Write what a cell in this state leaves in its folder."""
    if state == "not started":
        return
    rng = np.random.default_rng([plan.cell.seed, len(plan.cell.task), len(plan.cell.method)])
    level *= rng.uniform(0.85, 1.15)
    run = folder / cells.RUN
    run.mkdir()
    share = 1.0 if state == "done" else rng.uniform(0.3, 0.7)
    rows = _metrics(plan, level, share, rng)
    (run / "metrics.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    if state == "failed":
        (folder / cells.FAILURE).write_text(
            json.dumps({"message": "RuntimeError: out of memory", "traceback": "Traceback"})
        )
    elif state == "running":
        note = {"pid": os.getpid(), "host": socket.gethostname(), "since": 0.0}
        (folder / "owner.json").write_text(json.dumps(note))
    elif state == "done":
        roles = {"train": (plan.bodies.train, 1.0), "validation": (plan.bodies.validation, 0.5)}
        if not plan.validate:
            roles["test"] = (plan.bodies.test, 0.35)
        found = [
            _robot(each.name, role, level * share, each.info.expert_return, rng)
            for role, (bodies, share) in roles.items()
            for each in bodies
        ]
        result = {
            "format_version": 1,
            "evaluated": "2026-01-01T00:00:00Z",
            "steps": rows[-1]["steps"],
            "real_steps": rows[-1]["real_steps"],
            "updates": rows[-1]["updates"],
            "elapsed_s": 100.0,
            "diverged": 0,
            "training_return": rows[-1]["return_mean"],
            "robots": found,
        }
        (folder / cells.RESULT).write_text(json.dumps(result))


def _metrics(plan: MatrixPlan, level: float, share: float, rng: np.random.Generator) -> list[dict[str, Any]]:
    experts = {each.name: each.info.expert_return for each in (*plan.bodies.train, *plan.bodies.validation)}
    budget = float(plan.steps or 1)
    rows = []
    for part in np.linspace(0.005, 1.0, 60)[: max(2, round(60 * share))]:
        mean = level * (1 - np.exp(-3.5 * part)) / (1 - np.exp(-3.5)) + rng.normal(0, 0.04 * level)
        evaluated = {name: float(mean * rng.uniform(0.8, 1.2)) for name in experts}
        returns = {each.name: evaluated[each.name] for each in plan.bodies.train}
        rows.append(
            {
                "steps": round(budget * part),
                "real_steps": round(1.2 * budget * part),
                "updates": round(budget * part / 4),
                "elapsed_s": 1000.0 * part,
                "diverged": 0,
                "return_mean": float(np.mean(list(returns.values()))),
                "returns": returns,
                "evaluation": {
                    name: {"mean": value, "returns": [value], "score": value / (experts[name] or 1.0)}
                    for name, value in evaluated.items()
                },
            }
        )
    return rows


def _robot(name: str, role: str, level: float, expert: float | None, rng: np.random.Generator) -> dict[str, Any]:
    returns = (level * rng.uniform(0.6, 1.4) + rng.normal(0, 30, 10)).tolist()
    return {
        "robot": name,
        "role": role,
        "mean": float(np.mean(returns)),
        "returns": returns,
        "lengths": [1000] * 10,
        "random_mean": -20.0,
        "expert_return": expert,
    }
