"""Rows of metrics in a run folder."""

from __future__ import annotations

from pathlib import Path

import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from morphkit.errors import OutputError
from morphkit_rl.runs.metrics_log import MetricsLog, read_metrics

ROW = {"steps": 8, "updates": 2, "returns": {"hopper": 1.5}}


def test_rows_after_the_resumed_step_are_dropped(tmp_path: Path) -> None:
    log = MetricsLog(tmp_path, 0, 0)
    for number in (1, 2):
        log.write({**ROW, "steps": 8 * number, "updates": 2 * number})
    log.close()
    MetricsLog(tmp_path, 8, 2).close()
    assert read_metrics(tmp_path) == [ROW]


def test_metrics_that_cannot_be_written_are_named(tmp_path: Path) -> None:
    log = MetricsLog(tmp_path, 0, 0)
    log.path.unlink()
    log.path.mkdir()
    with pytest.raises(OutputError, match=f"{tmp_path}: cannot write metrics: Is a directory"):
        log.write(ROW)
    log.close()


def test_tensorboard_has_returns_by_body_and_their_mean(tmp_path: Path) -> None:
    first = {"steps": 4, "updates": 1, "returns": {}, "first_return_mean": 2.0, "first_returns": {"a": 1.0, "b": 3.0}}
    whole = {"steps": 8, "updates": 2, "critic_loss": 0.5, "return_mean": 3.5, "returns": {"a": 3.0, "b": 4.0}}
    evaluated = {"steps": 9, "updates": 2, "returns": {}, "evaluation": {"a": {"mean": 5.0, "score": None}}}
    log = MetricsLog(tmp_path, 0, 0)
    for row in (first, whole, evaluated):
        log.write(row)
    log.close()
    events = EventAccumulator(str(tmp_path / "tensorboard")).Reload()
    points = {tag: [(e.step, e.value) for e in events.Scalars(tag)] for tag in events.Tags()["scalars"]}
    assert points == {
        **{"first_return/a": [(4, 1.0)], "first_return/b": [(4, 3.0)], "first_return/mean": [(4, 2.0)]},
        **{"return/a": [(8, 3.0)], "return/b": [(8, 4.0)], "return/mean": [(8, 3.5)]},
        **{"critic_loss": [(8, 0.5)], "evaluation/a": [(9, 5.0)], "updates": [(4, 1.0), (8, 2.0), (9, 2.0)]},
    }
