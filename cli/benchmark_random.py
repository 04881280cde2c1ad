"""`morphkit benchmark random`: what the random policy gets on each body."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from morphkit.utils.printable import markdown_table

from . import common
from .benchmark import FILE_HELP
from .table import table, terminal_width
from .terminal import note, write

if TYPE_CHECKING:
    from morphkit_rl.evaluation.episodes import RobotReturns

EXAMPLES = (
    "morphkit benchmark random",
    "morphkit benchmark random cheetah_3_balanced hopper_4 --episodes 10 --seed 1",
)
COLUMNS = ("body", "mean return", "95 % interval", "std", "steps", "expert")


def random(
    robots: Annotated[
        list[str] | None, typer.Argument(metavar="[ROBOT]...", help="Robots; without any, all of the benchmark.")
    ] = None,
    episodes: Annotated[int, typer.Option(min=1, metavar="N", help="Episodes a robot.")] = 100,
    seed: Annotated[int, typer.Option(min=0, help="Seed of starts and controls.")] = 0,
    file: Annotated[Path | None, typer.Option(metavar="FILE", help=FILE_HELP)] = None,
    xacro_arg: common.XacroArgOption = None,
    trust_xacro: common.TrustXacroOption = False,
    output_format: Annotated[
        Literal["table", "markdown", "json"] | None,
        typer.Option("--format", help="How to print the returns.", show_default="table"),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="The same as --format json.")] = False,
) -> None:
    """Play random episodes: what a score of 0 stands for.

    Controls are drawn uniformly from their ranges, anew at every control step. The same seed gives
    the same returns, whichever robots are asked for and however many threads there are.
    """
    printed = common.output_format(output_format, "table", as_json=as_json)
    from morphkit_rl.benchmark.bodies import members
    from morphkit_rl.benchmark.definition import load_benchmark
    from morphkit_rl.evaluation.random_policy import random_returns

    if robots:
        descriptions = common.load_bodies(robots, xacro_arg, trust_xacro=trust_xacro)
    else:
        descriptions = [member.description for member in members(load_benchmark(file))]
    results = []
    for result in random_returns(descriptions, episodes, seed):
        results.append(result)
        note(f"{len(results)}/{len(descriptions)} {result.robot}")
    if printed == "json":
        common.print_json([_record(result) for result in results])
    elif printed == "markdown":
        write(markdown_table(COLUMNS, list(map(_cells, results)), right=COLUMNS[1:]))
    else:
        write(table(COLUMNS, list(map(_cells, results)), right=COLUMNS[1:], width=terminal_width()))


def _cells(result: RobotReturns) -> tuple[str, ...]:
    low, high = result.interval
    expert = "-" if result.expert_return is None else f"{result.expert_return:.0f}"
    steps = sum(result.lengths) / len(result.lengths)
    return result.robot, f"{result.mean:.1f}", f"{low:.1f} to {high:.1f}", f"{result.std:.1f}", f"{steps:.1f}", expert


def _record(result: RobotReturns) -> dict[str, object]:
    return {
        "robot": result.robot,
        "mean": result.mean,
        "interval": result.interval,
        "std": result.std,
        "expert_return": result.expert_return,
        "returns": result.returns,
        "lengths": result.lengths,
    }
