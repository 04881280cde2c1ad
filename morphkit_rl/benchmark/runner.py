"""Runs a matrix of cells; goes on where an earlier process stopped."""

from __future__ import annotations

import json
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import numpy as np

from morphkit.errors import MorphkitError
from morphkit.utils.atomic_write import write_text
from morphkit_rl.benchmark import cell_schema, cells
from morphkit_rl.benchmark.cells import MatrixPlan
from morphkit_rl.evaluation.evaluate import RobotResult, evaluate
from morphkit_rl.runs import schema
from morphkit_rl.runs.lock import hold
from morphkit_rl.runs.metrics_log import read_metrics
from morphkit_rl.training import trainer
from morphkit_rl.training.progress import Progress, hundredth

EVALUATION_SEED = 10_000
"""A cell's final evaluation starts from this seed plus its own, so that methods meet the same start states."""
FINAL_SHARE = 0.05
"""The final training return is the mean over the rows of metrics in this last share of the steps."""

Watch = Callable[[MatrixPlan, int], AbstractContextManager[Callable[[Progress], None]]]
"""Called with a cell and its number when it starts; its block gets the progress of training."""


def run_matrix(
    plans: Sequence[MatrixPlan], matrix: Path, *, watch: Watch, device: str = "cpu"
) -> Iterator[cells.Status]:
    """Run the cells one after the other, leaving out those that are done or that another process runs.

    A cell that fails does not stop the others; what went wrong is kept in its folder, and it is tried again next time.

    Args:
        plans: The cells.
        matrix: Folder of the matrix; cells that it holds already go on where they stopped.
        watch: Shows the progress of a cell.
        device: Torch device of the learner.

    Yields:
        What became of each cell.

    Raises:
        ConfigError: A cell exists with other settings.
        KeyboardInterrupt: Ctrl-C; the running cell has stopped at a checkpoint.
    """
    cells.create(plans, matrix)
    for number, plan in enumerate(plans):
        folder = plan.cell.folder(matrix)
        with hold(folder) as ours:
            if ours:
                cells.clear_temporaries(folder)
            if ours and not (folder / cells.RESULT).is_file():
                (folder / cells.FAILURE).unlink(missing_ok=True)
                try:
                    with watch(plan, number) as progress:
                        _train(plan, folder / cells.RUN, device, progress)
                        _evaluate(plan, folder)
                except Exception as error:
                    _record_failure(folder, error)
        yield cells.read_cell(folder)


def _train(plan: MatrixPlan, run: Path, device: str, progress: Callable[[Progress], None]) -> None:
    """Train to the end of the budget, from the last checkpoint where there is one."""
    marker = run.parent / cells.TRAINING
    if marker.is_file():
        return
    if (run / "config.json").is_file():
        summary = trainer.resume(run, encoder=plan.config.text.encoder, progress=progress)
    else:
        bodies = plan.bodies
        watched = bodies.validation if plan.config.trainer.evaluate_steps else ()
        summary = trainer.train(
            (*bodies.train, *bodies.cut, *watched),
            run,
            plan.config,
            validation=[each.name for each in watched],
            seed=plan.cell.seed,
            minutes=plan.minutes,
            steps=plan.steps,
            device=device,
            progress=progress,
        )
    if summary.interrupted:
        raise KeyboardInterrupt
    about = {"steps": summary.steps, "updates": summary.updates, "elapsed_s": round(summary.elapsed_s, 3)}
    write_text(marker, json.dumps(about, indent=1) + "\n", durable=True)


def _evaluate(plan: MatrixPlan, folder: Path) -> None:
    """Evaluate without noise and write the result; held-out robots are met here, once, and never under validation."""
    roles = {"train": plan.bodies.train, "validation": plan.bodies.validation}
    if not plan.validate:
        roles["test"] = plan.bodies.test
    run, rows = folder / cells.RUN, []
    for role, bodies in roles.items():
        seed = EVALUATION_SEED + plan.cell.seed
        encoder = plan.config.text.encoder
        for found in evaluate(run, bodies, episodes=plan.episodes, seed=seed, encoder=encoder) if bodies else ():
            rows.append({"robot": found.robot, "role": role, **_row(found)})
    metrics = read_metrics(run)
    last = metrics[-1] if metrics else {}
    values = {
        "format_version": cells.FORMAT_VERSION,
        "evaluated": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        **schema.read(folder / cells.TRAINING, cell_schema.CellTraining),
        "real_steps": last.get("real_steps", last.get("steps")),
        "diverged": last.get("diverged"),
        "training_return": final_training_return(metrics, plan.steps),
        "robots": rows,
    }
    write_text(folder / cells.RESULT, json.dumps(values, indent=1) + "\n", durable=True)


def final_training_return(metrics: Sequence[dict[str, Any]], budget: int | None = None) -> float | None:
    """Mean return of training episodes, with exploration noise, over the last 5 % of the steps; None before any.

    Args:
        metrics: All rows.
        budget: Steps that the run was to do. With it, the first row of each hundredth of it counts, and the mean does
            not depend on how fast the run went.
    """
    if not metrics:
        return None
    begin = (1 - FINAL_SHARE) * metrics[-1]["steps"]
    firsts = {hundredth(row["steps"], budget): row for row in reversed(metrics)}
    rows = metrics if budget is None else firsts.values()
    values = [row["return_mean"] for row in rows if row["steps"] >= begin and row.get("return_mean") is not None]
    return float(np.mean(values)) if values else None


def _row(found: RobotResult) -> dict[str, Any]:
    return {
        "mean": found.mean,
        "returns": list(found.returns),
        "lengths": list(found.lengths),
        "random_mean": found.random_mean,
        "expert_return": found.expert_return,
    }


def _record_failure(folder: Path, error: Exception) -> None:
    kind = "" if isinstance(error, MorphkitError) else f"{type(error).__name__}: "
    values = {"message": f"{kind}{error}", "traceback": traceback.format_exc()}
    try:
        write_text(folder / cells.FAILURE, json.dumps(values, indent=1) + "\n", durable=True)
    except OSError:
        raise error from None
