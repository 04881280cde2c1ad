"""The replay on disk: immutable segments next to the checkpoints, so that a checkpoint writes only what is new."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from morphkit_rl.buffers.replay_buffer import FIELDS, ReplayBuffer
from morphkit_rl.runs import checkpoint
from morphkit_rl.runs.run_folder import REPLAY

Segment = Mapping[str, Any]
"""`file` and the sweeps `first` to `last` (exclusive) that it holds."""


def save_segments(run: Path, buffers: Sequence[ReplayBuffer]) -> list[Segment]:
    """Write what was added since the last checkpoint.

    Args:
        run: The run folder.
        buffers: The replay, all buffers filled in step.

    Returns:
        The segments that hold the whole replay but for `newest`.

    Raises:
        OSError: The disk is full or the folder cannot be written.
    """
    added, oldest = buffers[0].added, buffers[0].oldest
    segments: list[Segment] = [segment for segment in checkpoint.segments(run) if oldest < segment["last"] <= added]
    first = max(segments[-1]["last"] if segments else 0, oldest)
    if first < added:
        file = f"sweeps-{first:010d}-{added:010d}.safetensors"
        arrays = {}
        for number, buffer in enumerate(buffers):
            rows = buffer.rows(first, added)
            arrays.update({f"{number}/{name}": getattr(buffer, name)[rows] for name in FIELDS})
            new = buffer.finals.numbers >= first * buffer.num_envs
            arrays[f"{number}/finals/numbers"] = buffer.finals.numbers[new]
            arrays[f"{number}/finals/obs"] = buffer.finals.obs[new]
        checkpoint.save_arrays(run / REPLAY / file, arrays)
        segments.append({"file": file, "first": first, "last": added})
    return segments


def newest_arrays(buffers: Sequence[ReplayBuffer]) -> dict[str, np.ndarray]:
    """What a checkpoint must hold itself, since the next sweep changes it."""
    return {f"{number}/newest": buffer.newest for number, buffer in enumerate(buffers)}


def load_segments(
    run: Path,
    segments: Sequence[Segment],
    newest: Mapping[str, np.ndarray],
    buffers: Sequence[ReplayBuffer],
    added: int,
) -> None:
    """Fill empty buffers.

    Args:
        run: The run folder.
        segments: What `save_segments` gave.
        newest: What `newest_arrays` gave.
        buffers: The replay.
        added: Sweeps that had been added.

    Raises:
        CheckpointError: A segment is missing or damaged.
    """
    for segment in segments:
        arrays = checkpoint.load_arrays(run / REPLAY / segment["file"])
        for number, buffer in enumerate(buffers):
            rows = buffer.rows(segment["first"], segment["last"])
            for name in FIELDS:
                getattr(buffer, name)[rows] = arrays[f"{number}/{name}"]
            buffer.finals.push(arrays[f"{number}/finals/numbers"], arrays[f"{number}/finals/obs"])
    for number, buffer in enumerate(buffers):
        buffer.added = added
        buffer.newest[:] = newest[f"{number}/newest"]
        buffer.finals.drop(buffer.oldest * buffer.num_envs)
