"""Tables of text. Written out by hand: rich takes a second for the thousand tokens of a large robot."""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Sequence
from shutil import get_terminal_size

from morphkit.utils.printable import one_line

GAP = "  "
FOLD_WIDTH = 24
"""Narrowest that the last column gets when it is folded."""


def terminal_width() -> int | None:
    """Columns of the terminal that stdout is; None for a pipe or a file, where rows stay whole."""
    return get_terminal_size().columns if sys.stdout.isatty() else None


def table(
    columns: Sequence[str],
    rows: Sequence[Sequence[str]],
    *,
    right: Sequence[str] = (),
    dispensable: Sequence[str] = (),
    fold: bool = False,
    width: int | None = None,
) -> str:
    """Lay out a table.

    Args:
        columns: Headings.
        rows: Cells, one a column.
        right: Headings of the columns that are aligned right.
        dispensable: Headings of the columns that a narrow terminal does without, the first of them first.
        fold: Whether the last column may take several lines.
        width: Columns to fit into, as far as leaving out and folding can do it; None for no bound.

    Returns:
        Heading, rule and rows, with a newline at the end.
    """
    rows = [[one_line(cell) for cell in cells] for cells in rows]
    widths = {name: max(map(len, (name, *cells))) for name, *cells in zip(columns, *rows, strict=True)}
    shown, last = list(columns), columns[-1]

    def excess() -> int:
        narrowest = widths | ({last: min(widths[last], FOLD_WIDTH)} if fold else {})
        return sum(narrowest[name] + len(GAP) for name in shown) - len(GAP) - (width or sys.maxsize)

    for name in dispensable:
        if excess() > 0:
            shown.remove(name)
    if fold and width is not None and last in shown:
        others = sum(widths[name] + len(GAP) for name in shown[:-1])
        widths[last] = min(widths[last], max(width - others, FOLD_WIDTH))

    def lines(cells: Sequence[str]) -> list[str]:
        by_name = dict(zip(columns, cells, strict=True))
        folded = textwrap.wrap(by_name[last], widths[last]) if fold else [by_name[last]]
        start = [by_name[name] for name in shown if name != last]
        result = []
        for index, text in enumerate(folded or [""]):
            parts = [*(start if index == 0 else [""] * len(start)), *([text] if last in shown else [])]
            padded = (
                part.rjust(widths[name]) if name in right else part.ljust(widths[name])
                for name, part in zip(shown, parts, strict=True)
            )
            result.append(GAP.join(padded).rstrip())
        return result

    rule = "─" * (sum(widths[name] + len(GAP) for name in shown) - len(GAP))
    body = [line for row in rows for line in lines(row)]
    return "\n".join([*lines(columns), rule, *body]) + "\n"
