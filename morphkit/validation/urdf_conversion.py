"""Whether a URDF can be converted; runs in the child of `probe`."""

from __future__ import annotations

import tempfile
import warnings
from pathlib import Path

from morphkit.conversion.convert import convert
from morphkit.conversion.write import write_conversion
from morphkit.description import Description
from morphkit.errors import MorphkitError


def refusal(source: str, file: str, folder: str, packages: dict[str, str]) -> str:
    """Convert a robot into a folder that is thrown away; say why that fails, or nothing.

    Args:
        source: The URDF, its bytes as Latin-1.
        file: What it is called.
        folder: Where its assets start.
        packages: Folder of each package that may be read, by name.
    """
    named = {name: Path(path) for name, path in packages.items()}
    robot = Description(Path(file).stem, file, "urdf", source.encode("latin-1"), Path(folder), packages=named)
    warnings.simplefilter("ignore")
    try:
        with tempfile.TemporaryDirectory() as empty:
            write_conversion(convert(robot, thorough=False), Path(empty) / "robot.xml")
    except (MorphkitError, ValueError) as error:
        return " ".join(str(error).split())
    return ""
