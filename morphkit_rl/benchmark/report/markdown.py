"""`report.md`: what a person reads of a matrix."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import metadata
from pathlib import Path

from morphkit.utils.printable import markdown_table, one_line
from morphkit_rl.benchmark.cells import Status
from morphkit_rl.benchmark.published import OVERALL, Kind, published_returns, published_steps
from morphkit_rl.benchmark.report import figure_style as style
from morphkit_rl.benchmark.report.origin import write_origin
from morphkit_rl.benchmark.report.tables import MISSING, show, show_estimate
from morphkit_rl.benchmark.summary import Entry, Improvement, Overall

_HOW_TO_READ = f"""## How to read the numbers

- **training return**: mean return of training episodes over the training robots, with exploration noise, over the last
  5 % of the steps; mean over seeds. The published one is such. Next to it the same robots **noise-free**, at the end.
- **held-out return**: mean return of noise-free episodes on robots that training never saw; mean over seeds.
- **score**: (return - random) / (expert - random) of noise-free episodes, with the returns of a random policy and of a
  single-robot expert; interquartile mean over seeds and robots.
- **[low, high]**: 95 % bootstrap interval over seeds, stratified by task. A single seed has none.
- **published**: of the method itself, else the best of those in the study, with its name. Read off the study's figures
  (bars to about 2 %, curves to about 5 %); 3 seeds, {published_steps():,} counted steps.
- Only cells that are done count. `{MISSING}` means that there is no number.
"""


def write_markdown(
    matrix: Path,
    cells: Sequence[Status],
    entries: Sequence[Entry],
    totals: Sequence[Overall],
    pairs: Sequence[Improvement],
    pictures: Sequence[str],
) -> str:
    """The report's text.

    Args:
        matrix: Folder of the matrix.
        cells: Its cells.
        entries: They by split, task and method.
        totals: The methods over all tasks of a split.
        pairs: Method against method.
        pictures: Names of the figures next to the text.
    """
    parts = ["# Benchmark report\n", _standing(matrix, cells)]
    for split in dict.fromkeys(each.split for each in entries):
        own = [each for each in entries if each.split == split]
        parts.append(f"## Split {split}\n")
        parts += [f"![{name}]({name})\n" for name in pictures if name.endswith(f"-split-{split}.png")]
        parts.append(_tasks(own))
        parts.append(_overall([each for each in totals if each.split == split], own))
    if pairs:
        parts.append(_improvements(pairs))
    parts.append(_not_done(cells))
    parts.append(write_origin(cells))
    parts.append(_HOW_TO_READ)
    return "\n".join(part for part in parts if part)


def _standing(matrix: Path, cells: Sequence[Status]) -> str:
    states = [each.state for each in cells]
    counts = ", ".join(f"{states.count(state)} {state}" for state in dict.fromkeys(sorted(states)))
    number = f"{len(cells)} cell{'s' * (len(cells) != 1)}"
    text = f"{number} in `{one_line(matrix.name)}`: {counts}. Written by morphkit {metadata.version('morphkit')}.\n"
    if states.count("done") < len(states):
        text += "\n**This matrix is not whole.** The numbers are those of the cells that are done.\n"
    if any(each.plan["validate"] for each in cells):
        text += "\nHeld-out robots here are *validation robots* of the training set; the test set was left alone.\n"
    cuts = {len(each.plan["cut"]) for each in cells} - {0}
    if cuts:
        text += (
            f"\n**Not the published protocol**: {_range(sorted(cuts), 'd')} bodies that were cut out of training robots"
            " trained as well; none is a held-out robot or the mirror image of one.\n"
        )
    budgets = sorted({(each.plan["steps"] or 0, each.plan["minutes"] or 0.0) for each in cells})
    said = " or ".join(
        " and ".join([*([f"{s:,} steps"] if s else []), *([f"{m:g} minutes"] if m else [])]) for s, m in budgets
    )
    return f"{text}\nBudget of a cell: {said}.{_used(cells)}\n"


def _used(cells: Sequence[Status]) -> str:
    """How many steps and minutes the cells took that are done."""
    results = [each.result for each in cells if each.result]
    if not results:
        return ""
    steps, minutes = ([each["steps"] for each in results], [each["elapsed_s"] / 60 for each in results])
    return f" Those that are done took {_range(steps, ',')} steps and {_range(minutes, '.1f')} minutes of training."


def _range(values: Sequence[float], form: str) -> str:
    low, high = format(min(values), form), format(max(values), form)
    return low if low == high else f"{low} to {high}"


def _tasks(entries: Sequence[Entry]) -> str:
    numbers = (
        *("training return", "noise-free", "published training", "held-out return", "published held-out"),
        *("score, training", "score, held-out"),
    )
    rows = [
        (
            each.task,
            each.method,
            each.states,
            show_estimate(each.training_return),
            show_estimate(each.training_noise_free),
            _published(each.published_training, "train", each.split, each.task, each.role == "validation"),
            show_estimate(each.held_out) if each.has_held_out else "none held out",
            _published(each.published_held_out, "zero_shot", each.split, each.task, each.role == "validation"),
            show_estimate(each.training_score, 3),
            show_estimate(each.held_out_score, 3),
        )
        for each in entries
    ]
    return markdown_table(("task", "method", "seeds", *numbers), rows, right=numbers)


def _published(own: float | None, kind: Kind, split: str, task: str, incomparable: bool) -> str:
    """The published return of a method; of one that has none, the best of the others with its name."""
    levels = {} if incomparable else published_returns(kind, split, task)
    if incomparable or not levels:
        return MISSING
    if own is not None:
        return show(own)
    best = max(levels, key=lambda name: levels[name])
    return f"{show(levels[best])} ({style.label(best)})"


def _overall(totals: Sequence[Overall], entries: Sequence[Entry]) -> str:
    validation = any(each.role == "validation" for each in entries)
    numbers = ("held-out return", "published", "score, held-out", "score, training")
    rows = []
    for each in totals:
        whole = len(each.tasks) == each.of_tasks and not validation
        tasks = f"all {each.of_tasks}" if len(each.tasks) == each.of_tasks else f"{len(each.tasks)} of {each.of_tasks}"
        rows.append(
            (
                each.method,
                tasks,
                show_estimate(each.held_out),
                # Comparable only over the same tasks.
                _published(each.published_held_out, "zero_shot", each.split, OVERALL, not whole),
                show_estimate(each.held_out_score, 3),
                show_estimate(each.training_score, 3),
            )
        )
    return "Over the tasks that hold robots out:\n\n" + markdown_table(
        ("method", "tasks", *numbers), rows, right=numbers
    )


def _improvements(pairs: Sequence[Improvement]) -> str:
    rows = [
        (
            each.split,
            {"train": "training", "validation": "validation", "test": "held-out"}[each.robots],
            f"P({each.better} > {each.than})",
            show_estimate(each.probability, 2),
            str(len(each.tasks)),
        )
        for each in pairs
    ]
    table = markdown_table(("split", "robots", "probability that a seed scores higher", "value", "tasks"), rows)
    return f"## Probability of improvement\n\n{table}"


def _not_done(cells: Sequence[Status]) -> str:
    rows = [
        (each.cell.split, each.cell.task, each.cell.method, str(each.cell.seed), f"**{each.state}**", each.detail)
        for each in cells
        if each.state != "done"
    ]
    if not rows:
        return ""
    return "## Cells that are not done\n\n" + markdown_table(("split", "task", "method", "seed", "state", "why"), rows)
