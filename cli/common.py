"""What the commands share: results on stdout, everything else on stderr, files written in one step."""

from __future__ import annotations

import json
import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from morphkit.errors import OutputError

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from morphkit.description import Description

PIPE_WIDTH = 240
"""Columns of a table that goes into a pipe or a file, so that its rows stay whole."""


class UsageError(typer.BadParameter):
    """Arguments that make no sense together."""

    def format_message(self) -> str:
        """The message as it is, without Typer's `Invalid value`."""
        return self.message


def results() -> Console:
    """The console for results, on stdout."""
    return _console(sys.stdout)


def notes() -> Console:
    """The console for everything else, on stderr."""
    return _console(sys.stderr)


def _console(stream: Any) -> Console:
    from rich.console import Console

    class PipeConsole(Console):
        """Leaves a closed pipe to `main`, which ends quietly; rich itself would exit with 1."""

        def on_broken_pipe(self) -> None:
            raise BrokenPipeError

    width = None if stream.isatty() or "COLUMNS" in os.environ else PIPE_WIDTH
    return PipeConsole(file=stream, width=width, highlight=False, emoji=False, markup=False, soft_wrap=False)


def table(*columns: str, right: tuple[str, ...] = ()) -> Table:
    """An empty table with these columns.

    Args:
        columns: Headings.
        right: Those of them that hold numbers and stand at the right.

    Returns:
        A table without lines beside the one under the headings.
    """
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    result = Table(box=SIMPLE_HEAD, pad_edge=False, show_edge=False)
    for column in columns:
        result.add_column(column, justify="right" if column in right else "left", overflow="fold")
    return result


def print_json(value: Any) -> None:
    """Print `value` on stdout as JSON, with two spaces of indentation; infinite and undefined numbers become null."""
    sys.stdout.write(json.dumps(_finite(value), indent=2, allow_nan=False) + "\n")


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float) and (value != value or value in (float("inf"), float("-inf"))):
        return None
    return value


def write_text(path: Path, text: str) -> None:
    """Write `text` to `path` under a temporary name and rename it, so that no half-written file is left.

    Raises:
        OutputError: The folder does not exist, or the file cannot be written there.
    """
    if path.is_dir():
        raise OutputError(f"{path} is a folder; --output takes the name of a file.")
    temporary = None
    try:
        with tempfile.NamedTemporaryFile(
            "w", encoding="utf-8", newline="", dir=path.parent, prefix=f".{path.name}.", delete=False
        ) as file:
            temporary = Path(file.name)
            file.write(text)
        mask = os.umask(0)
        os.umask(mask)
        temporary.chmod(0o666 & ~mask)
        temporary.replace(path)
    except OSError as error:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
        raise OutputError(f"{path} cannot be written: {error.strerror or error}.") from error


def count(number: int, singular: str) -> str:
    """`1 limb`, `7 limbs`, `4 bodies`."""
    plural = f"{singular[:-1]}ies" if singular.endswith("y") else f"{singular}s"
    return f"{number} {singular if number == 1 else plural}"


def duration(seconds: float) -> str:
    """`45 s`, `3 min 20 s`, `2 h 05 min`."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"


def load_bodies(targets: Sequence[str]) -> list[Description]:
    """Load every body that the targets name: shipped robots, files, folders of files and manifests.

    Raises:
        UnknownNameError: Two different bodies have one name, so that results could not tell them apart.
    """
    from morphkit.errors import UnknownNameError
    from morphkit.robots import load_all

    bodies: dict[str, Description] = {}
    for target in targets:
        for description in load_all(target):
            known = bodies.setdefault(description.name, description)
            if known.source != description.source:
                raise UnknownNameError(
                    f"two different bodies are called {description.name}; the second is in {target}. "
                    "Rename one of the files, or give morphkit ablate a --name."
                )
    return list(bodies.values())
