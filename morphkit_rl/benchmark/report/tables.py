"""Tables of a report, as Markdown and as CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from typing import Any

from morphkit_rl.benchmark.statistics import Estimate

MISSING = "–"


def markdown(columns: Sequence[str], rows: Sequence[Sequence[str]], *, right: Sequence[str] = ()) -> str:
    """A Markdown table; the columns in `right` are aligned right."""
    rules = ["--:" if column in right else "---" for column in columns]
    lines = [[cell.replace("|", "\\|").replace("\n", " ") for cell in row] for row in (columns, rules, *rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def comma_separated(rows: Sequence[Mapping[str, Any]]) -> str:
    """Rows as CSV with the keys of the first as heading; None is an empty cell."""
    if not rows:
        return ""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def show(value: float | None, digits: int = 0) -> str:
    """A number for people, or a dash."""
    return MISSING if value is None else f"{value:,.{digits}f}".replace(",", " ")


def show_estimate(found: Estimate | None, digits: int = 0) -> str:
    """`2 110 [1 980, 2 240]`; without brackets where there is no interval."""
    if found is None:
        return MISSING
    if found.low is None:
        return show(found.value, digits)
    return f"{show(found.value, digits)} [{show(found.low, digits)}, {show(found.high, digits)}]"


def flat(name: str, found: Estimate | None) -> dict[str, float | None]:
    """An estimate as three columns: `name`, `name_low`, `name_high`."""
    if found is None:
        return {name: None, f"{name}_low": None, f"{name}_high": None}
    return {name: found.value, f"{name}_low": found.low, f"{name}_high": found.high}
