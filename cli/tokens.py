"""`morphkit tokens`: the sensor and actuator tokens of a robot."""

from __future__ import annotations

import sys
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from . import common

if TYPE_CHECKING:
    from rich.console import Console

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
    if output_format == "table" and output is None:
        _print_table(spec, common.results())
        return
    text = {"json": spec.to_json, "csv": spec.to_csv, "table": lambda: _table_text(spec)}[output_format]()
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


def _print_table(spec: TokenSpec, console: Console) -> None:
    console.print(_summary(spec))
    console.print(
        f"file {spec.file} ({spec.format}), base {spec.base}, family {spec.family or '-'}, "
        f"task {spec.task or '-'}, naming {spec.naming}\n"
    )
    sensors = common.table("index", "sensor token", "text", "limb", "unit", "range", "frame", right=("index",))
    for sensor in spec.sensors:
        sensors.add_row(
            str(sensor.index),
            sensor.name,
            sensor.text,
            sensor.limb,
            sensor.unit,
            _range(sensor.low, sensor.high),
            sensor.frame or "-",
        )
    console.print(sensors)
    console.print()
    if not spec.actuators:
        console.print("no actuators")
        return
    actuators = common.table("index", "actuator token", "text", "limb", "joint", "unit", "range", right=("index",))
    for actuator in spec.actuators:
        actuators.add_row(
            str(actuator.index),
            actuator.name,
            actuator.text,
            actuator.limb or "-",
            actuator.joint or "-",
            actuator.unit,
            _range(actuator.low, actuator.high),
        )
    console.print(actuators)


def _table_text(spec: TokenSpec) -> str:
    from rich.console import Console

    file = StringIO()
    _print_table(spec, Console(file=file, width=common.PIPE_WIDTH, highlight=False, emoji=False, markup=False))
    return file.getvalue()
