"""Run folders: crash-safe checkpoints without pickle.

A checkpoint is a folder that is written under a temporary name and renamed when it is whole; `checkpoints/latest`
names the newest, `checkpoints/best` the best. The replay that the newest needs is kept next to them, see
`replay_segments`.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load as load_bytes
from safetensors.numpy import save_file

from morphkit.errors import CheckpointError, MorphkitError, OutputError
from morphkit.utils.atomic_write import write_atomically, write_text
from morphkit.utils.plain_files import read_plain
from morphkit.utils.suggest import did_you_mean_or_list
from morphkit_rl.runs import run_folder, schema
from morphkit_rl.runs.run_folder import BEST, CHECKPOINT_NAME, CHECKPOINTS, LATEST

FORMAT_VERSION = 3
_WITHOUT_DIGESTS = 2  # the version before, which is still read
_STATE = "state.json"


@contextmanager
def writing(run: Path, keep: int = 1) -> Iterator[None]:
    """Around everything that writes a checkpoint of `run`; where that fails, what was written goes.

    Args:
        run: The run folder.
        keep: As in `save`.

    Raises:
        OutputError: The disk is full or the folder cannot be written.
    """
    try:
        yield
    except BaseException as error:
        with suppress(OSError, CheckpointError):
            clear_older(run, keep)
        if not isinstance(error, OSError) or isinstance(error, MorphkitError):
            raise
        left = "the last one is whole" if has_checkpoint(run) else "there is none yet"
        raise OutputError(f"{run}: cannot write a checkpoint: {error.strerror or error}; {left}") from None


def save(
    run: Path,
    tensors: Mapping[str, Mapping[str, np.ndarray]],
    state: Mapping[str, Any],
    *,
    keep: int = 1,
    best: bool = False,
) -> None:
    """Write a checkpoint and make it the latest; older ones go, and replay segments that it does not need.

    The best one stays whatever its age.

    To be called within `writing`, which removes what a failure leaves.

    Args:
        run: The run folder.
        tensors: One safetensors file a name.
        state: What JSON can hold; `real_steps` and `updates` name the checkpoint, `segments` lists its replay.
        keep: How many of the newest stay.
        best: Whether this one is the best so far.

    Raises:
        OSError: The disk is full or the folder cannot be written; the previous checkpoint stays.
    """
    run_folder.require_folder(run)
    folder = run / CHECKPOINTS
    name = f"step-{state['real_steps']:012d}-{state['updates']:010d}"
    kept = _kept(run, keep)
    while name in kept:
        name += "-again"  # what is kept is only ever removed once another is whole
    temporary = folder / f".{name}.tmp"
    run_folder.clear_checkpoints(run, keep=kept)
    temporary.mkdir(parents=True)
    for file, arrays in tensors.items():
        save_arrays(temporary / f"{file}.safetensors", arrays)
    files = {path.name: describe(path) for path in sorted(temporary.iterdir())}
    whole = json.loads(json.dumps({"format_version": FORMAT_VERSION, **state, "files": files}))
    whole["sha256"] = schema.digest(whole)
    text = json.dumps(whole, indent=1)
    schema.parse(text.encode(), schema.State, str(temporary / _STATE))  # what could not be read again is not written
    write_text(temporary / _STATE, text, durable=True)
    temporary.rename(folder / name)
    if best:
        write_text(folder / BEST, name + "\n", durable=True)
    write_text(folder / LATEST, name + "\n", durable=True)
    run_folder.clear_checkpoints(run, keep=_kept(run, keep))
    run_folder.clear_segments(run, keep={segment["file"] for segment in state["segments"]})


def clear_older(run: Path, keep: int = 1) -> None:
    """Remove what the latest checkpoint does not need, and what processes left that failed or were killed.

    Args:
        run: The run folder.
        keep: As in `save`.
    """
    run_folder.clear_checkpoints(run, keep=_kept(run, keep))
    run_folder.clear_segments(run, keep={segment["file"] for segment in segments(run)})


def has_checkpoint(run: Path) -> bool:
    """Whether `run` got as far as its first checkpoint."""
    return (run / CHECKPOINTS / LATEST).is_file()


def require_folder(run: Path) -> None:
    """Refuse a run whose checkpoints were deleted; one that has not written any yet is fine.

    Raises:
        CheckpointError: The folder of its checkpoints is missing.
    """
    if not (run / "checkpoints").is_dir():
        raise CheckpointError(f"{run}: there is nothing to resume from: the folder checkpoints is missing")


def load_state(run: Path, which: str = LATEST) -> tuple[Path, dict[str, Any]]:
    """Find a checkpoint and read its state.

    Args:
        run: The run folder.
        which: `latest`, `best`, or a checkpoint's name.

    Returns:
        The checkpoint's folder and its `state.json`.

    Raises:
        CheckpointError: There is none, something of it is damaged, or the run folder holds links.
    """
    folder, state = _read_state(run, which)
    for name, file in state["files"].items():
        if isinstance(file, dict):
            _check_digest(folder / name, file["sha256"], read_plain(folder / name))
    return folder, state


def _read_state(run: Path, which: str = LATEST) -> tuple[Path, dict[str, Any]]:
    """`load_state` without a look into the large files."""
    run_folder.require_folder(run)
    if not has_checkpoint(run):
        run_folder.require_run(run)
        raise CheckpointError(f"{run}: holds no checkpoint (the run was stopped before its first checkpoint)")
    folder = run / CHECKPOINTS / _name(run, which)
    place = folder / _STATE
    state = schema.read(place, schema.State)
    for name, file in state["files"].items():
        path, size = folder / name, file["size"] if isinstance(file, dict) else file
        if not path.is_file() or path.stat().st_size != size:
            found = f"{path.stat().st_size} bytes" if path.is_file() else "nothing"
            raise CheckpointError(f"{path}: cut short: expected {size} bytes, found {found}")
    if unknown := sorted({path.name for path in folder.glob("*.safetensors")} - state["files"].keys()):
        raise CheckpointError(f"{place}: damaged: it says nothing of {unknown[0]}")
    if state["format_version"] > _WITHOUT_DIGESTS and schema.digest(state) != state["sha256"]:
        raise CheckpointError(f"{place}: damaged: its content has another SHA-256 than it says")
    return folder, state


def describe(path: Path) -> dict[str, Any]:
    """Size and SHA-256 of a file, as a state holds them."""
    content = read_plain(path)
    return {"size": len(content), "sha256": hashlib.sha256(content).hexdigest()}


def _check_digest(path: Path, expected: str, content: bytes) -> None:
    if hashlib.sha256(content).hexdigest() != expected:
        raise CheckpointError(f"{path}: damaged: its SHA-256 is not the one that it was written with")


def _name(run: Path, which: str) -> str:
    """Name of the checkpoint that is the `latest` or `best`, or has this name.

    Raises:
        CheckpointError: There is none, or the file that names it is damaged.
    """
    if which not in (LATEST, BEST):
        known = run_folder.checkpoint_names(run)
        if which not in known:
            hint = did_you_mean_or_list(which, [LATEST, BEST, *known])
            raise CheckpointError(f"{run}: holds no checkpoint {which[:80]!r}{hint}")
        return which
    path = run / CHECKPOINTS / which
    if which == BEST and not path.is_file():
        raise CheckpointError(
            f"{run}: holds no best checkpoint; runs with trainer.keep=best have one from their first evaluation on"
        )
    try:
        name = read_plain(path).decode().strip()
    except (OSError, ValueError) as error:
        raise CheckpointError(f"{path}: damaged: {error}") from None
    if not CHECKPOINT_NAME.fullmatch(name):
        raise CheckpointError(f"{path}: damaged: {name[:80]!r} is no name of a checkpoint")
    return name


def _kept(run: Path, number: int) -> set[str]:
    """Names of the latest checkpoint, of some before it, and of the best one."""
    if not has_checkpoint(run):
        return set()
    latest = _name(run, LATEST)
    behind = [name for name in run_folder.checkpoint_names(run) if name < latest][::-1][: number - 1]
    best = {_name(run, BEST)} if (run / CHECKPOINTS / BEST).is_file() else set()
    return {latest, *behind, *best}


def segments(run: Path) -> list[dict[str, Any]]:
    """The replay segments of the latest checkpoint; none before the first."""
    return list(_read_state(run)[1]["segments"]) if has_checkpoint(run) else []


def check_method(folder: Path, state: Mapping[str, Any], method: str) -> None:
    """Refuse the checkpoint of another method.

    Raises:
        CheckpointError: `state` is not of `method`.
    """
    if state.get("method") != method:
        raise CheckpointError(f"{folder}: a checkpoint of method {state.get('method')!r}, but the run says {method!r}")


def load_arrays(path: Path, *, sha256: str | None = None, infinite: bool = False) -> dict[str, np.ndarray]:
    """Read one safetensors file.

    Args:
        path: The file.
        sha256: What its SHA-256 has to be; None where that was looked at.
        infinite: Whether numbers may be infinite, as moments of an optimizer may.

    Raises:
        CheckpointError: It is missing or damaged, or holds numbers that are not finite.
    """
    try:
        content = read_plain(path)
        if sha256 is not None:
            _check_digest(path, sha256, content)
        arrays = load_bytes(content)
    except (OSError, SafetensorError, KeyError, TypeError, ValueError) as error:
        if isinstance(error, CheckpointError):
            raise
        raise CheckpointError(f"{path}: damaged or missing: {error}") from None
    for name, array in arrays.items():
        whole = array.dtype.kind != "f" or not (np.isnan(array) if infinite else ~np.isfinite(array)).any()
        if array.dtype.kind not in "fiub" or not whole:
            raise CheckpointError(f"{path}: damaged: {name} holds what is no finite number")
    return arrays


def save_arrays(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write one safetensors file in one step, flushed to disk.

    Raises:
        OSError: The disk is full or the folder cannot be written.
    """
    contiguous = {key: np.ascontiguousarray(array) for key, array in arrays.items()}
    try:
        write_atomically(path, lambda file: save_file(contiguous, file), durable=True)
    except SafetensorError as error:
        raise OSError(str(error)) from None
