"""The replay on disk: immutable segments beside the checkpoints, so that a checkpoint writes only what is new."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from morphkit_rl.buffers.replay_buffer import FIELDS, Ring
from morphkit_rl.runs import checkpoint

Segment = Mapping[str, Any]
"""`file` and the sweeps `first` to `last` (exclusive) that it holds."""


def save_segments(run: Path, rings: Sequence[Ring]) -> list[Segment]:
    """Write what was added since the last checkpoint.

    Args:
        run: The run folder.
        rings: The replay, all rings filled in step.

    Returns:
        The segments that hold the whole replay but for `newest`.

    Raises:
        OSError: The disk is full or the folder cannot be written.
    """
    added, oldest = rings[0].added, rings[0].oldest
    segments: list[Segment] = [segment for segment in checkpoint.segments(run) if oldest < segment["last"] <= added]
    first = max(segments[-1]["last"] if segments else 0, oldest)
    if first < added:
        file = f"sweeps-{first:010d}-{added:010d}.safetensors"
        arrays = {}
        for number, ring in enumerate(rings):
            rows = ring.rows(first, added)
            arrays.update({f"{number}/{name}": getattr(ring, name)[rows] for name in FIELDS})
            new = ring.finals.numbers >= first * ring.num_envs
            arrays[f"{number}/finals/numbers"] = ring.finals.numbers[new]
            arrays[f"{number}/finals/obs"] = ring.finals.obs[new]
        checkpoint.save_arrays(run / "replay" / file, arrays)
        segments.append({"file": file, "first": first, "last": added})
    return segments


def newest_arrays(rings: Sequence[Ring]) -> dict[str, np.ndarray]:
    """What a checkpoint must hold itself, since the next sweep changes it."""
    return {f"{number}/newest": ring.newest for number, ring in enumerate(rings)}


def load_segments(
    run: Path, segments: Sequence[Segment], newest: Mapping[str, np.ndarray], rings: Sequence[Ring], added: int
) -> None:
    """Fill empty rings.

    Args:
        run: The run folder.
        segments: What `save_segments` gave.
        newest: What `newest_arrays` gave.
        rings: The replay.
        added: Sweeps that had been added.

    Raises:
        CheckpointError: A segment is missing or damaged.
    """
    for segment in segments:
        arrays = checkpoint.load_arrays(run / "replay" / segment["file"])
        for number, ring in enumerate(rings):
            rows = ring.rows(segment["first"], segment["last"])
            for name in FIELDS:
                getattr(ring, name)[rows] = arrays[f"{number}/{name}"]
            ring.finals.push(arrays[f"{number}/finals/numbers"], arrays[f"{number}/finals/obs"])
    for number, ring in enumerate(rings):
        ring.added = added
        ring.newest[:] = newest[f"{number}/newest"]
        ring.finals.drop(ring.oldest * ring.num_envs)
