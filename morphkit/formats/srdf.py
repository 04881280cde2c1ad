"""SRDF: what a vendor says of a robot besides its URDF. Of that, the poses that it names."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from morphkit.errors import DescriptionError
from morphkit.formats.document import Document

STATES = ("home", "stand", "standing")
"""The poses to start in, the best first."""
FOLDERS = (".", "srdf", "../srdf")
"""Where the SRDF of a URDF is looked for, from the folder of the URDF."""
_MOST_FILES = 100


def start_state(path: Path, urdf: Document, said: str | dict[str, float]) -> str | dict[str, float]:
    """Where a robot starts, with an SRDF next to its URDF taken into account.

    A pose is all `<group_state>` of one name. Of several SRDF with the robot's name the one that is called as the URDF
    counts, else the first; one that cannot be read says nothing. Values outside of the limits of their joint are put
    at the nearest limit.

    Args:
        path: The URDF.
        urdf: What it holds.
        said: What `robot.toml` says, see `RobotInfo.start`.

    Returns:
        `said` where it is neither empty nor the name of a pose. Else that pose, or the first of `STATES`, or the first
        that there is: coordinates by joint, rad or m; `said` where there is none.
    """
    if isinstance(said, dict):
        return said
    poses = _poses(path, urdf)
    wanted = (said,) if said else (*STATES, *poses)
    return next((poses[name] for name in wanted if name in poses), said)


def _poses(path: Path, urdf: Document) -> dict[str, dict[str, float]]:
    limits = {joint.get("name"): _limits(joint) for joint in urdf.root.iterfind("joint")}
    for srdf in _find(path, urdf.root.get("name")):
        poses: dict[str, dict[str, float]] = {}
        for state in srdf.root.iterfind("group_state"):
            pose = poses.setdefault(state.get("name", ""), {})
            for joint in state.iterfind("joint"):
                value, limit = _number(joint.get("value")), limits.get(joint.get("name"))
                if limit is not None and math.isfinite(value):
                    pose[joint.get("name")] = min(max(value, limit[0]), limit[1])
        poses = {name: pose for name, pose in poses.items() if name and pose}
        if poses:
            return poses
    return {}


def _find(path: Path, robot: str | None) -> list[Document]:
    """The SRDF of a robot, the best first."""
    found = []
    files = [file for folder in FOLDERS for file in sorted((path.parent / folder).glob("*.srdf"))]
    for file in sorted(files[:_MOST_FILES], key=lambda file: file.stem != path.stem):
        try:
            document = Document.open(file)
        except (OSError, DescriptionError):
            continue
        if document.root.tag == "robot" and document.root.get("name") == robot:
            found.append(document)
    return found


def _limits(joint: Any) -> tuple[float, float] | None:
    """Limits of a joint's coordinate; None where it has none or several."""
    kind, limit = joint.get("type"), joint.find("limit")
    if kind == "continuous":
        return -math.inf, math.inf
    if kind not in ("revolute", "prismatic") or limit is None:
        return None
    low, high = _number(limit.get("lower", "0")), _number(limit.get("upper", "0"))
    return (low, high) if low <= high else None


def _number(text: str | None) -> float:
    try:
        return float(text or "")
    except ValueError:
        return math.nan
