"""What reaches a terminal: text without control characters, whatever the names in it are; colors are our own."""

from __future__ import annotations

import json
import re
import sys
import warnings
from typing import TYPE_CHECKING, Any

import typer

from morphkit.utils.printable import UNSAFE, one_line, printable

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.text import Text

_UNBROKEN = 10_000
_format_warning = warnings.formatwarning


def line(text: str, style: str = "") -> Text:
    """A line for rich."""
    from rich.text import Text

    return Text(one_line(text), style=style)


def assembled(*parts: str | tuple[str, str]) -> Text:
    """A line for rich of parts, each a text or a text and its style."""
    from rich.text import Text

    return Text.assemble(*(one_line(part) if isinstance(part, str) else (one_line(part[0]), part[1]) for part in parts))


def write(text: str) -> None:
    """Write text to stdout."""
    sys.stdout.write(printable(text))


def write_json(text: str) -> None:
    """Write JSON to stdout, with JSON's own escapes for what is not printable."""
    sys.stdout.write(UNSAFE.sub(lambda found: json.dumps(found[0])[1:-1], text))


def note(text: str) -> None:
    """Write a line to stderr; what continues it on further lines is indented."""
    sys.stderr.write(re.sub(r"\n(?! )", r"\\n", printable(text)) + "\n")
    sys.stderr.flush()


def label(word: str, color: str) -> None:
    """Write a word of our own to stderr, in color on a terminal."""
    typer.secho(word, fg=color, bold=True, nl=False, err=True)


def show(what: RenderableType) -> None:
    """Print what rich can draw: in color on a terminal unless NO_COLOR is set, in whole lines into a pipe or file."""
    from rich.console import Console

    width = None if sys.stdout.isatty() else _UNBROKEN
    show_on(Console(width=width, highlight=False, emoji=False, markup=False), what)


def show_on(console: Console, what: RenderableType) -> None:
    """Print what rich can draw on a console."""
    from rich.segment import Segment, Segments

    segments: list[Segment] = []
    for each in console.render_lines(what, pad=False):
        segments += [Segment(printable(part.text), part.style, part.control) for part in each]
        segments.append(Segment.line())
    console.print(Segments(segments), end="")


def guard_warnings() -> None:
    """Let Python's warnings, which repeat what MuJoCo says of names, be printable too."""
    warnings.formatwarning = _printable_warning


def _printable_warning(*arguments: Any, **options: Any) -> str:
    return printable(_format_warning(*arguments, **options))
