"""A URDF through `convert`, and through `check` where that refuses it."""

from __future__ import annotations

import tempfile
from pathlib import Path

from morphkit.conversion.convert import convert
from morphkit.conversion.write import write_conversion
from morphkit.description import Description
from morphkit.errors import MorphkitError
from morphkit.validation.check import check


def refusal(description: Description) -> str:
    """Convert a URDF into a folder that is thrown away; why that is refused, empty where it is not.

    No time step is looked for: that takes long, refuses nothing, and environments look for theirs in the same way.
    """
    try:
        with tempfile.TemporaryDirectory() as folder:
            write_conversion(convert(description, thorough=False), Path(folder) / "robot.xml")
    except MorphkitError as error:
        return " ".join(str(error).split())[:300]
    return ""


def passes_check(path: str, collection: Path) -> bool:
    """Whether `check` finds no error in a file."""
    try:
        return not check(path, packages={"collection": collection}).count("error")
    except MorphkitError:
        return False
