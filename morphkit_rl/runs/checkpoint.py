"""Run folders: crash-safe checkpoints without pickle.

A checkpoint is a folder that is written under a temporary name and renamed when it is whole; `checkpoints/latest`
names the newest. The replay is kept next to them, see `replay_segments`.
"""

from __future__ import annotations

import json
import textwrap
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.numpy import load_file, save_file
from torch import nn

from morphkit.errors import CheckpointError, MorphkitError, OutputError
from morphkit.utils.atomic_write import write_atomically, write_text
from morphkit.utils.plain_files import read_plain
from morphkit_rl.runs import run_folder
from morphkit_rl.runs.run_folder import CHECKPOINT_NAME, CHECKPOINTS, LATEST, SEGMENT_NAME

FORMAT_VERSION = 2


@contextmanager
def writing(run: Path) -> Iterator[None]:
    """Around everything that writes a checkpoint of `run`; where that fails, what was written goes.

    Raises:
        OutputError: The disk is full or the folder cannot be written.
    """
    try:
        yield
    except BaseException as error:
        with suppress(OSError, CheckpointError):
            run_folder.clear_checkpoints(run, keep=_latest(run) if has_checkpoint(run) else None)
            run_folder.clear_segments(run, keep={segment["file"] for segment in segments(run)})
        if not isinstance(error, OSError) or isinstance(error, MorphkitError):
            raise
        left = "the last one is whole" if has_checkpoint(run) else "there is none yet"
        raise OutputError(f"{run}: cannot write a checkpoint: {error.strerror or error}; {left}") from None


def save(run: Path, tensors: Mapping[str, Mapping[str, np.ndarray]], state: Mapping[str, Any]) -> None:
    """Write a checkpoint and make it the latest; older ones go, and replay segments that it does not need.

    To be called within `writing`, which removes what a failure leaves.

    Args:
        run: The run folder.
        tensors: One safetensors file a name.
        state: What JSON can hold; `real_steps` and `updates` name the checkpoint, `segments` lists its replay.

    Raises:
        OSError: The disk is full or the folder cannot be written; the previous checkpoint stays.
    """
    run_folder.require_run(run)
    folder = run / CHECKPOINTS
    name = f"step-{state['real_steps']:012d}-{state['updates']:010d}"
    latest = _latest(run) if has_checkpoint(run) else None
    if latest == name:
        name += "-again"  # the latest is only ever removed once another is whole
    temporary = folder / f".{name}.tmp"
    run_folder.clear_checkpoints(run, keep=latest)
    temporary.mkdir(parents=True)
    for file, arrays in tensors.items():
        save_arrays(temporary / f"{file}.safetensors", arrays)
    sizes = {path.name: path.stat().st_size for path in sorted(temporary.iterdir())}
    whole = {"format_version": FORMAT_VERSION, **state, "files": sizes}
    write_text(temporary / "state.json", json.dumps(whole, indent=1), durable=True)
    temporary.rename(folder / name)
    write_text(folder / LATEST, name + "\n", durable=True)
    run_folder.clear_checkpoints(run, keep=name)
    run_folder.clear_segments(run, keep={segment["file"] for segment in state["segments"]})


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


def load_state(run: Path) -> tuple[Path, dict[str, Any]]:
    """Find the latest checkpoint and read its state.

    Returns:
        The checkpoint's folder and its `state.json`.

    Raises:
        CheckpointError: There is none, it was cut short, or the run folder holds links.
    """
    run_folder.require_run(run)
    if not has_checkpoint(run):
        raise CheckpointError(f"{run}: holds no checkpoint (the run was stopped before its first checkpoint)")
    folder = run / CHECKPOINTS / _latest(run)
    try:
        state = json.loads(read_plain(folder / "state.json"))
        version, sizes = state["format_version"], state["files"]
        names = [segment["file"] for segment in state["segments"]]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise CheckpointError(f"{folder / 'state.json'}: damaged or missing: {error}") from None
    if version != FORMAT_VERSION:
        raise CheckpointError(f"{folder}: format version {version}; this morphkit reads version {FORMAT_VERSION}")
    for name in names:
        if not SEGMENT_NAME.fullmatch(name):
            raise CheckpointError(f"{folder / 'state.json'}: damaged: {name!r} is no name of a replay segment")
    for name, size in sizes.items():
        path = folder / name
        if not path.is_file() or path.stat().st_size != size:
            found = f"{path.stat().st_size} bytes" if path.is_file() else "nothing"
            raise CheckpointError(f"{path}: cut short: expected {size} bytes, found {found}")
    return folder, state


def _latest(run: Path) -> str:
    """Name of the latest checkpoint.

    Raises:
        CheckpointError: The file that holds it cannot be read, or holds something else.
    """
    path = run / CHECKPOINTS / LATEST
    try:
        name = read_plain(path).decode().strip()
    except (OSError, ValueError) as error:
        raise CheckpointError(f"{path}: damaged: {error}") from None
    if not CHECKPOINT_NAME.fullmatch(name):
        raise CheckpointError(f"{path}: damaged: {name[:80]!r} is no name of a checkpoint")
    return name


def segments(run: Path) -> list[dict[str, Any]]:
    """The replay segments of the latest checkpoint; none before the first."""
    return list(load_state(run)[1]["segments"]) if has_checkpoint(run) else []


def check_method(folder: Path, state: Mapping[str, Any], method: str) -> None:
    """Refuse the checkpoint of another method.

    Raises:
        CheckpointError: `state` is not of `method`.
    """
    if state.get("method") != method:
        raise CheckpointError(f"{folder}: a checkpoint of method {state.get('method')!r}, but the run says {method!r}")


def load_arrays(path: Path) -> dict[str, np.ndarray]:
    """Read one safetensors file.

    Raises:
        CheckpointError: It is missing or damaged.
    """
    try:
        return load_file(path)
    except (OSError, SafetensorError) as error:
        raise CheckpointError(f"{path}: damaged or missing: {error}") from None


def module_arrays(networks: Mapping[str, nn.Module]) -> dict[str, np.ndarray]:
    """Parameters of several networks under `network/parameter`."""
    return {
        f"{name}/{key}": value.detach().cpu().numpy()
        for name, network in networks.items()
        for key, value in network.state_dict().items()
    }


def load_modules(networks: Mapping[str, nn.Module], arrays: Mapping[str, np.ndarray], origin: Path) -> None:
    """Fill networks from `module_arrays`.

    Raises:
        CheckpointError: The parameters are those of another network.
    """
    for name, network in networks.items():
        prefix = f"{name}/"
        part = {key[len(prefix) :]: torch.from_numpy(a) for key, a in arrays.items() if key.startswith(prefix)}
        try:
            network.load_state_dict(part)
        except RuntimeError as error:
            reason = textwrap.shorten(str(error), 300, placeholder=" ...")
            raise CheckpointError(f"{origin}: made for another method or size: {reason}") from None


def optimizer_arrays(optimizers: Mapping[str, torch.optim.Optimizer]) -> dict[str, np.ndarray]:
    """State of several optimizers under `optimizer/parameter number/name`."""
    return {
        f"{name}/{number}/{key}": value.detach().cpu().numpy()
        for name, optimizer in optimizers.items()
        for number, state in optimizer.state_dict()["state"].items()
        for key, value in state.items()
    }


def load_optimizers(optimizers: Mapping[str, torch.optim.Optimizer], arrays: Mapping[str, np.ndarray]) -> None:
    """Fill optimizers from `optimizer_arrays`."""
    for name, optimizer in optimizers.items():
        whole = optimizer.state_dict()
        state: dict[int, dict[str, torch.Tensor]] = {}
        for key, array in arrays.items():
            owner, number, field = key.split("/")
            if owner == name:
                state.setdefault(int(number), {})[field] = torch.from_numpy(array)
        optimizer.load_state_dict({**whole, "state": state})


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
