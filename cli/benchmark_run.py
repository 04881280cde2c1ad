"""`morphkit benchmark run`: train and evaluate a matrix of cells."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from . import common
from .benchmark import FILE_HELP, print_cells
from .terminal import note

if TYPE_CHECKING:
    from morphkit_rl.benchmark.cells import MatrixPlan
    from morphkit_rl.training.trainer import Progress

EXAMPLES = (
    "morphkit benchmark run --task cheetahs --split 1 --method limb-former --seeds 3",
    "morphkit benchmark run --task walkers --task hoppers --split 1 --method limb-former --seeds 3 --minutes 30",
    "morphkit benchmark run --task mine --split mine --method limb-former --seeds 1 --file mine.toml --validate",
)


def run(
    task: Annotated[list[str], typer.Option(metavar="NAME", help="Task; may be given often, or 'all'.")],
    split: Annotated[list[str], typer.Option(metavar="NAME", help="Split; may be given often, or 'all'.")],
    method: Annotated[list[str], typer.Option(metavar="NAME", help="Method or preset; may be given often.")],
    seeds: Annotated[int, typer.Option(min=1, metavar="N", help="Seeds of each combination, from 0.")] = 3,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the matrix.")] = Path("runs/benchmark"),
    steps: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Counted steps of a cell.", show_default="3000000")
    ] = None,
    minutes: Annotated[float | None, typer.Option(min=0, metavar="N", help="Training time of a cell.")] = None,
    preset: Annotated[
        str | None, typer.Option(help="Preset or TOML file in place of the method's own.", show_default="the method's")
    ] = None,
    settings: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Change a setting, such as td3.tau=0.01.")
    ] = None,
    episodes: Annotated[int, typer.Option(min=1, metavar="N", help="Noise-free episodes a robot at the end.")] = 10,
    validate: Annotated[
        bool,
        typer.Option("--validate", help="Evaluate on robots held out of the training set; leave the test set alone."),
    ] = False,
    file: Annotated[Path | None, typer.Option(metavar="FILE", help=FILE_HELP)] = None,
    device: Annotated[str, typer.Option(help="PyTorch device, such as cpu or cuda.")] = "cpu",
    as_json: Annotated[bool, typer.Option("--json", help="Print the cells as JSON.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Show no progress and no table.")] = False,
) -> None:
    """Train and evaluate methods on the benchmark: every task, split, method and seed is a cell.

    The same command goes on where it was stopped; done cells are left as they are, failed ones are
    tried again. Several processes may work on one folder: each cell is run by one of them.
    """
    from morphkit_rl.benchmark.definition import load_benchmark
    from morphkit_rl.benchmark.planning import plan_matrix
    from morphkit_rl.benchmark.runner import run_matrix

    from .progress import ProgressDisplay

    benchmark = load_benchmark(file)
    splits = list(benchmark.splits) if split == ["all"] else split
    tasks = list(benchmark.tasks) if task == ["all"] else task
    plans = plan_matrix(
        benchmark,
        tasks=tasks,
        splits=splits,
        methods=method,
        seeds=seeds,
        steps=steps,
        minutes=minutes,
        preset=preset,
        overrides=settings or [],
        episodes=episodes,
        validate=validate,
    )

    @contextmanager
    def watch(plan: MatrixPlan, number: int) -> Iterator[Callable[[Progress], None]]:
        with ProgressDisplay(f"cell {number + 1} of {len(plans)}: {plan.cell}", quiet=quiet) as display:
            yield display.update

    found = []
    try:
        for each in run_matrix(plans, out, watch=watch, device=device):
            found.append(each)
            if each.state == "failed":
                note(f"{each.cell}: failed: {each.detail}; see {each.folder / 'failure.json'}")
            elif not quiet and each.state != "done":
                note(f"{each.cell}: {each.state}: {each.detail}")
    except KeyboardInterrupt:
        note(f"{len(found)} of {common.count(len(plans), 'cell')} behind; the same command goes on")
        raise
    if as_json or not quiet:
        print_cells(found, as_json=as_json)
    if not quiet and not as_json:
        note(f"next: morphkit benchmark report {out}")
    if any(each.state == "failed" for each in found):
        raise typer.Exit(1)
