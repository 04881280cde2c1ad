"""Damage to a folder: flipped bits, foreign values, and links that lead out.

Places are numbers, so that hypothesis can make them small.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st
from safetensors import SafetensorError
from safetensors.numpy import load_file, save_file

TEXTS = (
    b"", b"{}", b"[]", b"5", b"null", b"NaN", b"\xff\xfe", b"\0" * 64, b"[" * 100_000, b'{"a":' * 5000, b"9" * 5000,
    b"../../treasure", b"/etc/passwd", b"step-000000000001-0000000001", b'{"steps": 1}',
    b'{"steps": "a", "updates": []}\n',
)  # fmt: skip
VALUES: tuple[Any, ...] = (
    None, True, -1, 0, 1, 2**31, 2**63, 2**64, 2**130, 10**400, 0.5, -0.5, float("nan"), float("inf"), -float("inf"),
    "", "a", "\ud800", "\x1b[31m", "../../treasure/a", "/etc/passwd", "nan", "cuda:99", "x" * 5000, [], {}, [[]],
    [None], {"a": 1}, [1, "a", None], "minilm", "somebody/model", "rounds", "float16", "bfloat16", "\n\nerror: forged",
    "a|b\nc", "$\\frac$", "[red]", 3e38, 1e308,
)  # fmt: skip
ARRAYS = ("nan", "inf", "negative", "huge", "empty", "flat", "more", "float64", "int64", "uint8", "drop", "rename")
LINKS = ("link", "dangling", "hard link", "pipe", "folder", "remove")

place = st.integers(0, 10**6)
_values = st.tuples(
    st.just("json"), place, place, st.integers(0, len(VALUES) - 1), st.sampled_from(("set", "drop", "add"))
)
_arrays = st.tuples(st.just("array"), place, place, st.sampled_from(ARRAYS))
changes = st.one_of(
    st.tuples(st.just("flip"), place, place, st.integers(0, 7)),
    st.tuples(st.just("cut"), place, place),
    st.tuples(st.just("text"), place, st.integers(0, len(TEXTS) - 1)),
    _values,
    _values,
    _arrays,
    _arrays,
    st.tuples(st.just("place"), place, st.sampled_from(LINKS)),
)


@st.composite
def cases(draw: st.DrawFn) -> bytes:
    """One to three changes to a folder, and whether its digests are made right again afterwards, as JSON."""
    made = draw(st.lists(changes, min_size=1, max_size=3))
    return json.dumps({"changes": made, "signed": draw(st.booleans())}).encode()


@contextlib.contextmanager
def damaged(whole: Path, made: list[Any]) -> Iterator[Path]:
    """A changed copy of a folder, next to others' files, of which none may be different at the end."""
    with tempfile.TemporaryDirectory() as top:
        folder, treasure = Path(top) / "folder", Path(top) / "treasure"
        shutil.copytree(whole, folder)
        (treasure / "step-000000000001-0000000001").mkdir(parents=True)
        for name in ("a", "step-000000000001-0000000001/a", "sweeps-0000000000-0000000001.safetensors"):
            (treasure / name).write_text("mine")
        for each in made:
            _change(folder, treasure, *each)
        before = _contents(treasure)
        try:
            yield folder
        finally:
            assert _contents(treasure) == before


def plain_files(folder: Path) -> list[Path]:
    """The files in a folder that are no links, pipes or logs of TensorBoard."""
    found = sorted(path for path in folder.rglob("*") if path.is_file() and not path.is_symlink())
    return [path for path in found if "tensorboard" not in path.parts]


def _contents(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def _change(folder: Path, treasure: Path, how: str, where: int, *rest: Any) -> None:
    files = plain_files(folder)
    if how == "json":
        files = [path for path in files if path.suffix in (".json", ".jsonl")]
    if how == "array":
        files = [path for path in files if path.suffix == ".safetensors"]
    if how == "place":
        files = sorted(path for path in folder.rglob("*") if not path.is_symlink())
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
    try:
        arrays = load_file(path)
    except SafetensorError:  # an earlier change has damaged it
        return
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
