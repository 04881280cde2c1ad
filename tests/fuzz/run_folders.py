"""Run folders with something wrong: damaged files, foreign state with right digests, and links that lead out.

A case is JSON: a list of changes to a small run, whose places are numbers, so that hypothesis can make them small.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st
from safetensors.numpy import load_file, save_file

from morphkit.errors import MorphkitError, TrainingError
from morphkit.registry import load
from morphkit_rl.algorithms.policy import Policy
from morphkit_rl.evaluation.evaluate import evaluate
from morphkit_rl.runs import checkpoint, schema
from morphkit_rl.runs.metrics_log import read_metrics
from morphkit_rl.training.trainer import resume, train
from tests.support.run_folders import small_config

TEXTS = (
    b"", b"{}", b"[]", b"5", b"null", b"NaN", b"\xff\xfe", b"\0" * 64, b"[" * 100_000, b'{"a":' * 5000, b"9" * 5000,
    b"../../treasure", b"/etc/passwd", b"step-000000000001-0000000001", b'{"steps": 1}',
    b'{"steps": "a", "updates": []}\n',
)  # fmt: skip
VALUES: tuple[Any, ...] = (
    None, True, -1, 0, 1, 2**31, 2**63, 2**64, 2**130, 10**400, 0.5, -0.5, float("nan"), float("inf"), -float("inf"),
    "", "a", "\ud800", "\x1b[31m", "../../treasure/a", "/etc/passwd", "nan", "cuda:99", "x" * 5000, [], {}, [[]],
    [None], {"a": 1}, [1, "a", None], "minilm", "somebody/model", "rounds", "float16", "bfloat16",
)  # fmt: skip
ARRAYS = ("nan", "inf", "negative", "huge", "empty", "flat", "more", "float64", "int64", "uint8", "drop", "rename")
LINKS = ("link", "dangling", "hard link", "pipe", "folder", "remove")

UNBROKEN = b'{"changes": [], "signed": false}'

place = st.integers(0, 10**6)
changes = st.one_of(
    st.tuples(st.just("flip"), place, place, st.integers(0, 7)),
    st.tuples(st.just("cut"), place, place),
    st.tuples(st.just("text"), place, st.integers(0, len(TEXTS) - 1)),
    st.tuples(st.just("json"), place, place, st.integers(0, len(VALUES) - 1), st.sampled_from(("set", "drop", "add"))),
    st.tuples(st.just("json"), place, place, st.integers(0, len(VALUES) - 1), st.sampled_from(("set", "drop", "add"))),
    st.tuples(st.just("array"), place, place, st.sampled_from(ARRAYS)),
    st.tuples(st.just("array"), place, place, st.sampled_from(ARRAYS)),
    st.tuples(st.just("place"), place, st.sampled_from(LINKS)),
)


def examples() -> st.SearchStrategy[dict[str, bytes]]:
    """A file that lists changes."""
    attempt_run(UNBROKEN)  # so that what is loaded and made once is not counted
    return broken_runs().map(lambda source: {"run.json": source})


def attempt(files: dict[str, bytes], folder: Path) -> str:
    """How far the changed run got."""
    return attempt_run(files["run.json"])


@st.composite
def broken_runs(draw: st.DrawFn) -> bytes:
    """One to three changes to a run folder, and whether its digests are made right again afterwards."""
    made = draw(st.lists(changes, min_size=1, max_size=3))
    return json.dumps({"changes": made, "signed": draw(st.booleans())}).encode()


def attempt_run(source: bytes) -> str:
    """Load, evaluate and resume a broken run; nothing outside of it may change."""
    case = json.loads(source)
    with tempfile.TemporaryDirectory() as top, _quiet():
        run, treasure = Path(top) / "run", Path(top) / "treasure"
        shutil.copytree(_whole_run(), run)
        (treasure / "step-000000000001-0000000001").mkdir(parents=True)
        for name in ("a", "step-000000000001-0000000001/a", "sweeps-0000000000-0000000001.safetensors"):
            (treasure / name).write_text("mine")
        for change in case["changes"]:
            _change(run, treasure, *change)
        if case["signed"]:
            with contextlib.suppress(OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
                _sign(run)
        before = {str(path): path.read_bytes() for path in treasure.rglob("*") if path.is_file()}
        try:
            return _use(run)
        finally:
            assert {str(path): path.read_bytes() for path in treasure.rglob("*") if path.is_file()} == before


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


def _files(run: Path) -> list[Path]:
    found = sorted(path for path in run.rglob("*") if path.is_file() and not path.is_symlink())
    return [path for path in found if "tensorboard" not in path.parts]


def _change(run: Path, treasure: Path, how: str, where: int, *rest: Any) -> None:
    files = _files(run)
    if how == "json":
        files = [path for path in files if path.suffix in (".json", ".jsonl")]
    if how == "array":
        files = [path for path in files if path.suffix == ".safetensors"]
    if how == "place":
        files = sorted(path for path in run.rglob("*") if not path.is_symlink())
    if not files:
        return
    path = files[where % len(files)]
    with contextlib.suppress(ValueError, TypeError, RecursionError, OverflowError):
        {"flip": _flip, "cut": _cut, "text": _text, "json": _json, "array": _array}.get(how, _place)(
            path, *([treasure] if how == "place" else []), *rest
        )


def _flip(path: Path, at: int, bit: int) -> None:
    content = bytearray(path.read_bytes())
    if content:
        content[at % len(content)] ^= 1 << bit
        path.write_bytes(content)


def _cut(path: Path, at: int) -> None:
    content = path.read_bytes()
    path.write_bytes(content[: at % (len(content) + 1)])


def _text(path: Path, number: int) -> None:
    path.write_bytes(TEXTS[number])


def _json(path: Path, at: int, number: int, how: str) -> None:
    values = json.loads(path.read_text().splitlines()[0] if path.suffix == ".jsonl" else path.read_text())
    nodes = list(_nodes(values))
    if not nodes:
        return
    holder, key = nodes[at % len(nodes)]
    if how == "set":
        holder[key] = VALUES[number]
    elif how == "drop":
        del holder[key]
    elif isinstance(holder, dict):
        holder["added"] = VALUES[number]
    else:
        holder.append(VALUES[number])
    path.write_text(json.dumps(values) + "\n")


def _nodes(values: Any) -> Iterator[tuple[Any, Any]]:
    pairs = values.items() if isinstance(values, dict) else enumerate(values) if isinstance(values, list) else ()
    for key, value in list(pairs):
        yield values, key
        yield from _nodes(value)


def _array(path: Path, at: int, how: str) -> None:
    arrays = load_file(path)
    names = sorted(arrays)
    if not names:
        return
    name = names[at % len(names)]
    array = arrays.pop(name)
    fill = {"nan": np.nan, "inf": np.inf, "negative": -1, "huge": 3e38 if array.dtype.kind == "f" else 100}
    if how in fill and (array.dtype.kind == "f" or how in ("negative", "huge")):
        arrays[name] = np.full_like(array, fill[how]) if array.dtype.kind != "u" else array[::-1].copy()
    elif how in ("float64", "int64", "uint8"):
        arrays[name] = np.nan_to_num(array).astype(how)
    elif how == "rename":
        arrays[f"{name}x"] = array
    elif how != "drop":
        arrays[name] = {"empty": array[:0], "flat": array.ravel()[:1], "more": np.concatenate([array, array])}.get(
            how, array
        )
    save_file({key: np.ascontiguousarray(each) for key, each in arrays.items()}, path)


def _place(path: Path, treasure: Path, how: str) -> None:
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    if how == "link":
        path.symlink_to(treasure)
    elif how == "dangling":
        path.symlink_to(treasure / "none")
    elif how == "hard link":
        path.hardlink_to(treasure / "a")
    elif how == "pipe":
        os.mkfifo(path)
    elif how == "folder":
        path.mkdir()


def _sign(run: Path) -> None:
    """Make the digests right, as somebody does who makes a run to deceive."""
    plain = _files(run)  # a pipe would be waited for
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
