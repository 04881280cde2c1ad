"""The replay on disk: immutable segments next to the checkpoints, so that a checkpoint writes only what is new."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from morphkit.errors import CheckpointError
from morphkit_rl.buffers.replay_buffer import FIELDS, ReplayBuffer
from morphkit_rl.runs import checkpoint
from morphkit_rl.runs.network_arrays import require_shapes
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
    segments: list[Segment] = [
        {**checkpoint.describe(run / REPLAY / segment["file"]), **segment}  # those of version 2 lack it
        if "sha256" not in segment
        else segment
        for segment in checkpoint.segments(run)
        if oldest < segment["last"] <= added
    ]
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
        segments.append({"file": file, "first": first, "last": added, **checkpoint.describe(run / REPLAY / file)})
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
        CheckpointError: A segment is missing or damaged, or does not fit the others or the buffers.
    """
    _check_order(segments, buffers[0], added, run)
    for segment in segments:
        path = run / REPLAY / segment["file"]
        arrays = checkpoint.load_arrays(path, sha256=segment.get("sha256"))
        for number, buffer in enumerate(buffers):
            _check_arrays(arrays, number, segment, buffer, path)
            rows = buffer.rows(segment["first"], segment["last"])
            for name in FIELDS:
                getattr(buffer, name)[rows] = arrays[f"{number}/{name}"]
            buffer.finals.push(arrays[f"{number}/finals/numbers"], arrays[f"{number}/finals/obs"])
    require_shapes(newest, {f"{number}/newest": buffer.newest for number, buffer in enumerate(buffers)}, run)
    for number, buffer in enumerate(buffers):
        buffer.added = added
        buffer.newest[:] = newest[f"{number}/newest"]
        buffer.finals.drop(buffer.oldest * buffer.num_envs)


def _check_order(segments: Sequence[Segment], buffer: ReplayBuffer, added: int, run: Path) -> None:
    """Refuse segments that leave out sweeps, or hold more than the replay."""
    ends = [max(added - buffer.sweeps, 0)]
    for segment in segments:
        size = segment["last"] - segment["first"]
        behind = segment["first"] <= ends[0] if len(ends) == 1 else segment["first"] == ends[-1]
        if not (behind and 0 < size <= buffer.sweeps and segment["last"] > ends[0]):
            raise CheckpointError(f"{run / REPLAY / segment['file']}: does not fit the segments around it")
        ends.append(segment["last"])
    if added and ends[-1] != added:
        raise CheckpointError(f"{run / REPLAY}: its segments end at sweep {ends[-1]}, the checkpoint at {added}")


def _check_arrays(
    arrays: Mapping[str, np.ndarray], number: int, segment: Segment, buffer: ReplayBuffer, path: Path
) -> None:
    """Refuse arrays that do not fit a robot's buffer, or whose ends of episodes lack their observations."""
    first, size = segment["first"] * buffer.num_envs, (segment["last"] - segment["first"]) * buffer.num_envs
    like = {f"{number}/{name}": getattr(buffer, name) for name in FIELDS}
    expected = {name: np.broadcast_to(array[:1], (size, *array.shape[1:])) for name, array in like.items()}
    require_shapes(arrays, expected, path, exactly=True)
    ends = first + np.flatnonzero(arrays[f"{number}/ended"])
    obs = np.broadcast_to(buffer.newest[:1], (len(ends), buffer.newest.shape[1]))
    require_shapes(arrays, {f"{number}/finals/numbers": ends, f"{number}/finals/obs": obs}, path, exactly=True)
    if not np.array_equal(arrays[f"{number}/finals/numbers"], ends):
        raise CheckpointError(f"{path}: damaged: its last observations are not those of the ends of episodes")
