"""Whether a URDF can be converted, and which of its links overlap; runs in the child of `probe`."""

from __future__ import annotations

import tempfile
import warnings
from pathlib import Path
from typing import Any

from morphkit.conversion.convert import convert
from morphkit.conversion.write import write_conversion
from morphkit.description import Description, RobotInfo
from morphkit.errors import MorphkitError
from morphkit.simulation.spec import compile_spec
from morphkit.simulation.start_pose import start_pose
from morphkit.validation.balance import tips_at
from morphkit.validation.overlaps import link_overlaps


def examine(
    source: str, file: str, folder: str, packages: dict[str, str], start: str | dict[str, float]
) -> dict[str, Any]:
    """Convert a robot into a folder that is thrown away, and look at its start.

    Args:
        source: The URDF, its bytes as Latin-1.
        file: What it is called.
        folder: Where its assets start.
        packages: Folder of each package that may be read, by name.
        start: What `robot.toml` says of the start pose.

    Returns:
        `refused`: why the conversion fails, empty where it does not; `touching`: pairs of links that would penetrate
        each other at the start if links collided, with the depth, m; `tips_at`: see `balance.tips_at`.
    """
    named = {name: Path(path) for name, path in packages.items()}
    text, info = source.encode("latin-1"), RobotInfo(start=start)
    robot = Description(Path(file).stem, file, "urdf", text, Path(folder), info, packages=named)
    warnings.simplefilter("ignore")
    try:
        with tempfile.TemporaryDirectory() as empty:
            conversion = convert(robot, thorough=False)
            write_conversion(conversion, Path(empty) / "robot.xml")
        pose = start_pose(compile_spec(conversion.spec.copy(), file), start, file)
        found = {"tips_at": tips_at(conversion.spec.copy(), pose, file)}
        return found | {"refused": "", "touching": link_overlaps(conversion.spec, file)}
    except (MorphkitError, ValueError) as error:
        return {"refused": " ".join(str(error).split()), "touching": []}
