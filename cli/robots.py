"""`morphkit robots`: the robots that ship with morphkit."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from . import common
from .table import table, terminal_width
from .terminal import note, write

if TYPE_CHECKING:
    from morphkit.description import Description

EXAMPLES = (
    "morphkit robots",
    "morphkit robots --json",
)


def robots(
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, with licenses and recipes.")] = False,
) -> None:
    """List the robots that ship with morphkit.

    A name from this list works wherever a file does, and so does the name of a recipe: a body of
    the benchmark that is cut from its full robot when it is asked for, such as cheetah_3_balanced.
    """
    from morphkit.registry import shipped

    rows = [_row(description) for description in shipped()]
    if as_json:
        common.print_json(rows)
        return
    numbers = ("limbs", "joints", "actuators")
    columns = ("name", "family", *numbers, "base", "task", "description")
    cells = [[str(row[column] if row[column] is not None else "-") for column in columns] for row in rows]
    write(table(columns, cells, right=numbers, dispensable=("family", "joints"), fold=True, width=terminal_width()))
    recipes = sum(len(row["recipes"]) for row in rows)
    note("")
    note(f"{common.count(recipes, 'recipe')} of bodies cut from them: morphkit robots --json")


def _row(description: Description) -> dict[str, Any]:
    from morphkit.readers import read
    from morphkit.registry import recipes

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
