"""A cell that was killed ends as one that nobody disturbed, whenever the kill came and however fast it went."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from morphkit.registry import load
from morphkit_rl.benchmark import cells, runner
from morphkit_rl.benchmark.bodies import Bodies
from morphkit_rl.benchmark.cells import Cell, MatrixPlan
from morphkit_rl.runs import metrics_log
from morphkit_rl.runs.metrics_log import read_metrics
from morphkit_rl.training.session import Session
from morphkit_rl.training.trainer import Progress
from tests.support.run_folders import small_config

STEPS, EARLIER = 240, 200
CELL = Cell("few", "few", "limb-former", 0)


def plan(*overrides: str, steps: int = STEPS) -> MatrixPlan:
    config = small_config("trainer.start_steps=220", "trainer.checkpoint_seconds=0", *overrides)
    bodies = Bodies((load("hopper_3"),), (), (load("hopper_4"),))
    return MatrixPlan(CELL, bodies, config, steps, None, 1, validate=False)


@contextmanager
def unwatched(_: MatrixPlan, __: int) -> Iterator[Callable[[Progress], None]]:
    yield lambda _: None


def finish(matrix: Path, *overrides: str, steps: int = STEPS) -> dict[str, Any]:
    """Run the cell to its end; what it holds then, but for what the clock said."""
    (status,) = runner.run_matrix([plan(*overrides, steps=steps)], matrix, watch=unwatched)
    assert status.state == "done", status.detail
    run = CELL.folder(matrix) / cells.RUN
    result = {key: value for key, value in (status.result or {}).items() if key not in ("evaluated", "elapsed_s")}
    files = [path for part in ("checkpoints", "replay") for path in (run / part).rglob("*.safetensors")]
    held = sorted((path.name, hashlib.sha256(path.read_bytes()).hexdigest()) for path in files)
    return {"result": result, "files": held}


@pytest.fixture
def few_checkpoints(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of each run one at the steps `EARLIER`, and one at its end."""
    save, saved = Session.save, set[tuple[Path, int]]()

    def sometimes(self: Session, run: Path, elapsed_s: float, *, best: bool = False) -> None:
        moment = run, self.collector.steps
        if moment[1] in (EARLIER, STEPS) and moment not in saved:
            saved.add(moment)
            save(self, run, elapsed_s, best=best)

    monkeypatch.setattr(Session, "save", sometimes)


@pytest.mark.usefixtures("few_checkpoints")
def test_a_cell_ends_the_same_wherever_it_is_killed_around_its_last_checkpoint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    matrix, moments = tmp_path / "matrix", dict[frozenset[tuple[Path, bytes | bool]], Path]()

    def remember() -> None:
        """Keep what a kill would leave at this moment, from the last checkpoint on."""
        run = CELL.folder(matrix) / cells.RUN
        if any(path.name.startswith(f"step-{STEPS:012d}") for path in run.glob("checkpoints/step-*")):
            paths = [path for path in matrix.rglob("*") if path.parent.suffix != ".tmp"]
            held = frozenset((path.relative_to(matrix), path.is_file() and path.read_bytes()) for path in paths)
            if held not in moments:
                moments[held] = shutil.copytree(matrix, tmp_path / f"killed-{len(moments)}")

    def watched(function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **options: Any) -> Any:
            result = function(*arguments, **options)
            remember()
            return result

        return call

    with monkeypatch.context() as patch:
        for owner, names in ((Path, ("rename", "replace")), (shutil, ("rmtree",)), (metrics_log, ("append_plain",))):
            for name in names:
                patch.setattr(owner, name, watched(getattr(owner, name)))
        whole = finish(matrix)
    assert whole["result"]["training_return"] is not None
    assert len(moments) > 4
    for moment in moments.values():
        assert finish(moment) == whole, moment
        assert [path for path in moment.rglob(".*") if path.name != ".lock"] == []


def test_the_training_return_of_a_cell_does_not_depend_on_when_rows_were_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runner, "FINAL_SHARE", 0.5)
    unlearned = ("trainer.num_envs=8", "trainer.start_steps=1920", "trainer.checkpoint_seconds=1000")
    often, rarely = (
        finish(tmp_path / seconds, f"trainer.log_seconds={seconds}", *unlearned, steps=1920)
        for seconds in ("0.0001", "1000")
    )
    rows = read_metrics(CELL.folder(tmp_path / "0.0001") / cells.RUN)
    late = [row["return_mean"] for row in rows if row["steps"] >= 960]
    assert None not in late
    assert len(set(late)) > 2, "else any row would do"
    assert often == rarely


def test_the_training_return_takes_one_row_of_each_hundredth_of_the_steps() -> None:
    rows = [{"steps": steps, "return_mean": float(steps)} for steps in (900, 950, 953, 957, 960, 990, 1003)]
    assert runner.final_training_return([], 1000) is None
    assert runner.final_training_return(rows, 1000) == pytest.approx((960 + 990 + 1003) / 3)
    assert runner.final_training_return(rows) == pytest.approx((953 + 957 + 960 + 990 + 1003) / 5)
