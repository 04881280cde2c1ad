"""`morphkit robots`: the robots that ship with morphkit."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from . import common

if TYPE_CHECKING:
    from morphkit.description import Description

EXAMPLES = (
    "morphkit robots",
    "morphkit robots --json",
)


def robots(
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, with licences and recipes.")] = False,
) -> None:
    """List the robots that ship with morphkit.

    A name from this list works wherever a file does, and so does the name of a recipe: a body of
    the benchmark that is cut from its full robot when it is asked for, such as cheetah_3_balanced.
    """
    from morphkit.robots import shipped

    rows = [_row(description) for description in shipped()]
    if as_json:
        common.print_json(rows)
        return
    numbers = ("limbs", "joints", "actuators", "recipes")
    table = common.table("name", "family", *numbers[:3], "base", "task", "recipes", "description", right=numbers)
    for row in rows:
        table.add_row(
            row["name"],
            row["family"] or "-",
            str(row["limbs"]),
            str(row["joints"]),
            str(row["actuators"]),
            row["base"],
            row["task"] or "-",
            str(len(row["recipes"]) or "-"),
            row["description"],
        )
    common.results().print(table)


def _row(description: Description) -> dict[str, Any]:
    from morphkit.io import read
    from morphkit.robots import recipes

    morphology = read(description)
    info = description.info
    return {
        "name": description.name,
        "file": description.file,
        "format": description.format,
        "family": morphology.family,
        "limbs": len(morphology.limbs),
        "joints": len(morphology.joints),
        "actuators": len(morphology.actuators),
        "base": morphology.base,
        "task": morphology.task,
        "description": info.description,
        "license": info.license,
        "source": info.source,
        "recipes": list(recipes(description.name)),
    }
