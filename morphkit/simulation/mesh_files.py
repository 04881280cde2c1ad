"""Mesh files of any format as triangles in meters."""

from __future__ import annotations

import contextlib
import io
import logging
import math
import zipfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from morphkit.errors import AssetError
from morphkit.formats.limits import MESH_BYTES, STL_FACES
from morphkit.simulation.collada import check_instances, without_materials
from morphkit.utils.isolation import run_isolated
from morphkit.utils.process_limits import Limits

MAX_STL_FACES = 200_000
"""MuJoCo refuses STL files with more."""

_HEAD, _FACE = 84, 50  # bytes in a binary STL
_ASCII_BYTES = 512  # in which an STL that is text has its first facet
_COLLADA = (".dae", ".zae")


def read_for_mujoco(path: Path) -> tuple[str, bytes]:
    """Return name and content of a mesh in a form that MuJoCo reads.

    STL, OBJ and MSH stay as they are; text and very large STL, and all other formats, are converted with trimesh.

    Raises:
        AssetError: Neither MuJoCo nor trimesh can read it.
        OSError: It cannot be read at all.
    """
    _check_size(path)
    suffix = path.suffix.lower()
    content = path.read_bytes() if suffix != ".stl" else _without_rest(path.read_bytes())
    if suffix in (".obj", ".msh") or (suffix == ".stl" and _is_plain_stl(content)):
        return path.name, content
    import trimesh  # noqa: F401 - here, so that not every process has to import it

    size = path.stat().st_size
    return run_isolated(
        partial(_converted, path),
        Limits.for_meshes(size, size),
        problem=lambda reason: AssetError(f"{path}: cannot be read as a mesh: {reason}"),
    )


def _converted(path: Path) -> tuple[str, bytes]:
    mesh = load_mesh(path)
    kind = "stl" if len(mesh.faces) <= MAX_STL_FACES else "obj"
    with _reading(path):
        converted = mesh.export(file_type=kind)
    return f"{path.stem}.{kind}", converted.encode() if isinstance(converted, str) else bytes(converted)


def _check_size(path: Path) -> None:
    """AssetError for a mesh that is too large, or that would be once unpacked."""
    size = path.stat().st_size
    if zipfile.is_zipfile(path):
        with contextlib.suppress(zipfile.BadZipFile), zipfile.ZipFile(path) as archive:
            size = max(size, sum(entry.file_size for entry in archive.infolist()))
    if size > MESH_BYTES:
        limit = MESH_BYTES // 2**20
        raise AssetError(f"{path}: {size / 2**20:.0f} MiB of mesh, more than the limit of {limit} MiB")
    if path.suffix.lower() == ".stl" and (faces := _stated_faces(path)) > STL_FACES:
        raise AssetError(
            f"{path}: {faces:,} triangles, more than the limit of {STL_FACES:,}; reduce the mesh, for instance with"
            " trimesh's simplify_quadric_decimation"
        )


def _stated_faces(path: Path) -> int:
    """How many triangles a binary STL says that it has; 0 of one that is text, or shorter than that."""
    with path.open("rb") as file:
        head = file.read(_ASCII_BYTES)
    faces = int.from_bytes(head[80:_HEAD], "little")
    return faces if b"facet" not in head and path.stat().st_size >= _HEAD + _FACE * faces else 0


def _is_plain_stl(content: bytes) -> bool:
    """Whether an STL is binary and small enough for MuJoCo."""
    faces = int.from_bytes(content[80:_HEAD], "little")
    return len(content) == _HEAD + _FACE * faces and faces <= MAX_STL_FACES


def _without_rest(content: bytes) -> bytes:
    """An STL without what some programs write after its last triangle."""
    end = _HEAD + _FACE * int.from_bytes(content[80:_HEAD], "little")
    return content[:end] if _HEAD < end < len(content) and b"facet" not in content[:_ASCII_BYTES] else content


def load_mesh(path: Path, *, merged: bool = True) -> Any:
    """Read a mesh file, all its parts joined, in meters where the file states its unit.

    COLLADA states one. Its up axis is not applied: RViz, Gazebo and MoveIt take coordinates as they are, so that
    URDFs are written for that, whatever axis their meshes state. Nor is glTF turned, whose up axis is y by definition.

    Args:
        path: The file.
        merged: Whether the corners that triangles of an STL share become one vertex, which takes most of the time.

    Returns:
        A `trimesh.Trimesh` with at least one face.

    Raises:
        AssetError: The file cannot be read or holds no triangles.
    """
    import trimesh

    _check_size(path)
    collada = path.suffix.lower() in _COLLADA
    if path.suffix.lower() == ".dae":
        check_instances(path)
    with _reading(path):
        if path.suffix.lower() == ".msh":
            return trimesh.Trimesh(*_read_msh(path.read_bytes()), process=False)
        if path.suffix.lower() == ".stl":
            content = io.BytesIO(_without_rest(path.read_bytes()))
            mesh = trimesh.load(content, file_type="stl", force="mesh", process=merged)
        else:
            mesh = trimesh.load(path, force="mesh", skip_materials=True)
        if path.suffix.lower() == ".dae" and len(mesh.faces) == 0:
            mesh = trimesh.load(io.BytesIO(without_materials(path)), file_type="dae", force="mesh")
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
        raise AssetError(f"{path}: holds no triangles")
    if mesh.vertices.shape[1:] != (3,):
        raise AssetError(f"{path}: cannot be read as a mesh: its vertices have {mesh.vertices.shape[1]} coordinates")
    if not 0 <= mesh.faces.min() <= mesh.faces.max() < len(mesh.vertices):
        raise AssetError(f"{path}: cannot be read as a mesh: a face names a vertex that is not there")
    factor = _meters(mesh.units) if collada else 1.0
    if not 0 < factor < math.inf:
        raise AssetError(f"{path}: states a unit of {factor:g} m")
    if factor != 1.0:
        mesh.apply_scale(factor)
    return mesh


@contextlib.contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Make an AssetError of what trimesh raises, whatever the reader of the format raises, and keep it from logging."""
    log = logging.getLogger("trimesh")
    before = log.level
    log.setLevel(logging.CRITICAL + 1)  # its modules' own loggers follow
    try:
        yield
    except MemoryError:  # which whoever set the limit has better words for
        raise
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise AssetError(f"{path}: cannot be read as a mesh: {reason}") from error
    finally:
        log.setLevel(before)


def _read_msh(content: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) and faces (m, 3) of MuJoCo's own format: four counts, then float32 and int32 arrays.

    Raises:
        ValueError: The counts do not fit the length.
    """
    vertices, normals, coordinates, faces = (int(count) for count in np.frombuffer(content[:16], "<i4"))
    floats = 3 * vertices + 3 * normals + 2 * coordinates
    if min(vertices, faces) < 1 or min(normals, coordinates) < 0 or len(content) != 16 + 4 * (floats + 3 * faces):
        raise ValueError("its length does not fit the counts at its start")
    points = np.frombuffer(content, "<f4", 3 * vertices, 16).reshape(-1, 3)
    corners = np.frombuffer(content, "<i4", 3 * faces, 16 + 4 * floats).reshape(-1, 3)
    if corners.min() < 0 or corners.max() >= vertices:
        raise ValueError("a face names a vertex that is not there")
    return points.astype(float), corners


def _meters(units: str | None) -> float:
    """Meters that one unit is; 1 where it is unknown."""
    from trimesh.units import unit_conversion

    try:
        return float(unit_conversion(units, "meters")) if units else 1.0
    except (KeyError, ValueError):
        return 1.0
