"""Rows of a report as CSV, and numbers for people."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from typing import Any

from morphkit.utils.printable import one_line
from morphkit_rl.benchmark.statistics import Estimate

MISSING = "–"


def comma_separated(rows: Sequence[Mapping[str, Any]]) -> str:
    """Rows as CSV with the keys of the first as heading; None is an empty cell."""
    if not rows:
        return ""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(
        {key: one_line(value) if isinstance(value, str) else value for key, value in row.items()} for row in rows
    )
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
