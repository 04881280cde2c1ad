"""Learning curves, a panel a task: mean and 95 % band over seeds, with the published level drawn in."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from morphkit_rl.benchmark.published import published_returns, published_steps
from morphkit_rl.benchmark.report import figure_style as style
from morphkit_rl.benchmark.report.curves import Measure, band, seed_curve
from morphkit_rl.benchmark.statistics import interquartile_mean, mean_of_means
from morphkit_rl.benchmark.summary import Entry

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_AXES = {
    "return": "return of training episodes",
    "score": "score: 0 random, 1 expert",
}


def write_curves(
    path: Path, split: str, tasks: Sequence[str], entries: Sequence[Entry], measure: Measure, heading: str
) -> Path:
    """Write the learning curves of a split.

    Args:
        path: The PNG file.
        split: Name of the split.
        tasks: The panels.
        entries: What the matrix has of this split.
        measure: `return`, as the study shows it, or `score`: the interquartile mean over seeds and robots.
        heading: Text above.
    """
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    methods = list(dict.fromkeys(each.method for each in entries))
    comparable = measure == "return" and all(each.role == "test" for each in entries)
    levels = {task: published_returns("train", split, task) if comparable else {} for task in tasks}

    def draw(axes: Axes, task: str) -> None:
        _draw(axes, task, [each for each in entries if each.task == task], methods, levels[task], measure)

    handles: list[Any] = [
        Line2D([], [], color=style.color(name, methods), linewidth=2.2, label=style.label(name)) for name in methods
    ]
    if any(len(each.done) > 1 for each in entries):
        handles.append(Patch(color=style.QUIET, alpha=0.25, label="95 % interval over seeds"))
    if any(len(each.done) < len(each.cells) for each in entries):
        handles.append(Line2D([], [], color=style.QUIET, linewidth=0.8, alpha=0.8, label="a seed that is not done"))
    for name in sorted({name for level in levels.values() for name in level}, key=style.order):
        handles.append(
            Line2D(
                [],
                [],
                color=style.color(name, methods),
                label=f"{style.label(name)}, published",
                **_published(name),
            )
        )
    return style.draw_panels(tasks, draw, path, heading=heading, legend=handles)


def _published(name: str) -> dict[str, Any]:
    dots = (0, (1, 2)) if name.endswith("-no-ltv") else (0, (5, 2))
    return {"linestyle": dots, "linewidth": 1.3, "marker": "D", "markersize": 4, "markerfacecolor": "white"}


def _draw(
    axes: Axes, task: str, entries: Sequence[Entry], methods: Sequence[str], levels: dict[str, float], measure: Measure
) -> None:
    from matplotlib.ticker import EngFormatter

    style.set_labels(axes, task, "counted environment steps", _AXES[measure])
    axes.xaxis.set_major_formatter(EngFormatter(sep=""))
    axes.grid(color=style.GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    remarks = []
    ends = [0.0]
    for entry in entries:
        ends += _draw_method(axes, entry, style.color(entry.method, methods), measure)
        if len(entry.done) < len(entry.cells):
            remarks.append(f"{style.label(entry.method)}: {entry.states}")
    published = float(published_steps())
    end = max(ends) or published
    for name, level in levels.items():
        look: dict[str, Any] = {"color": style.color(name, methods), "markevery": [1], "zorder": 1.5}
        axes.plot([0, published], [level, level], clip_on=published > end, **look, **_published(name))
    if levels and end < published:
        remarks.append(f"published: at {published / 1e6:g}M steps, right of this axis")
    if len(ends) == 1:
        style.say(axes, "no values yet" if entries else "not in this matrix")
    axes.set_xlim(0, end)
    axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
    style.remark(axes, remarks)


def _draw_method(axes: Axes, entry: Entry, color: str, measure: Measure) -> list[float]:
    """Draw the seeds that are done as one band and every other one as a thin line; returns the last step of each."""
    curves = [(cell.state == "done", seed_curve(cell, measure)) for cell in entry.cells if cell.state != "not started"]
    done = [curve for is_done, curve in curves if curve and is_done]
    for is_done, curve in curves:
        if curve and not is_done:
            axes.plot(curve.steps, curve.values.mean(axis=1), color=color, linewidth=0.8, alpha=0.8)
    together = band(done, interquartile_mean if measure == "score" else mean_of_means) if done else None
    if together:
        marker = "o" if len(together.steps) == 1 else None
        axes.plot(together.steps, together.values, color=color, linewidth=2.0, marker=marker, zorder=3)
        if together.low is not None and together.high is not None:
            axes.fill_between(together.steps, together.low, together.high, color=color, alpha=0.2, linewidth=0)
    return [float(curve.steps[-1]) for _, curve in curves if curve]
