"""Run folders with something wrong: damaged files, foreign state with right digests, and links that lead out."""

from __future__ import annotations

import contextlib
import json
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
from hypothesis import strategies as st

from morphkit.errors import MorphkitError, TrainingError
from morphkit.registry import load
from morphkit_rl.algorithms.policy import Policy
from morphkit_rl.evaluation.evaluate import evaluate
from morphkit_rl.runs import checkpoint, schema
from morphkit_rl.runs.metrics_log import read_metrics
from morphkit_rl.training.trainer import resume, train
from tests.fuzz.damage import cases, damaged, plain_files
from tests.support.run_folders import small_config

UNBROKEN = b'{"changes": [], "signed": false}'


def examples() -> st.SearchStrategy[dict[str, bytes]]:
    """A file that lists changes."""
    attempt_run(UNBROKEN)  # so that what is loaded and made once is not counted
    return cases().map(lambda source: {"run.json": source})


def attempt(files: dict[str, bytes], folder: Path) -> str:
    """How far the changed run got."""
    return attempt_run(files["run.json"])


def attempt_run(source: bytes) -> str:
    """Load, evaluate and resume a broken run; nothing outside of it may change."""
    case = json.loads(source)
    with _quiet(), damaged(_whole_run(), case["changes"]) as run:
        if case["signed"]:
            with contextlib.suppress(OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
                _sign(run)
        return _use(run)


def _use(run: Path) -> str:
    """Use a run in every way; each has to end well or with an error that says something."""
    refused = 0
    for use in (lambda: _evaluate(run), lambda: read_metrics(run), lambda: resume(run, steps=_steps(run) + 8)):
        try:
            use()
        except MorphkitError as error:
            if not str(error).strip():
                raise AssertionError("an error without words") from error
            refused += not isinstance(error, TrainingError)  # a learner that a stranger made diverge
    return ("used", "refused in part", "refused in part", "refused")[refused]


def _evaluate(run: Path) -> None:
    policy = Policy.load(run)
    assert policy.trained_on
    (result,) = evaluate(run, [load("hopper_3")], episodes=1)
    assert np.isfinite(result.returns).all()


def _steps(run: Path) -> int:
    with contextlib.suppress(MorphkitError):
        return int(checkpoint.load_state(run)[1]["steps"])
    return 20


@cache
def _whole_run() -> Path:
    run = Path(tempfile.mkdtemp()) / "run"
    options = ("trainer.evaluate_steps=16", "trainer.evaluate_episodes=1")
    train([load("hopper_3")], run, small_config(*options), steps=20)
    (run / "owner.json").write_text('{"pid": 1, "host": "a", "since": 0.0}')
    return run


def _sign(run: Path) -> None:
    """Make the digests right, as somebody does who makes a run to deceive."""
    plain = plain_files(run)  # a pipe would be waited for
    latest = run / "checkpoints" / "latest"
    folder = latest.parent / latest.read_text().strip() if latest in plain else latest
    if folder / "state.json" not in plain:
        return
    state = json.loads((folder / "state.json").read_text())
    arrays = [path for path in plain if path.parent == folder and path.suffix == ".safetensors"]
    state["files"] = {path.name: checkpoint.describe(path) for path in arrays}
    for segment in state["segments"]:
        if run / "replay" / segment["file"] in plain:
            segment.update(checkpoint.describe(run / "replay" / segment["file"]))
    state["sha256"] = schema.digest(state)
    (folder / "state.json").write_text(json.dumps(state))


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    with np.errstate(all="ignore"):
        yield
