"""`morphkit convert`: a URDF as a simulatable MJCF."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from morphkit.utils.printable import one_line

from . import common
from .table import table, terminal_width
from .terminal import write

if TYPE_CHECKING:
    from collections.abc import Sequence

    from morphkit.conversion.convert import ConversionReport
    from morphkit.conversion.unsupported import Missing

SCHEMA_VERSION = 1
SHOWN_NAMES = 4

EXAMPLES = (
    "morphkit convert my_robot.urdf my_robot.xml",
    "morphkit convert my_robot.urdf out/robot.xml --base free --package my_robot_description=~/ws/src/my_robot",
    "morphkit convert quadruped quadruped.xml --no-floor --json",
)


def convert(
    robot: Annotated[str, typer.Argument(metavar="FILE", help="The URDF, or the name of a shipped robot.")],
    output: Annotated[
        Path, typer.Argument(metavar="OUT.xml", help="The MJCF; its meshes go into OUT_assets next to it.")
    ],
    base: Annotated[
        Literal["free", "planar", "fixed"] | None,
        typer.Option(help="How to attach the root; without this, as the URDF says.", show_default=False),
    ] = None,
    floor: Annotated[
        bool | None,
        typer.Option("--floor/--no-floor", help="Add a floor; without this, where the base moves.", show_default=False),
    ] = None,
    root: Annotated[
        str | None, typer.Option(metavar="NAME", help="The root link to take, where the file has several.")
    ] = None,
    package: common.PackageOption = None,
    xacro_arg: common.XacroArgOption = None,
    trust_xacro: common.TrustXacroOption = False,
    force: Annotated[bool, typer.Option("--force", help="Replace OUT.xml and OUT_assets where they exist.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print what was done as JSON.")] = False,
) -> None:
    """Convert a URDF into an MJCF that MuJoCo simulates: with motors, limits, mimics, meshes and all fixed links.

    What was added or changed is listed, and what is in the URDF and has no counterpart in MJCF.
    """
    from morphkit.conversion.write import check_target, convert_to

    check_target(output, force=force)
    (description,) = common.load_robots(robot, root=root, package=package, xacro_arg=xacro_arg, trust_xacro=trust_xacro)
    conversion, written = convert_to(output, description, base=base, floor=floor, force=force)
    if as_json:
        common.print_json(_to_json(conversion, written))
    else:
        write(_text(conversion, written))


def _to_json(conversion: ConversionReport, written: Sequence[Path]) -> dict[str, Any]:
    return {
        "schema_version": SCHEMA_VERSION,
        "source": {"file": conversion.description.file, "sha256": conversion.description.sha256},
        "output": str(written[0]),
        "assets": [str(path) for path in written[1:]],
        "base": conversion.base,
        "bodies": conversion.bodies,
        "joints": conversion.joints,
        "motors": conversion.motors,
        "mass": conversion.mass,
        "notes": list(conversion.notes),
        "without_counterpart": [
            {"kind": each.kind, "name": each.name or None, "line": each.line, "reason": each.reason}
            for each in conversion.missing
        ],
    }


def _text(conversion: ConversionReport, written: Sequence[Path]) -> str:
    size = ", ".join(
        common.count(number, what)
        for number, what in (
            (conversion.bodies, "body"),
            (conversion.joints, "joint"),
            (conversion.motors, "motor"),
        )
    )
    lines = [
        one_line(f"{conversion.description.file}: {size}, {conversion.mass:.4g} kg, base {conversion.base}") + "\n"
    ]
    lines += [f"  {one_line(note)}\n" for note in conversion.notes]
    if conversion.missing:
        lines.append("\nwithout counterpart in MJCF:\n")
        columns = ("kind", "number", "why", "names")
        rows = _grouped(conversion.missing)
        lines.append(table(columns, rows, right=["number"], fold=True, width=terminal_width()))
    meshes = f" and {common.count(len(written) - 1, 'file')} in {written[1].parent}/" if len(written) > 1 else ""
    lines.append("\n" + one_line(f"written: {written[0]}{meshes}") + "\n")
    return "".join(lines)


def _grouped(missing: Sequence[Missing]) -> list[tuple[str, str, str, str]]:
    """One row a kind and reason, with the first names; numbers in brackets differ and are in the JSON."""
    groups: dict[tuple[str, str], list[str]] = {}
    for each in missing:
        reason = each.reason.partition(" (")[0]
        groups.setdefault((each.kind, reason), []).append(each.name or f"line {each.line}")
    return [
        (kind, str(len(names)), reason, ", ".join(names[:SHOWN_NAMES]) + (", ..." if len(names) > SHOWN_NAMES else ""))
        for (kind, reason), names in groups.items()
    ]
