"""A robot in a run's `config.json`, with its file next to it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from morphkit.description import Description
from morphkit.errors import CheckpointError
from morphkit.utils.plain_files import read_plain
from morphkit_rl.runs import schema
from morphkit_rl.runs.run_folder import CONFIG, ROBOTS


def source_file(number: int, robot: Description) -> str:
    """A file name that any file system takes; unique by the robot's number, whatever its name."""
    words = re.sub(r"[^A-Za-z0-9_-]+", "-", robot.name)[:48].strip("-")
    suffix = ".urdf" if robot.format == "urdf" else ".xml"
    return f"{number:03d}-{words}{suffix}" if words else f"{number:03d}{suffix}"


def to_json(number: int, robot: Description) -> dict[str, Any]:
    """What `config.json` says of a robot of this number."""
    return {
        "name": robot.name,
        "file": robot.file,
        "source": source_file(number, robot),
        "format": robot.format,
        "sha256": robot.sha256,
        "folder": str(robot.folder) if robot.folder else None,
        "packages": {name: str(folder) for name, folder in robot.packages.items()},
        "root": robot.root,
        "info": asdict(robot.info),
    }


def from_json(run: Path, entry: Mapping[str, Any]) -> Description:
    """The robot that `to_json` gave the entry of.

    Raises:
        CheckpointError: Its file was changed, or what is said of it makes no sense.
    """
    robot = Description(
        name=entry["name"],
        file=entry["file"],
        format=entry["format"],
        source=read_plain(run / ROBOTS / entry["source"]),
        folder=Path(entry["folder"]) if entry["folder"] else None,
        info=schema.robot_info(entry["info"], f"{run / CONFIG}: {entry['name']!r}"),
        root=entry["root"],
        packages={name: Path(folder) for name, folder in entry.get("packages", {}).items()},
    )
    if robot.sha256 != entry["sha256"]:
        raise CheckpointError(f"{run / ROBOTS / entry['source']}: changed since the run began")
    return robot
