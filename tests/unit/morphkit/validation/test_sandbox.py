"""Bounds of the process that looks at meshes."""

from __future__ import annotations

import os
from pathlib import Path

from morphkit.formats.limits import MESH_BYTES
from morphkit.validation import sandbox


def sparse(path: Path, size: int) -> Path:
    path.touch()
    os.truncate(path, size)
    return path


def test_the_time_grows_with_the_meshes_up_to_what_is_read(tmp_path: Path) -> None:
    small, large = sparse(tmp_path / "small.stl", 2**20), sparse(tmp_path / "large.stl", MESH_BYTES)
    huge = sparse(tmp_path / "huge.stl", MESH_BYTES + 1)
    base = sandbox.seconds_for([])
    assert base == sandbox.LIMIT_S == sandbox.seconds_for([huge, tmp_path / "missing.stl"])
    assert sandbox.seconds_for([small, small]) == base + 1
    assert sandbox.seconds_for([small, large]) == base + 1 + MESH_BYTES / 2**20


def test_a_mesh_beyond_the_limit_is_refused_with_the_limit(tmp_path: Path) -> None:
    huge = sparse(tmp_path / "huge.obj", MESH_BYTES + 1)
    facts = sandbox.probe([huge]).meshes
    assert "limit of 512 MiB" in facts[str(huge)].problem
