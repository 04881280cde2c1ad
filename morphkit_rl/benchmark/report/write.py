"""The report of a matrix: Markdown, CSV, JSON and figures, honest about what is missing."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

from morphkit.errors import OutputError
from morphkit.utils.plain_files import require_plain
from morphkit.utils.staging import staged_folder
from morphkit_rl.benchmark.cells import Status, read_matrix
from morphkit_rl.benchmark.definition import load_benchmark
from morphkit_rl.benchmark.published import published_steps
from morphkit_rl.benchmark.report import tables
from morphkit_rl.benchmark.report.bar_figure import write_bars
from morphkit_rl.benchmark.report.curve_figure import write_curves
from morphkit_rl.benchmark.report.figure_style import order as method_order
from morphkit_rl.benchmark.report.markdown import write_markdown
from morphkit_rl.benchmark.report.origin import origin_row
from morphkit_rl.benchmark.summary import Entry, Improvement, Overall, improvements, overall, robot_rows, summarize

MARKER = "report.json"
"""The file by which a folder is known to be a report, and may be replaced by a newer one."""
_OWN_NAME = re.compile(r"report\.(md|json)|(cells|tasks|robots)\.csv|(training|scores|zero-shot)-split-.+\.png")


def write_report(matrix: Path, folder: Path) -> list[Path]:
    """Write the report of a matrix, whole or half-done.

    Args:
        matrix: Folder of the matrix.
        folder: Folder of the report; an older report there is replaced in one step.

    Returns:
        The files that were written.

    Raises:
        CheckpointError: The folder holds no matrix, or a damaged one.
        OutputError: The report cannot be written, or the folder holds something else.
        DependencyError: matplotlib is not installed.
    """
    cells = read_matrix(matrix)
    _check_target(folder)
    published = load_benchmark()
    # The study's splits show all of the study's panels; splits of one's own show what was asked for.
    splits = list(dict.fromkeys(each.cell.split for each in cells))
    asked = {split: list(dict.fromkeys(e.cell.task for e in cells if e.cell.split == split)) for split in splits}
    panels = {
        split: [*published.tasks, *(task for task in asked[split] if task not in published.tasks)]
        if split in published.splits
        else asked[split]
        for split in splits
    }
    order = {task: place for tasks in panels.values() for place, task in enumerate(tasks)}
    entries = sorted(summarize(cells), key=lambda each: (each.split, order[each.task], method_order(each.method)))
    with_held_out = {split: _with_held_out(split, panels[split], entries) for split in splits}
    totals = overall(entries, lambda split: len(with_held_out[split]))
    pairs = improvements(entries)
    with staged_folder(folder) as stage:
        for split in splits:
            own = [each for each in entries if each.split == split]
            _draw(stage, split, panels[split], with_held_out[split], own, [t for t in totals if t.split == split])
        for name, rows in (
            ("cells", [cell_row(each) for each in cells]),
            ("tasks", [entry_row(each) for each in entries]),
            ("robots", robot_rows(cells)),
        ):
            (stage / f"{name}.csv").write_text(tables.comma_separated(rows), "utf-8")
        (stage / "report.md").write_text(
            write_markdown(matrix, cells, entries, totals, pairs, sorted(path.name for path in stage.glob("*.png"))),
            "utf-8",
        )
        values = _values(matrix, cells, entries, totals, pairs)
        (stage / MARKER).write_text(json.dumps(values, indent=1, allow_nan=False) + "\n", "utf-8")
    return sorted(folder.iterdir())


def _check_target(folder: Path) -> None:
    """Refuse to replace what is not an earlier report and nothing else."""
    require_plain(folder, OutputError)
    if not folder.exists():
        return
    names = sorted(path.name for path in folder.iterdir()) if folder.is_dir() else []
    if not folder.is_dir() or (names and MARKER not in names):
        raise OutputError(f"{folder}: exists and is no report of a benchmark; choose another --out")
    others = [name for name in names if not _OWN_NAME.fullmatch(name) or (folder / name).is_dir()]
    if others:
        raise OutputError(f"{folder}: holds other files than a report, such as {others[0]}; choose another --out")


def cell_row(cell: Status) -> dict[str, Any]:
    """A cell as a row."""
    rows = cell.metrics
    last: Mapping[str, Any] = rows[-1] if rows else {}
    return {
        **{name: getattr(cell.cell, name) for name in ("split", "task", "method", "seed")},
        "state": cell.state,
        "steps": last.get("steps"),
        "real_steps": last.get("real_steps", last.get("steps")),
        "updates": last.get("updates"),
        "elapsed_s": last.get("elapsed_s"),
        "diverged": last.get("diverged"),
        "training_return": (cell.result or {}).get("training_return"),
        "evaluated": (cell.result or {}).get("evaluated"),
        **origin_row(cell),
        "detail": cell.detail,
    }


def entry_row(entry: Entry) -> dict[str, Any]:
    """A task and method as a row."""
    return {
        **{name: getattr(entry, name) for name in ("split", "task", "method")},
        "seeds": len(entry.cells),
        "seeds_done": len(entry.done),
        "held_out_robots": entry.role,
        **tables.flat("training_return", entry.training_return),
        **tables.flat("training_return_noise_free", entry.training_noise_free),
        "published_training_return": entry.published_training,
        **tables.flat("training_score", entry.training_score),
        **tables.flat("held_out_return", entry.held_out),
        "published_held_out_return": entry.published_held_out,
        **tables.flat("held_out_score", entry.held_out_score),
    }


def _with_held_out(split: str, tasks: Sequence[str], entries: Sequence[Entry]) -> list[str]:
    """Tasks of a split that hold robots out."""
    own = {each.task: each for each in entries if each.split == split}
    known = load_benchmark()
    if any(each.role == "validation" for each in own.values()):
        return [task for task in tasks if task in own]
    return [
        task
        for task in tasks
        if (own[task].has_held_out if task in own else any(s.test for s in known.groups(task, split).values()))
    ]


def _draw(
    stage: Path,
    split: str,
    tasks: Sequence[str],
    with_held_out: Sequence[str],
    entries: Sequence[Entry],
    totals: Sequence[Overall],
) -> None:
    validation = any(each.role == "validation" for each in entries)
    done, asked = sum(len(e.done) for e in entries), sum(len(e.cells) for e in entries)
    seeds = " or ".join(map(str, sorted({len(each.cells) for each in entries})))
    state = f"{done} of {asked} cells done, seeds: {seeds}"
    comparable = split in load_benchmark().splits and not validation
    at = f"; published: at {published_steps() / 1e6:g}M steps" if comparable else ""
    heading = f"Split {split}: training return, with exploration noise ({state}{at})"
    write_curves(stage / f"training-split-{split}.png", split, tasks, entries, "return", heading)
    watched = "validation" if validation else "training"
    heading = f"Split {split}: noise-free score of the {watched} robots, interquartile mean ({state})"
    write_curves(stage / f"scores-split-{split}.png", split, tasks, entries, "score", heading)
    if with_held_out:
        role = "validation" if validation else "held-out"
        heading = f"Split {split}: noise-free return on {role} robots ({state})"
        write_bars(stage / f"zero-shot-split-{split}.png", split, with_held_out, entries, totals, heading)


def _values(
    matrix: Path,
    cells: Sequence[Status],
    entries: Sequence[Entry],
    totals: Sequence[Overall],
    pairs: Sequence[Improvement],
) -> dict[str, Any]:
    return {
        "schema_version": 1,
        "matrix": str(matrix),
        "morphkit": metadata.version("morphkit"),
        "written": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "complete": all(each.state == "done" for each in cells),
        "cells": [cell_row(each) for each in cells],
        "tasks": [entry_row(each) for each in entries],
        "overall": [
            {
                "split": each.split,
                "method": each.method,
                "tasks": list(each.tasks),
                "of_tasks": each.of_tasks,
                **tables.flat("held_out_return", each.held_out),
                "published_held_out_return": each.published_held_out,
                **tables.flat("held_out_score", each.held_out_score),
                **tables.flat("training_score", each.training_score),
            }
            for each in totals
        ],
        "improvement": [
            {
                **{name: getattr(each, name) for name in ("split", "better", "than", "robots")},
                "tasks": list(each.tasks),
                **tables.flat("probability", each.probability),
            }
            for each in pairs
        ],
        "robots": robot_rows(cells),
    }
