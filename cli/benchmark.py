"""`morphkit benchmark robots`, `status` and `report`: the bodies of the benchmark, and what became of a matrix."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from morphkit.utils.printable import one_line

from . import common
from .table import table, terminal_width
from .terminal import note, write, write_json

if TYPE_CHECKING:
    from morphkit_rl.benchmark.cells import Status

FILE_HELP = "TOML file with tasks and splits of your own, in addition to the published ones."

ROBOTS_EXAMPLES = (
    "morphkit benchmark robots",
    "morphkit benchmark robots --png bodies.png",
)
STATUS_EXAMPLES = ("morphkit benchmark status runs/benchmark",)
REPORT_EXAMPLES = (
    "morphkit benchmark report runs/benchmark",
    "morphkit benchmark report runs/benchmark --out report",
)


def robots(
    file: Annotated[Path | None, typer.Option(metavar="FILE", help=FILE_HELP)] = None,
    png: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw all bodies side by side, to one scale, into this PNG.")
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print JSON, with the limbs that training never shows.")
    ] = False,
) -> None:
    """List the bodies of the benchmark: limbs, expert return, and their place in each split.

    Each name works wherever a robot does: the body is cut from its full robot when it is asked for.
    """
    from morphkit_rl.benchmark.bodies import members, unseen_limbs
    from morphkit_rl.benchmark.definition import load_benchmark

    benchmark = load_benchmark(file)
    found = members(benchmark)
    rows: list[dict[str, Any]] = [
        {
            "name": member.description.name,
            "group": member.group,
            "limbs": list(member.limbs),
            "expert_return": member.description.info.expert_return,
            "splits": {split: member.splits.get(split) for split in benchmark.splits},
        }
        for member in found
    ]
    if png is not None:
        _draw([member.description for member in found], png)
    if as_json:
        unseen = {split: unseen_limbs(benchmark, split) for split in benchmark.splits}
        common.print_json({"robots": rows, "unseen_limbs": unseen})
        return
    splits = [f"split {split}" for split in benchmark.splits]
    cells = [
        (
            row["name"],
            *(row["splits"][split] or "-" for split in benchmark.splits),
            "-" if row["expert_return"] is None else f"{row['expert_return']:.0f}",
            ", ".join(row["limbs"]),
        )
        for row in rows
    ]
    columns = ("name", *splits, "expert", "limbs")
    write(table(columns, cells, right=("expert",), fold=True, width=terminal_width()))


def _draw(bodies: Sequence[Any], png: Path) -> None:
    from morphkit.simulation.build import build_simulation
    from morphkit.viewer.media import family_sheet

    note(f"drawing {common.count(len(bodies), 'body')}")
    family_sheet([build_simulation(body) for body in bodies], png, columns=8, width=240, height=200)
    note(f"picture: {png}")


def status(
    matrix: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a matrix: --out of morphkit benchmark run.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Show how far each cell of a matrix is: done, running, failed, stopped or not started."""
    from morphkit_rl.benchmark.cells import read_matrix

    print_cells(read_matrix(matrix), as_json=as_json)


def print_cells(found: Sequence[Status], *, as_json: bool = False) -> None:
    """Print cells as JSON, or a table of them and how many are in which state."""
    if as_json:
        common.print_json([_cell(each) for each in found])
        return
    numbers = ("seed", "steps")
    cells = [
        [
            str(row[column]) if row[column] is not None else "-"
            for column in ("split", "task", "method", "seed", "state")
        ]
        + ["-" if row["steps"] is None else f"{row['steps']:,}".replace(",", " "), row["detail"].partition("\n")[0]]
        for row in map(_cell, found)
    ]
    columns = ("split", "task", "method", "seed", "state", "steps", "detail")
    write(table(columns, cells, right=numbers, fold=True, width=terminal_width()))
    states = [each.state for each in found]
    counts = ", ".join(f"{states.count(state)} {state}" for state in dict.fromkeys(sorted(states)))
    note("")
    note(f"{common.count(len(found), 'cell')}: {counts}")


def _cell(each: Status) -> dict[str, Any]:
    rows = each.metrics
    return {
        "split": each.cell.split,
        "task": each.cell.task,
        "method": each.cell.method,
        "seed": each.cell.seed,
        "state": each.state,
        "steps": rows[-1]["steps"] if rows else None,
        "detail": each.detail,
        "folder": str(each.folder),
    }


def report(
    matrix: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a matrix: --out of morphkit benchmark run.")],
    out: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Folder of the report.", show_default="DIR/report")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print report.json instead of the names of files.")] = False,
) -> None:
    """Write tables and figures of a matrix, half-done or whole, next to the published numbers.

    report.md to read; cells.csv, robots.csv, tasks.csv and report.json for programs; learning curves and zero-shot
    bars of each split as PNG. Cells that are missing are marked, and every number says how many seeds it is of.
    """
    from morphkit_rl.benchmark.report.write import MARKER, write_report

    folder = out or matrix / "report"
    written = write_report(matrix, folder)
    if as_json:
        write_json((folder / MARKER).read_text("utf-8"))
        return
    for path in written:
        write(f"{one_line(str(path))}\n")
