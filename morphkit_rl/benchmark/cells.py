"""Cells of a matrix: one method trained on one task of one split from one seed, each in a folder of its own.

`MATRIX/SPLIT/TASK/METHOD/seed-N/` holds `cell.json`, what it is; `run/`, the run folder; `training.json` once training
is over; `result.json` once it was evaluated; `failure.json` where it failed.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from morphkit.description import Description
from morphkit.errors import CheckpointError, ConfigError, OutputError
from morphkit.utils.atomic_write import write_text
from morphkit.utils.plain_files import require_plain
from morphkit_rl.benchmark import cell_schema
from morphkit_rl.benchmark.bodies import Bodies
from morphkit_rl.config.train_config import TrainConfig
from morphkit_rl.runs import run_folder, schema
from morphkit_rl.runs.lock import OWNER, locked, owner
from morphkit_rl.runs.metrics_log import read_metrics

FORMAT_VERSION = 1
CELL, RUN, TRAINING, RESULT, FAILURE = "cell.json", "run", "training.json", "result.json", "failure.json"

_EVERY_CELL = f"*/*/*/seed-*/{CELL}"
_KINDS = {True: "hold out validation robots, for choosing anything", False: "meet the test set"}

State = Literal["done", "running", "failed", "stopped", "not started"]


@dataclass(frozen=True, slots=True, order=True)
class Cell:
    """A cell's place in the matrix."""

    split: str
    task: str
    method: str
    seed: int

    def folder(self, matrix: Path) -> Path:
        """Its folder."""
        return matrix / self.split / self.task / self.method / f"seed-{self.seed}"

    def __str__(self) -> str:
        return f"split {self.split}, {self.task}, {self.method}, seed {self.seed}"


@dataclass(frozen=True, slots=True)
class MatrixPlan:
    """All that determines a cell.

    Attributes:
        cell: Its place.
        bodies: Training, validation and held-out robots.
        config: Settings of training.
        steps: Budget of counted environment steps; None for none.
        minutes: Budget of training time; None for none.
        episodes: Noise-free episodes a robot at the end.
        validate: Whether validation robots are evaluated and held-out ones left alone.
    """

    cell: Cell
    bodies: Bodies
    config: TrainConfig
    steps: int | None
    minutes: float | None
    episodes: int
    validate: bool

    def to_json(self) -> dict[str, Any]:
        """What `cell.json` holds."""
        return {
            "format_version": FORMAT_VERSION,
            **asdict(self.cell),
            "steps": self.steps,
            "minutes": self.minutes,
            "episodes": self.episodes,
            "validate": self.validate,
            **{name: _hashes(getattr(self.bodies, name)) for name in ("train", "validation", "test", "cut")},
            "config": self.config.to_dict(),
        }


@dataclass(frozen=True, slots=True)
class Status:
    """What is known of a cell.

    Attributes:
        cell: Its place.
        folder: Its folder.
        plan: `cell.json`.
        state: `done` is trained and evaluated; `stopped` has begun and nobody works on it.
        detail: Who runs it, or why it failed or stopped.
        result: `result.json` of a cell that is done.
    """

    cell: Cell
    folder: Path
    plan: Mapping[str, Any]
    state: State
    detail: str
    result: Mapping[str, Any] | None

    @property
    def metrics(self) -> list[dict[str, Any]]:
        """Rows of metrics so far."""
        return read_metrics(self.folder / RUN)


def create(plans: Sequence[MatrixPlan], matrix: Path) -> None:
    """Write the `cell.json` of every new cell, so that what was never started is known too.

    Raises:
        ConfigError: A cell exists with other settings, or the matrix holds cells of another kind, with or without
            validation or cut bodies; nothing is written then.
        CheckpointError: A cell is damaged, or the matrix or a cell is or holds a link; nothing is written then.
        OutputError: A folder cannot be written.
    """
    fresh = []
    for path in _cell_files(matrix):
        there = read_plan(path)
        if there["validate"] not in {plan.validate for plan in plans}:
            raise ConfigError(f"{matrix}: some of its cells {_KINDS[not plans[0].validate]}; choose another --out")
        if bool(there["cut"]) not in {bool(plan.bodies.cut) for plan in plans}:
            other = "train on" if there["cut"] else "do without"
            raise ConfigError(
                f"{matrix}: some of its cells {other} bodies cut out of training robots; choose another --out"
            )
    for plan in plans:
        folder = plan.cell.folder(matrix)
        require_plain(folder, CheckpointError, top=matrix)
        values = json.loads(json.dumps(plan.to_json()))
        if not (folder / CELL).is_file():
            fresh.append((folder, values))
            continue
        difference = _difference(_with_defaults(read_plan(folder / CELL), folder / CELL), values)
        if difference:
            raise ConfigError(f"{folder}: exists with other settings ({difference}); choose another --out")
    try:
        for folder, values in fresh:
            folder.mkdir(parents=True, exist_ok=True)
            with locked(folder):  # against a second process that was started at the same time
                write_text(folder / CELL, json.dumps(values, indent=1) + "\n", durable=True)
    except OSError as error:
        raise OutputError(f"{error.filename or matrix}: cannot be written: {error.strerror}") from None


def clear_temporaries(folder: Path) -> None:
    """Remove the temporary files that a killed process left in the folder of a cell, which has to be held."""
    run_folder.clear_temporaries(folder, (CELL, TRAINING, RESULT, FAILURE, OWNER))


def read_matrix(matrix: Path) -> list[Status]:
    """Find the cells of a matrix, in the order of split, task, method and seed.

    Raises:
        CheckpointError: There is none, one is damaged, or the matrix or a cell is or holds a link.
    """
    found = _cell_files(matrix)
    if not found:
        reason = "holds no cells of a benchmark" if matrix.is_dir() else "no such folder"
        raise CheckpointError(f"{matrix}: {reason}; morphkit benchmark run --out {matrix} makes some")
    return sorted((read_cell(path.parent) for path in found), key=lambda status: status.cell)


def _cell_files(matrix: Path) -> list[Path]:
    """The `cell.json` of every cell.

    Raises:
        CheckpointError: The matrix or a cell is or holds a link.
    """
    found = sorted(matrix.glob(_EVERY_CELL))
    for path in found:
        require_plain(path.parent, CheckpointError, top=matrix)
    return found


def read_cell(folder: Path) -> Status:
    """Read what is known of one cell.

    Raises:
        CheckpointError: One of its files is damaged.
    """
    plan = read_plan(folder / CELL)
    cell = Cell(plan["split"], plan["task"], plan["method"], plan["seed"])
    if cell.folder(folder.parents[3]) != folder:
        raise CheckpointError(f"{folder / CELL}: damaged: it is of {cell}, which lies elsewhere")
    held_by, alive = owner(folder)
    result = schema.read(folder / RESULT, cell_schema.CellResult) if (folder / RESULT).is_file() else None
    state: State
    if held_by and alive:
        state, detail = "running", str(held_by)
    elif result is not None:
        state, detail = "done", ""
    elif (folder / FAILURE).is_file():
        state, detail = "failed", str(schema.read(folder / FAILURE, cell_schema.CellFailure)["message"])
    elif (folder / RUN).is_dir():
        state, detail = "stopped", f"{held_by} died" if held_by else ""
    else:
        state, detail = "not started", f"{held_by} died" if held_by else ""
    return Status(cell, folder, plan, state, detail, result)


def read_plan(path: Path) -> dict[str, Any]:
    """Read a `cell.json`.

    Raises:
        CheckpointError: It is missing or damaged.
    """
    return {"cut": {}, **schema.read(path, cell_schema.CellPlan, lacking="has no")}


def _hashes(descriptions: Iterable[Description]) -> dict[str, str]:
    return {each.name: each.sha256 for each in descriptions}


def _with_defaults(plan: dict[str, Any], path: Path) -> dict[str, Any]:
    """What `path` holds, with defaults for settings that came after it was written."""
    return {**plan, "config": TrainConfig.from_dict(plan["config"], origin=str(path)).to_dict()}


def _difference(old: Any, new: Any, where: str = "") -> str:
    """The first place where two JSON values differ: `td3.tau is 0.02, not 0.01`; empty where they are equal."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in dict.fromkeys((*old, *new)):
            found = _difference(old.get(key), new.get(key), f"{where}.{key}".removeprefix(".config").lstrip("."))
            if found:
                return found
        return ""
    return "" if old == new else f"{where} is {json.dumps(old)} there, not {json.dumps(new)}"
