"""Run folders: crash-safe checkpoints without pickle.

A checkpoint is a folder that is written under a temporary name and renamed when it is whole; `checkpoints/latest`
names the newest. The replay is kept beside them in immutable segments, so that a checkpoint writes only what is new.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.numpy import load_file, save_file
from torch import nn

from morphkit.errors import CheckpointError, OutputError
from morphkit_rl.replay import FIELDS, Ring

FORMAT_VERSION = 1
_LATEST = "latest"


def write_text(path: Path, text: str) -> None:
    """Write a file under a temporary name, flush it to disk and rename it."""
    temporary = path.with_name(f".{path.name}.tmp")
    with temporary.open("w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    temporary.replace(path)


def create_run(run: Path) -> None:
    """Make the run folder.

    Raises:
        OutputError: It cannot be written, or holds files already.
    """
    if run.exists() and (not run.is_dir() or any(run.iterdir())):
        is_run = (run / "config.json").is_file()
        hint = "continue it with --resume, or choose another folder" if is_run else "choose another folder"
        raise OutputError(f"{run}: exists and is not empty; {hint}")
    try:
        (run / "checkpoints").mkdir(parents=True)
        (run / "replay").mkdir()
    except OSError as error:
        raise OutputError(f"{run}: cannot make the run folder: {error.strerror}") from None


def save(
    run: Path, tensors: Mapping[str, Mapping[str, np.ndarray]], state: dict[str, Any], rings: Sequence[Ring]
) -> None:
    """Write a checkpoint and make it the latest; older ones go.

    Args:
        run: The run folder.
        tensors: One safetensors file a name.
        state: What JSON can hold; `steps` names the checkpoint.
        rings: Replay, all rings filled in step.

    Raises:
        OutputError: The disk is full or the folder cannot be written; the previous checkpoint stays.
    """
    folder = run / "checkpoints"
    name = f"step-{state['steps']:012d}"
    temporary = folder / f".{name}.tmp"
    try:
        segments = _save_replay(run, rings)
        shutil.rmtree(temporary, ignore_errors=True)
        temporary.mkdir(parents=True)
        for file, arrays in tensors.items():
            _save_arrays(temporary / f"{file}.safetensors", arrays)
        sizes = {path.name: path.stat().st_size for path in sorted(temporary.iterdir())}
        whole = {"format_version": FORMAT_VERSION, **state, "files": sizes, "segments": segments}
        write_text(temporary / "state.json", json.dumps(whole, indent=1))
        final = folder / name
        if final.exists():
            shutil.rmtree(final)
        temporary.rename(final)
        write_text(folder / _LATEST, name + "\n")
    except OSError as error:
        shutil.rmtree(temporary, ignore_errors=True)
        raise OutputError(
            f"{run}: cannot write a checkpoint: {error.strerror or error}; the last one is whole"
        ) from None
    for old in folder.iterdir():
        if old.is_dir() and old.name != name:
            shutil.rmtree(old, ignore_errors=True)
    for old in (run / "replay").iterdir():
        if old.name not in {segment["file"] for segment in segments}:
            old.unlink(missing_ok=True)


def has_checkpoint(run: Path) -> bool:
    """Whether `run` got as far as its first checkpoint."""
    return (run / "checkpoints" / _LATEST).is_file()


def load_state(run: Path) -> tuple[Path, dict[str, Any]]:
    """Find the latest checkpoint and read its state.

    Returns:
        The checkpoint's folder and its `state.json`.

    Raises:
        CheckpointError: There is none, or it was cut short.
    """
    if not run.is_dir():
        raise CheckpointError(f"{run}: no such run folder")
    pointer = run / "checkpoints" / _LATEST
    if not has_checkpoint(run):
        hint = (
            "the run was stopped before its first checkpoint" if (run / "config.json").is_file() else "not a run folder"
        )
        raise CheckpointError(f"{run}: holds no checkpoint ({hint})")
    folder = run / "checkpoints" / pointer.read_text().strip()
    try:
        state = json.loads((folder / "state.json").read_text())
        version, sizes = state["format_version"], state["files"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise CheckpointError(f"{folder / 'state.json'}: damaged or missing: {error}") from None
    if version != FORMAT_VERSION:
        raise CheckpointError(f"{folder}: format version {version}; this morphkit reads version {FORMAT_VERSION}")
    for name, size in sizes.items():
        path = folder / name
        if not path.is_file() or path.stat().st_size != size:
            found = f"{path.stat().st_size} bytes" if path.is_file() else "nothing"
            raise CheckpointError(f"{path}: cut short: expected {size} bytes, found {found}")
    return folder, state


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
            reason = " ".join(str(error).split())
            raise CheckpointError(f"{origin}: made for another method or size: {reason}") from None


def optimizer_arrays(optimizers: Mapping[str, torch.optim.Optimizer]) -> dict[str, np.ndarray]:
    """State of several optimisers under `optimizer/parameter number/name`."""
    return {
        f"{name}/{number}/{key}": value.detach().cpu().numpy()
        for name, optimizer in optimizers.items()
        for number, state in optimizer.state_dict()["state"].items()
        for key, value in state.items()
    }


def load_optimizers(optimizers: Mapping[str, torch.optim.Optimizer], arrays: Mapping[str, np.ndarray]) -> None:
    """Fill optimisers from `optimizer_arrays`."""
    for name, optimizer in optimizers.items():
        whole = optimizer.state_dict()
        state: dict[int, dict[str, torch.Tensor]] = {}
        for key, array in arrays.items():
            owner, number, field = key.split("/")
            if owner == name:
                state.setdefault(int(number), {})[field] = torch.from_numpy(array)
        optimizer.load_state_dict({**whole, "state": state})


def load_replay(run: Path, segments: Sequence[Mapping[str, Any]], rings: Sequence[Ring], added: int) -> None:
    """Fill the rings from their segments."""
    for segment in segments:
        arrays = load_arrays(run / "replay" / segment["file"])
        for number, ring in enumerate(rings):
            rows = ring.rows(segment["first"], segment["last"])
            for name in FIELDS:
                getattr(ring, name)[rows] = arrays[f"{number}/{name}"]
    for ring in rings:
        ring.added = added


def _save_replay(run: Path, rings: Sequence[Ring]) -> list[dict[str, Any]]:
    """Write what was added since the last checkpoint; returns the segments that hold the whole replay."""
    try:
        segments = [dict(segment) for segment in load_state(run)[1]["segments"]]
    except CheckpointError:
        segments = []
    added = rings[0].added
    oldest = max(added - rings[0].sweeps, 0)
    segments = [segment for segment in segments if oldest < segment["last"] <= added]
    first = max(segments[-1]["last"] if segments else 0, oldest)
    if first < added:
        file = f"sweeps-{first:010d}-{added:010d}.safetensors"
        arrays = {}
        for number, ring in enumerate(rings):
            rows = ring.rows(first, added)
            arrays.update({f"{number}/{name}": getattr(ring, name)[rows] for name in FIELDS})
        _save_arrays(run / "replay" / file, arrays)
        segments.append({"file": file, "first": first, "last": added})
    return segments


def _save_arrays(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    temporary = path.with_name(f".{path.name}.tmp")
    try:
        save_file({key: np.ascontiguousarray(array) for key, array in arrays.items()}, temporary)
        temporary.replace(path)
    except SafetensorError as error:
        raise OSError(str(error)) from None
    finally:
        temporary.unlink(missing_ok=True)
