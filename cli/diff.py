"""`morphkit diff`: what changed between two robots."""

from __future__ import annotations

from typing import Annotated

import typer

from . import common
from .terminal import note

EXAMPLES = (
    "morphkit diff cheetah cheetah_3_balanced",
    "morphkit diff my_robot.urdf my_robot.xml --tolerance 1e-4",
    "morphkit diff before.xml after.xml --json",
)


def diff(
    first: Annotated[str, typer.Argument(metavar="A", help="Name of a shipped robot, or a URDF or MJCF file.")],
    second: Annotated[str, typer.Argument(metavar="B", help="The robot to compare it with, in either format.")],
    tolerance: Annotated[
        float,
        typer.Option(min=0.0, metavar="SHARE", help="Numbers are equal that differ by at most this share."),
    ] = 1e-6,
    root: Annotated[
        str | None, typer.Option(metavar="NAME", help="The top-level body to take, where the files have several.")
    ] = None,
    package: common.PackageOption = None,
    xacro_arg: common.XacroArgOption = None,
    trust_xacro: common.TrustXacroOption = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print every change as JSON.")] = False,
) -> None:
    """Show what changed from one robot to another: limbs, joints, actuators, masses and tokens.

    Limbs are found again by name, else by their joints and place. Exit code 0 where nothing changed, 1 where something
    did.
    """
    from morphkit.comparison.compare import compare

    a, b = common.load_robots(first, second, root=root, package=package, xacro_arg=xacro_arg, trust_xacro=trust_xacro)
    comparison = compare(a, b, tolerance=tolerance)
    for robot, facts in ((first, comparison.first), (second, comparison.second)):
        for text in facts.notes:
            note(f"note: {robot}: {text.splitlines()[0]}")
    if as_json:
        common.print_json(comparison.to_dict())
    else:
        from .diff_report import render
        from .terminal import show

        show(render(comparison))
    if not comparison.equal:
        raise typer.Exit(1)
