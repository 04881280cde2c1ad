"""Colored text on stdout."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import RenderableType

_UNBROKEN = 10_000


def show(what: RenderableType) -> None:
    """Print what rich can draw: in color on a terminal unless NO_COLOR is set, in whole lines into a pipe or file."""
    from rich.console import Console

    width = None if sys.stdout.isatty() else _UNBROKEN
    Console(width=width, highlight=False, emoji=False, markup=False).print(what)
