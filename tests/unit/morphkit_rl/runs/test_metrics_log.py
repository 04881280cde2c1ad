"""Rows of metrics in a run folder."""

from __future__ import annotations

from pathlib import Path

import pytest

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
