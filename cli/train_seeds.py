"""`morphkit train --seeds`: the same command for several seeds, one after the other or as tasks of a Ray cluster."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import typer

from morphkit.utils.printable import one_line

from . import common
from .terminal import note

_OF_A_RESUMED_RUN = ("minutes", "steps", "encoder", "quiet")


def train_seeds(train: Callable[..., None], given: Mapping[str, Any], seeds: int, ray: str | None, cpus: float) -> None:
    """Train a policy a seed; runs that have begun go on.

    Args:
        train: The command for one seed.
        given: Its arguments by name.
        seeds: How many.
        ray: Address of the cluster; None trains here.
        cpus: Cores of a node that each run takes.

    Raises:
        Exit: A run failed on the cluster.
    """
    if given["as_json"] or given["resume"]:
        raise common.UsageError("--seeds goes without --json, and goes on by itself without --resume.")
    first = given["seed"] or 0
    orders = [_of_seed(given, seed) for seed in range(first, first + seeds)]
    if ray is None:
        for order in orders:
            train(**order)
        return

    from morphkit_rl.training.cluster.connection import connected
    from morphkit_rl.training.cluster.jobs import Resources, run_jobs

    failed = False
    gpus = int((given["device"] or "cpu").startswith("cuda"))
    with connected(ray) as module:
        for outcome in run_jobs(module, _call, [(train, _anywhere(order)) for order in orders], Resources(cpus, gpus)):
            failed |= bool(outcome.error)
            run = one_line(str(orders[outcome.number]["run"]))
            if outcome.error or not given["quiet"]:
                note(f"{run}: {one_line(outcome.error) or 'done'}")
    if failed:
        raise typer.Exit(1)


def _of_seed(given: Mapping[str, Any], seed: int) -> dict[str, Any]:
    run = given["run"] / f"seed-{seed}"
    if (run / "config.json").is_file():
        return {"run": run, "resume": True, **{name: given[name] for name in _OF_A_RESUMED_RUN}}
    return {**given, "run": run, "seed": seed}


def _anywhere(order: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments that mean the same in any working directory; words that are no paths here stay names."""

    def absolute(word: Any) -> Any:
        if isinstance(word, list):
            return [absolute(each) for each in word]
        return str(Path(word).resolve()) if isinstance(word, str) and Path(word).exists() else word

    paths = {name: absolute(order[name]) for name in ("robots", "preset", "task", "start") if name in order}
    return {**order, **paths, "run": order["run"].resolve(), "quiet": True}


def _call(order: tuple[Callable[..., None], Mapping[str, Any]]) -> None:
    """On a node: train one seed."""
    train, arguments = order
    train(**arguments)
