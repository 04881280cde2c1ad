"""`morphkit benchmark run`: train and evaluate a matrix of cells."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from . import common
from .benchmark import FILE_HELP, print_cells
from .terminal import note

if TYPE_CHECKING:
    from morphkit_rl.benchmark.cells import MatrixPlan, Status
    from morphkit_rl.training.trainer import Progress

EXAMPLES = (
    "morphkit benchmark run --task all --split all --method limb-former --ray 10.0.0.1:6379",
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
    cuts: Annotated[
        int,
        typer.Option(
            min=0, metavar="N", help="Train as well on up to N bodies cut out of each group's training robots."
        ),
    ] = 0,
    file: Annotated[Path | None, typer.Option(metavar="FILE", help=FILE_HELP)] = None,
    device: Annotated[str, typer.Option(help="PyTorch device, such as cpu or cuda.")] = "cpu",
    ray: common.RayOption = None,
    cpus: common.CpusOption = 1,
    storage: Annotated[
        str | None,
        typer.Option(
            metavar="URL",
            help="With --ray: fsspec address, such as s3://bucket/matrix, through which nodes that share no disk hand "
            "on their cells.",
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the cells as JSON.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Show no progress and no table.")] = False,
) -> None:
    """Train and evaluate methods on the benchmark: every task, split, method and seed is a cell.

    The same command goes on where it was stopped; done cells are left as they are, failed ones are
    tried again. Several processes may work on one folder: each cell is run by one of them. With --ray
    the cells are tasks of a Ray cluster, of this machine or of many.
    """
    if storage and ray is None:
        raise common.UsageError("--storage goes with --ray.")
    from morphkit_rl.benchmark.definition import load_benchmark
    from morphkit_rl.benchmark.planning import plan_matrix

    benchmark = load_benchmark(file)
    splits = list(benchmark.splits) if split == ["all"] else split
    tasks = list(benchmark.tasks) if task == ["all"] else task
    options: dict[str, Any] = {
        "steps": steps,
        "minutes": minutes,
        "preset": preset,
        "overrides": settings or [],
        "episodes": episodes,
        "validate": validate,
        "cuts": cuts,
    }
    plans = plan_matrix(benchmark, tasks=tasks, splits=splits, methods=method, seeds=seeds, **options)
    if ray is None:
        statuses = _here(plans, out, device, quiet=quiet)
    else:
        statuses = _on_cluster(ray, cpus, plans, out, (file, options, storage, device))
    found = []
    try:
        for each in statuses:
            found.append(each)
            if each.state == "failed":
                note(f"{each.cell}: failed: {each.detail}; see {each.folder / 'failure.json'}")
            elif not quiet and (each.state != "done" or ray is not None):
                note(f"{each.cell}: {each.state}{': ' if each.detail else ''}{each.detail}")
    except KeyboardInterrupt:
        note(f"{len(found)} of {common.count(len(plans), 'cell')} behind; the same command goes on")
        raise
    if as_json or not quiet:
        print_cells(found, as_json=as_json)
    if not quiet and not as_json:
        note(f"next: morphkit benchmark report {out}")
    if any(each.state == "failed" for each in found):
        raise typer.Exit(1)


def _here(plans: Sequence[MatrixPlan], matrix: Path, device: str, *, quiet: bool) -> Iterator[Status]:
    """Run cells one after the other in this process, with a progress bar each."""
    from morphkit_rl.benchmark.runner import run_matrix

    from .progress import ProgressDisplay

    @contextmanager
    def watch(plan: MatrixPlan, number: int) -> Iterator[Callable[[Progress], None]]:
        with ProgressDisplay(f"cell {number + 1} of {len(plans)}: {plan.cell}", quiet=quiet) as display:
            yield display.update

    yield from run_matrix(plans, matrix, watch=watch, device=device)


def _on_cluster(
    address: str,
    cpus: float,
    plans: Sequence[MatrixPlan],
    matrix: Path,
    asked: tuple[Path | None, dict[str, Any], str | None, str],
) -> Iterator[Status]:
    """Run cells as tasks of a Ray cluster, whose nodes have other working directories."""
    from morphkit_rl.benchmark.distributed import Request, run_on_cluster
    from morphkit_rl.training.cluster.connection import connected
    from morphkit_rl.training.cluster.jobs import Resources

    file, options, storage, device = asked
    preset = options["preset"]
    if preset is not None and preset.endswith(".toml"):
        options = {**options, "preset": str(Path(preset).resolve())}
    request = Request(file and file.resolve(), options, matrix.resolve(), storage, device)
    with connected(address) as ray:
        yield from run_on_cluster(ray, plans, request, Resources(cpus, gpus=int(device.startswith("cuda"))))
