"""Metrics of a run: JSON lines for programs, and a tracker, such as TensorBoard, for people."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from morphkit.errors import CheckpointError, OutputError
from morphkit.utils.atomic_write import write_text
from morphkit.utils.plain_files import append_plain, read_plain, require_plain
from morphkit_rl.runs import run_folder, trackers
from morphkit_rl.runs.run_folder import METRICS
from morphkit_rl.runs.schema import Row, parse


def read_metrics(run: Path) -> list[dict[str, Any]]:
    """Rows of `metrics.jsonl`, oldest first; a last row that was cut short is left out.

    Raises:
        CheckpointError: Another row is damaged, or the run folder holds links.
    """
    require_plain(run, CheckpointError)
    path = run / METRICS
    try:
        lines = read_plain(path).split(b"\n") if path.exists() else [b""]
    except OSError as error:
        raise CheckpointError(f"{path}: cannot be read: {error.strerror}") from None
    rows = [parse(line, Row, f"{path}:{number}") for number, line in enumerate(lines[:-1], 1)]
    with suppress(CheckpointError):
        rows.append(parse(lines[-1], Row, str(path)))
    return rows


class MetricsLog:
    """Appends to `metrics.jsonl` and to a tracker; rows from after the given moment are dropped first.

    Args:
        run: The run folder.
        steps: Environment steps that the run starts from.
        updates: Updates that the run starts from.
        service: The tracker.

    Raises:
        CheckpointError: The rows that there are cannot be read.
        OutputError: The folder cannot be written, or the tracker not be reached; of a run that just begins, nothing is
            left then.
    """

    def __init__(self, run: Path, steps: int, updates: int, service: trackers.Service = "tensorboard"):
        self._service: trackers.Service = service
        self.path = run / METRICS
        fresh = not self.path.exists()
        kept = [row for row in read_metrics(run) if row["steps"] <= steps and row["updates"] <= updates]
        self._last = _moment(kept[-1]) if kept else None
        write_text(self.path, "".join(json.dumps(row) + "\n" for row in kept), durable=True)
        try:
            with self._named_errors():
                self.tracker = trackers.open_tracker(run, service, steps)
        except OutputError:
            if fresh:
                run_folder.remove_new(run)
            raise

    def write(self, row: Mapping[str, Any]) -> None:
        """Append one row; numbers become points of curves, `returns` and `evaluation` some a robot.

        A row of the same steps and updates as the one before adds nothing, unless it holds an evaluation.

        Raises:
            OutputError: The disk is full or the folder cannot be written.
        """
        if _moment(row) == self._last and "evaluation" not in row:
            return
        self._last = _moment(row)
        with self._named_errors():
            append_plain(self.path, json.dumps(row) + "\n")
            self.tracker.scalars(scalars(row), row["steps"])

    def finish(self, returns: Mapping[str, float], steps: int) -> None:
        """Show the training returns that a run ends with; raises as `write`."""
        with self._named_errors():
            rows = [(robot, round(value, 1)) for robot, value in returns.items()]
            self.tracker.table("training returns", ("body", "return"), rows, steps)

    def close(self) -> None:
        """Close the files; raises as `write`, for what was not written yet."""
        with self._named_errors():
            self.tracker.close()

    @contextmanager
    def _named_errors(self) -> Iterator[None]:
        try:
            with trackers.named_errors(self.path.parent, self._service):
                yield
        except OutputError:
            raise
        except OSError as error:
            raise OutputError(f"{self.path.parent}: cannot write metrics: {error.strerror or error}") from None


def scalars(row: Mapping[str, Any]) -> dict[str, float]:
    """The numbers of a row of metrics by tag, such as `critic_loss`, `return/mean` and `return/hopper`."""
    found = {key: value for key, value in row.items() if isinstance(value, int | float)}
    del found["steps"]
    for group in ("return", "first_return"):
        mean = found.pop(f"{group}_mean", None)
        found |= {f"{group}/{robot}": value for robot, value in row.get(f"{group}s", {}).items()}
        found |= {} if mean is None else {f"{group}/mean": mean}
    for robot, result in row.get("evaluation", {}).items():
        found[f"evaluation/{robot}"] = result["mean"]
        if result["score"] is not None:
            found[f"score/{robot}"] = result["score"]
    return found


def _moment(row: Mapping[str, Any]) -> tuple[int, int]:
    return row["steps"], row["updates"]
