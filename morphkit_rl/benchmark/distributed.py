"""Cells of a matrix as Ray tasks."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any

from morphkit.errors import ConfigError
from morphkit_rl.benchmark import cells
from morphkit_rl.benchmark.cells import Cell, MatrixPlan
from morphkit_rl.benchmark.definition import load_benchmark
from morphkit_rl.benchmark.planning import plan_matrix
from morphkit_rl.benchmark.runner import run_matrix
from morphkit_rl.runs.lock import hold
from morphkit_rl.training.cluster.jobs import Resources, run_jobs
from morphkit_rl.training.cluster.storage import Storage
from morphkit_rl.training.progress import Progress

LATEST = f"{cells.RUN}/checkpoints/latest"
"""Says which checkpoint a run goes on from."""

_WAIT_S = 60.0
"""How long a cell may still be held by a process of a node that was lost."""
_LIGHT = (cells.CELL, cells.TRAINING, cells.RESULT, cells.FAILURE, f"{cells.RUN}/metrics.jsonl")
"""What tells how far a cell is."""


@dataclass(frozen=True, slots=True)
class Request:
    """What a matrix was asked for, so that a node can plan any of its cells.

    Attributes:
        file: TOML file with tasks and splits, in addition to the published ones.
        options: Keywords of `plan_matrix`, but for which cells.
        matrix: Folder of the matrix, the same disk on every node where there is no storage.
        storage: fsspec address through which nodes that share no disk hand on their cells.
        device: Torch device of the learner.
    """

    file: Path | None
    options: dict[str, Any]
    matrix: Path
    storage: str | None
    device: str

    def plan(self, cell: Cell) -> MatrixPlan:
        """Plan one cell, from the files of the node that this runs on."""
        return plan_matrix(
            load_benchmark(self.file),
            tasks=[cell.task],
            splits=[cell.split],
            methods=[cell.method],
            seeds=cell.seed + 1,
            **self.options,
        )[-1]


def run_on_cluster(
    ray: ModuleType, plans: Sequence[MatrixPlan], request: Request, resources: Resources
) -> Iterator[cells.Status]:
    """Run cells as Ray tasks, leaving out those that are done; a cell whose node is lost goes on on another one.

    Args:
        ray: What `connected` gave.
        plans: The cells.
        request: What they were planned from.
        resources: What each cell needs of a node.

    Yields:
        What became of each cell, in the order in which they end.

    Raises:
        ConfigError: A cell exists with other settings, or the storage cannot be used.
        KeyboardInterrupt: Ctrl-C; cells that ran have stopped at checkpoints.
    """
    cells.create(plans, request.matrix)
    folders = [plan.cell.folder(request.matrix) for plan in plans]
    yield from (cells.read_cell(folder) for folder in folders if (folder / cells.RESULT).is_file())
    todo = [plan.cell for plan in plans if not (plan.cell.folder(request.matrix) / cells.RESULT).is_file()]
    orders = [(request, cell) for cell in todo]
    if request.storage is None:
        for outcome in run_jobs(ray, _work, orders, resources):
            found = cells.read_cell(todo[outcome.number].folder(request.matrix))
            yield replace(found, state="failed", detail=outcome.error) if outcome.error else found
        return
    storage = Storage(request.storage)

    def fetch() -> None:
        for cell in todo:
            storage.pull(key(cell), cell.folder(request.matrix), _LIGHT.__contains__)

    with ExitStack() as held:
        for cell in todo:  # what nodes do elsewhere shows as ours here
            folder = cell.folder(request.matrix)
            held.enter_context(hold(folder))
            if not storage.holds(key(cell)):
                storage.push(folder, key(cell), last=[LATEST])
        for outcome in run_jobs(ray, _work, orders, resources, fetch):
            cell = todo[outcome.number]
            storage.pull(key(cell), cell.folder(request.matrix))
            found = cells.read_cell(cell.folder(request.matrix))
            error = outcome.error or (found.result is None and "it has no result") or ""
            yield replace(found, state="failed" if error else "done", detail=error)


def key(cell: Cell) -> str:
    """Where a cell is in a storage."""
    return cell.folder(Path()).as_posix()


def _work(order: tuple[Request, Cell]) -> None:
    """On a node: run one cell, or go on with it."""
    request, cell = order
    plan = request.plan(cell)
    if request.storage is None:
        _run(plan, request.matrix, request.device, _Unwatched())
        return
    storage = Storage(request.storage)
    with tempfile.TemporaryDirectory(prefix="morphkit-cell-") as scratch:
        folder = cell.folder(Path(scratch))
        storage.pull(key(cell), folder)
        try:
            _run(plan, Path(scratch), request.device, _Pushes(storage, folder, key(cell)))
        finally:
            storage.push(folder, key(cell), last=[LATEST, cells.TRAINING, cells.RESULT])


def _run(plan: MatrixPlan, matrix: Path, device: str, seen: Callable[[Progress], None]) -> None:
    @contextmanager
    def watch(_plan: MatrixPlan, _number: int) -> Iterator[Callable[[Progress], None]]:
        yield seen

    deadline = time.monotonic() + _WAIT_S
    while True:
        found = next(run_matrix([plan], matrix, watch=watch, device=device))
        if found.state != "running":
            return
        if time.monotonic() > deadline:
            raise ConfigError(f"{found.folder}: {found.detail} is at work there")
        time.sleep(1)


class _Unwatched:
    def __call__(self, progress: Progress) -> None:
        pass


class _Pushes:
    """Stores a cell whenever training shows progress and there is a newer checkpoint.

    Progress is shown by the thread that trains, so that no file changes meanwhile.
    """

    def __init__(self, storage: Storage, folder: Path, key: str):
        self._storage, self._folder, self._key, self._latest = storage, folder, key, ""

    def __call__(self, progress: Progress) -> None:
        path = self._folder / LATEST
        latest = path.read_text("utf-8") if path.is_file() else ""
        if latest != self._latest:
            self._storage.push(self._folder, self._key, last=[LATEST])
            self._latest = latest
