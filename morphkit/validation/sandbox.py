"""What only dangerous libraries can tell of a file, found out in a process of its own with bounded time and memory.

Mesh readers and MuJoCo may crash or fill the memory on files from strangers. The child answers line by line, so that
what it found before it died counts.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from morphkit.formats.isolation import limits_of
from morphkit.formats.limits import MESH_BYTES
from morphkit.utils.process_limits import BYTES_A_SECOND, Limits
from morphkit.validation.meshes import MeshFacts

LIMIT_S = 120
"""How long a child may take, s, on a busy machine, besides what its meshes take."""


@dataclass
class Answer:
    """What the child found out.

    Attributes:
        meshes: Facts by path.
        model: What MuJoCo made of the model, see `_examine`; None where it was not asked or the child died before.
        robot: What came of converting the robot, see `urdf_conversion.examine`; None where that was not asked or not
            answered.
        died: How and at what the child died; empty where it did not.
    """

    meshes: dict[str, MeshFacts] = field(default_factory=dict)
    model: dict[str, Any] | None = None
    robot: dict[str, Any] | None = None
    died: str = ""


def probe(
    meshes: Sequence[Path], *, model: dict[str, Any] | None = None, robot: dict[str, Any] | None = None
) -> Answer:
    """Ask a child about meshes and a model or robot.

    Args:
        meshes: Mesh files.
        model: `source` (text of an MJCF without includes), `file`, `folder`, `packages` and `start`; None for no model.
        robot: The same of a URDF, its bytes as Latin-1; None for none.
    """
    answer = Answer()
    wanted = list(dict.fromkeys(map(str, meshes)))
    tasks = [*wanted, *(["MuJoCo"] if model is not None or robot is not None else [])]
    if not tasks:
        return answer
    limits = limits_of(meshes)
    request = json.dumps({"meshes": wanted, "model": model, "robot": robot, "limits": asdict(limits)}).encode()
    command = [sys.executable, "-m", "morphkit.validation.sandbox"]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    reason, seconds = "", seconds_for(meshes)
    try:
        # An empty folder: Python would import what lies where it works, and MuJoCo writes a log there.
        with tempfile.TemporaryDirectory() as empty:
            done = subprocess.run(
                command, input=request, capture_output=True, timeout=seconds, env=environment, cwd=empty, check=False
            )
        output = done.stdout
        if done.returncode == -getattr(signal, "SIGXCPU", 0):
            reason = f"it took more than {limits.seconds:.3g} s of processor time"
        elif done.returncode < 0:
            reason = f"signal {-done.returncode}"
        elif done.returncode:
            reason = (done.stderr.decode(errors="replace").strip().splitlines() or ["no message"])[-1][:200]
    except subprocess.TimeoutExpired as error:
        output, reason = error.stdout or b"", f"no answer within {seconds:.0f} s"
    for line in output.decode(errors="replace").splitlines():
        _take(answer, line)
    if reason:
        finished = len(answer.meshes) + (answer.model is not None) + (answer.robot is not None)
        answer.died = f"{tasks[min(finished, len(tasks) - 1)]}: {reason}"
    return answer


def seconds_for(meshes: Sequence[Path]) -> float:
    """How long a child may take for the mesh files, s; each counts once, those that are too large to be read do not."""
    sizes = [path.stat().st_size for path in set(meshes) if path.is_file()]
    return LIMIT_S + sum(size for size in sizes if size <= MESH_BYTES) / BYTES_A_SECOND


def _take(answer: Answer, line: str) -> None:
    try:
        found = json.loads(line)
    except ValueError:
        return  # something that a library printed, or the line that the child died in
    if not isinstance(found, dict):
        return
    if "mesh" in found:
        bounds = np.array(found.get("bounds", np.zeros((2, 3))), dtype=float)
        facts = MeshFacts(
            bounds,
            found.get("volume", 0.0),
            found.get("faces", 0),
            found.get("problem", ""),
            found.get("up_axis"),
        )
        answer.meshes[found["mesh"]] = facts
    elif "model" in found:
        answer.model = found["model"]
    elif "robot" in found:
        answer.robot = found["robot"]


def _measure(path: Path) -> dict[str, Any]:
    from morphkit.simulation.collada import up_axis
    from morphkit.simulation.mesh_files import load_mesh

    mesh = load_mesh(path, merged=False)
    if not np.all(np.isfinite(mesh.vertices)):
        return {"problem": "a vertex is not finite"}
    try:
        volume = float(mesh.convex_hull.volume)
    except Exception:  # qhull refuses flat meshes in several ways
        volume = 0.0
    return {"bounds": mesh.bounds.tolist(), "volume": volume, "faces": len(mesh.faces), "up_axis": up_axis(path)}


def _answers(request: dict[str, Any]) -> Iterator[dict[str, Any]]:
    for path in request["meshes"]:
        try:
            facts = _measure(Path(path))
        except MemoryError:
            facts = {"problem": "it needs more memory than its size allows"}
        except Exception as error:  # whatever the reader of the format raises
            facts = {"problem": " ".join(str(error).split())[:200] or type(error).__name__}
        yield {"mesh": path, **facts}
    if request["model"] is not None:
        from morphkit.validation.mujoco_checks import examine

        yield {"model": examine(**request["model"])}
    if request["robot"] is not None:
        from morphkit.validation import urdf_conversion

        yield {"robot": urdf_conversion.examine(**request["robot"])}


def main() -> None:
    """Answer the request on stdin, a line each."""
    request = json.load(sys.stdin)
    limits = Limits(**request["limits"])
    limits.bound_memory()
    out = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what libraries print goes to stderr
    limits.bound_next_task()
    for answer in _answers(request):
        limits.bound_next_task()
        out.write(json.dumps(answer) + "\n")
        out.flush()


if __name__ == "__main__":
    main()
