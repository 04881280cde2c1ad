"""`morphkit tokens`: the sensor and actuator tokens of a robot."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from morphkit.utils.printable import one_line

from . import common
from .table import table, terminal_width
from .terminal import note, write, write_json

if TYPE_CHECKING:
    from morphkit.tokens.spec import TokenSpec

SENSOR_COLUMNS = ("index", "sensor token", "text", "limb", "unit", "range", "frame")
ACTUATOR_COLUMNS = ("index", "actuator token", "text", "limb", "joint", "unit", "range")
SHOWN = 4

EXAMPLES = (
    "morphkit tokens cheetah",
    "morphkit tokens walker --naming canonical",
    "morphkit tokens my_robot.urdf --json --output tokens.json",
    "morphkit tokens cheetah --sensors position,translational_velocity",
    "morphkit tokens my_robot.xml --source all",
)


def tokens(
    robot: common.RobotArgument,
    output_format: Annotated[
        Literal["table", "json", "csv"] | None,
        typer.Option("--format", help="How to print the tokens.", show_default="table"),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="The same as --format json.")] = False,
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
    source: Annotated[
        Literal["limb", "declared", "all"],
        typer.Option(help="What every limb senses; what the sensors in the file read; or both."),
    ] = "limb",
    sensors: Annotated[
        list[str] | None,
        typer.Option(
            "--sensors",
            "--quantity",
            metavar="NAME,...",
            help="Quantities that are sensed, such as position, as in trainer.sensors; may be given often. 'no_ltv': "
            "all but 'type'.",
            show_default="all",
        ),
    ] = None,
    root: common.RootOption = None,
    package: common.PackageOption = None,
    xacro_arg: common.XacroArgOption = None,
    trust_xacro: common.TrustXacroOption = False,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE", help="Write to FILE instead of stdout.")
    ] = None,
) -> None:
    """Print the tokens of a robot: every scalar that its limbs (or sensors) sense, and every one that its actuators
    accept.

    The same file always gives the same bytes.
    """
    printed = common.output_format(output_format, "table", as_json=as_json)
    from morphkit.readers import read
    from morphkit.tokens.declared_sensors import without_scalars
    from morphkit.tokens.selection import take_quantities
    from morphkit.tokens.spec import token_spec

    (description,) = common.load_robots(robot, root=root, package=package, xacro_arg=xacro_arg, trust_xacro=trust_xacro)
    morphology = read(description)
    spec = token_spec(
        morphology,
        naming=naming,
        limb_names=limb_names,
        text_style=text_style,
        canonical=description.info.canonical,
        source=source,
    )
    spec = take_quantities(spec, [name for names in sensors or () for name in names.split(",")])
    if source != "limb" and (silent := without_scalars(morphology)):
        note(f"note: no scalars from {', '.join(silent)}")
    if spec.given_names:
        note(f"note: {_given_names(spec)}")
    if printed == "table":
        text = _table(spec, width=terminal_width() if output is None else None)
    else:
        text = spec.to_json() if printed == "json" else spec.to_csv()
    if output is None:
        write_json(text) if printed == "json" else write(text)
    else:
        common.write_text(output, text)
        note(f"{_summary(spec)} -> {output}")


def _summary(spec: TokenSpec) -> str:
    return (
        f"{spec.morphology}: {common.count(len(spec.limbs), 'limb')}, "
        f"{common.count(len(spec.sensors), 'sensor token')}, {common.count(len(spec.actuators), 'actuator token')}"
    )


def _given_names(spec: TokenSpec) -> str:
    """How many names are given ones, with the first few and what each stands for."""
    shown = []
    for each in spec.given_names[:SHOWN]:
        what = f"{each.kind} {each.original!r}" if each.original is not None else f"a {each.kind} without a name"
        shown.append(f"{each.given!r} is {what}" + (f" at {each.where}" if each.where else ""))
    rest = len(spec.given_names) - len(shown)
    more = f"; {rest} more, see given_names in the JSON form" if rest else ""
    return f"{common.count(len(spec.given_names), 'name')} not as in the file: {'; '.join(shown)}{more}"


def _range(low: float | None, high: float | None) -> str:
    if low is None and high is None:
        return "unbounded"
    return f"{'-inf' if low is None else f'{low:g}'} .. {'inf' if high is None else f'{high:g}'}"


def _table(spec: TokenSpec, *, width: int | None) -> str:
    """The tokens as text, at most `width` columns wide where leaving columns out can do it."""
    sensors = [
        (str(s.index), s.name, s.text, s.limb or "-", s.unit, _range(s.low, s.high), s.frame or "-")
        for s in spec.sensors
    ]
    actuators = [
        (str(a.index), a.name, a.text, a.limb or "-", a.joint or "-", a.unit, _range(a.low, a.high))
        for a in spec.actuators
    ]
    about = (
        f"file {spec.file} ({spec.format}), base {spec.base}, family {spec.family or '-'}, "
        f"task {spec.task or '-'}, naming {spec.naming}"
    )
    parts = [
        f"{one_line(_summary(spec))}\n{one_line(about)}\n",
        table(SENSOR_COLUMNS, sensors, right=["index"], dispensable=("frame", "text", "limb"), width=width),
        table(ACTUATOR_COLUMNS, actuators, right=["index"], dispensable=("text", "joint", "limb"), width=width)
        if actuators
        else "no actuators\n",
    ]
    return "\n".join(parts)
