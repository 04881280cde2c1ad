"""`morphkit tokens`: the sensor and actuator tokens of a robot."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from shutil import get_terminal_size
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from . import common

if TYPE_CHECKING:
    from morphkit.tokens import TokenSpec

EXAMPLES = (
    "morphkit tokens cheetah",
    "morphkit tokens walker --naming canonical",
    "morphkit tokens my_robot.urdf --format json --output tokens.json",
)


def tokens(
    robot: Annotated[str, typer.Argument(metavar="ROBOT", help="Name of a shipped robot, or a URDF or MJCF file.")],
    output_format: Annotated[
        Literal["table", "json", "csv"], typer.Option("--format", help="How to print the tokens.")
    ] = "table",
    naming: Annotated[
        Literal["raw", "canonical"],
        typer.Option(help="'raw' keeps the file's limb names; 'canonical' says them in plain words."),
    ] = "raw",
    limb_names: Annotated[
        Literal["body", "joint"], typer.Option(help="Call a limb by its body or link, or by its joint.")
    ] = "body",
    text_style: Annotated[
        Literal["words", "raw"],
        typer.Option(help="Text that the language model reads: words, or the name with its underscores."),
    ] = "words",
    root: Annotated[
        str | None, typer.Option(metavar="NAME", help="The top-level body to take, where the file has several.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="Write to FILE instead of stdout.")
    ] = None,
) -> None:
    """Print the tokens of a robot: every scalar that its limbs sense, and every one that its actuators accept.

    The same file always gives the same bytes.
    """
    from morphkit.io import read
    from morphkit.robots import load
    from morphkit.tokens import tokens as make_tokens

    description = load(robot, root=root)
    spec = make_tokens(
        read(description),
        naming=naming,
        limb_names=limb_names,
        text_style=text_style,
        canonical=description.info.canonical,
    )
    if output_format == "table":
        fits = output is None and sys.stdout.isatty()
        text = _table(spec, width=get_terminal_size().columns if fits else None)
    else:
        text = spec.to_json() if output_format == "json" else spec.to_csv()
    if output is None:
        sys.stdout.write(text)
    else:
        common.write_text(output, text)
        typer.echo(f"{_summary(spec)} -> {output}", err=True)


def _summary(spec: TokenSpec) -> str:
    return (
        f"{spec.morphology}: {common.count(len(spec.limbs), 'limb')}, "
        f"{common.count(len(spec.sensors), 'sensor token')}, {common.count(len(spec.actuators), 'actuator token')}"
    )


def _range(low: float | None, high: float | None) -> str:
    if low is None and high is None:
        return "unbounded"
    return f"{'-inf' if low is None else f'{low:g}'} .. {'inf' if high is None else f'{high:g}'}"


SENSOR_COLUMNS = ("index", "sensor token", "text", "limb", "unit", "range", "frame")
ACTUATOR_COLUMNS = ("index", "actuator token", "text", "limb", "joint", "unit", "range")
DISPENSABLE = ("frame", "text", "limb")
"""Columns that a narrow terminal does without, the first of them first."""


def _table(spec: TokenSpec, *, width: int | None) -> str:
    """The tokens as text, at most `width` columns wide where leaving columns out can do it."""
    sensors = [
        (str(s.index), s.name, s.text, s.limb, s.unit, _range(s.low, s.high), s.frame or "-") for s in spec.sensors
    ]
    actuators = [
        (str(a.index), a.name, a.text, a.limb or "-", a.joint or "-", a.unit, _range(a.low, a.high))
        for a in spec.actuators
    ]
    parts = [
        _summary(spec),
        f"file {spec.file} ({spec.format}), base {spec.base}, family {spec.family or '-'}, "
        f"task {spec.task or '-'}, naming {spec.naming}",
        "",
        *_lines(SENSOR_COLUMNS, sensors, width),
        "",
        *(_lines(ACTUATOR_COLUMNS, actuators, width) if actuators else ["no actuators"]),
    ]
    return "\n".join(parts) + "\n"


def _lines(columns: Sequence[str], rows: Sequence[Sequence[str]], width: int | None) -> list[str]:
    """Heading, rule and rows. Written out by hand: rich takes a second for the rows of a large robot."""
    widths = {name: max(map(len, (name, *cells))) for name, *cells in zip(columns, *rows, strict=True)}
    shown = list(columns)
    for name in DISPENSABLE:
        if width is not None and sum(widths[name] + 2 for name in shown) - 2 > width and name in shown:
            shown.remove(name)
    keep = [(columns.index(name), widths[name], name == "index") for name in shown]

    def line(cells: Sequence[str]) -> str:
        padded = (cells[i].rjust(size) if right else cells[i].ljust(size) for i, size, right in keep)
        return "  ".join(padded).rstrip()

    rule = "─" * (sum(size + 2 for _, size, _ in keep) - 2)
    return [line(columns), rule, *map(line, rows)]
