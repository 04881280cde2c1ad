"""What `morphkit ablate` prints: what matched, the tree with what goes, what was lost, and families as a table."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from itertools import repeat
from typing import TYPE_CHECKING, Any

from morphkit.errors import MorphkitError
from morphkit.utils.printable import one_line

from . import common
from .table import table, terminal_width

if TYPE_CHECKING:
    from morphkit.ablation.ablate import Cutter, Variant
    from morphkit.families.build import FailedVariant, Made
    from morphkit.morphology import Morphology


_FACTORS = ("length", "mass", "gain")


class Tally:
    """What was made, kept small: a row for each variant, and the whole of a single one.

    Attributes:
        every: Whether it is a family, or several bodies of other proportions.
        made: How many variants there are.
        failed: The variants that could not be made.
    """

    def __init__(self, *, every: bool, title: str) -> None:
        self.every = every
        self.made = 0
        self.failed: list[FailedVariant] = []
        self._title = title
        self._mirrored: list[tuple[str, str]] = []
        self._rows: list[tuple[str, ...]] = []
        self._single = ""

    def enter(self, made: Made) -> Made:
        """Note `made`, and return it."""
        from morphkit.families.build import FailedVariant, MirroredVariant

        if isinstance(made, FailedVariant):
            self.failed.append(made)
        elif isinstance(made, MirroredVariant):
            self._mirrored.append((made.name, made.mirrors))
        else:
            self.made += 1
            if self.every:
                gone = ", ".join((*made.removed, *made.spliced))
                left = ", ".join(made.limbs)
                row = (made.description.name, str(len(made.limbs)), gone, str(len(made.lost)))
                self._rows.append((*row, *map(_spread, _FACTORS, repeat(made)), left))
            else:
                self._single = _variant(made)
        return made

    def text(self) -> str:
        """What there is to read about it."""
        if not self.every:
            return self._title + self._single
        parts = [self._title] if self._title else []
        if self._rows:
            known = ("variant", "limbs", "gone", "also lost", *_FACTORS, "left")
            kept = [number for number, name in enumerate(known) if name not in _FACTORS or self._has(number)]
            columns, *rows = ([row[number] for number in kept] for row in (known, *self._rows))
            right, dispensable = ("limbs", "also lost"), ("also lost", "gone")
            parts.append(table(columns, rows, right=right, dispensable=dispensable, fold=True, width=terminal_width()))
        if self._mirrored:
            parts.append(table(("left out", "mirror image of"), self._mirrored, fold=True, width=terminal_width()))
        return "\n".join(parts)

    def _has(self, column: int) -> bool:
        return any(row[column] for row in self._rows)


def matches(cutter: Cutter, wish: Mapping[str, Sequence[str]], *, mirror: bool) -> str:
    """A line for each pattern: what it matched, and with `mirror` what came along from the other side."""
    from morphkit.naming.patterns import match_limbs

    lines = []
    for verb, patterns in wish.items():
        for pattern in patterns:
            matched = match_limbs(cutter.morphology, pattern)
            images = [cutter.counterparts().get(name, name) for name in matched] if mirror else []
            others = [name for name in dict.fromkeys(images) if name not in matched]
            along = f"; mirrored: {', '.join(others)}" if others else ""
            lines.append(one_line(f"{verb} '{pattern}' matched: {', '.join(matched)}{along}") + "\n")
    return "".join(lines)


def tree(morphology: Morphology, made: Made) -> str:
    """The limbs of the source, with what goes; fixed bodies only where they go without their limb."""
    variant = _only_variant(made)
    gone = dict.fromkeys(variant.removed, "removed") | dict.fromkeys(variant.spliced, "spliced: its children move up")
    rows: list[tuple[str, str]] = []

    def add(name: str, first: str, rest: str) -> None:
        rows.append((first + name, gone.get(name, "")))
        limb = morphology.limb(name)
        fixed = [member for member in limb.members[1:] if member in gone and name not in gone]
        below = [*fixed, *(child.name for child in morphology.children(name))]
        for number, child in enumerate(below):
            last = number == len(below) - 1
            bend, line = ("└── ", "    ") if last else ("├── ", "│   ")
            if child in fixed:
                rows.append((f"{rest}{bend}{child} (fixed)", gone[child]))
            else:
                add(child, rest + bend, rest + line)

    add(morphology.root.name, "", "")
    rows = [(one_line(name), what) for name, what in rows]
    width = max(len(name) for name, _ in rows) + 2
    return "".join(f"{name.ljust(width)}✗ {what}\n" if what else f"{name}\n" for name, what in rows)


def as_json(made: Made) -> dict[str, Any]:
    """What a dry run says of a variant."""
    from morphkit.ablation.ablate import Variant

    if not isinstance(made, Variant):
        return asdict(made)
    return {
        "name": made.description.name,
        "removed": made.removed,
        "spliced": made.spliced,
        "limbs": made.limbs,
        "lost": [asdict(loss) for loss in made.lost],
        **({"scaled": {limb: asdict(scale) for limb, scale in made.scaled.items()}} if made.scaled else {}),
    }


def with_progress(made: Iterator[Made], *, limit: int | None, quiet: bool) -> Iterator[Made]:
    """Pass variants on; a terminal on stderr sees how many there are, how fast they come and how long it will take."""
    if quiet or not sys.stderr.isatty():
        yield from made
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    # Without a thread that refreshes: workers are forked from this process.
    with Progress(TextColumn("variants"), *columns, console=Console(stderr=True), auto_refresh=False) as bar:
        task = bar.add_task("variants", total=limit)
        for each in made:
            yield each
            bar.update(task, advance=1, refresh=True)


def _spread(what: str, variant: Variant) -> str:
    """Lowest and highest factor of a variant's limbs; empty where none is scaled."""
    factors = [getattr(scale, what) for scale in variant.scaled.values()]
    low, high = min(factors, default=1.0), max(factors, default=1.0)
    return "" if low == high == 1 else f"{low:.2f}" if low == high else f"{low:.2f} to {high:.2f}"


def _variant(variant: Variant) -> str:
    lines = [
        one_line(f"{word + ':':<10}{', '.join(limbs)}") + "\n"
        for word, limbs in (("removed", variant.removed), ("spliced", variant.spliced), ("left", variant.limbs))
        if limbs
    ]
    if variant.lost:
        lines.append(f"\n{common.count(len(variant.lost), 'other element')} lost:\n")
        rows = [(loss.kind, loss.name or "-", loss.limb or "-", loss.reason) for loss in variant.lost]
        lines.append(table(("kind", "name", "limb", "reason"), rows, fold=True, width=terminal_width()))
    return "".join(lines)


def _only_variant(made: Made) -> Variant:
    from morphkit.ablation.ablate import Variant

    if not isinstance(made, Variant):
        raise MorphkitError(f"{made.name} could not be made")
    return made
