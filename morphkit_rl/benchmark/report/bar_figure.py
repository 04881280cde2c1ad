"""Zero-shot returns, a panel a task and one for all: bars with intervals and seeds, next to the published ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from morphkit_rl.benchmark.published import OVERALL, published_returns
from morphkit_rl.benchmark.report import figure_style as style
from morphkit_rl.benchmark.statistics import Estimate
from morphkit_rl.benchmark.summary import Entry, Overall, seed_means

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True)
class Bar:
    """A method's bar: its estimate (None: nothing is done), seeds, and what to say where it is not whole."""

    estimate: Estimate | None
    seeds: tuple[float, ...]
    remark: str


def write_bars(
    path: Path, split: str, tasks: Sequence[str], entries: Sequence[Entry], overall: Sequence[Overall], heading: str
) -> Path:
    """Write the returns on held-out robots of a split.

    Args:
        path: The PNG file.
        split: Name of the split.
        tasks: Tasks with held-out robots; a panel each, and one for all of them where there are several.
        entries: What the matrix has of this split.
        overall: The methods over all tasks.
        heading: Text above.
    """
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    validation = any(each.role == "validation" for each in entries)
    methods = list(dict.fromkeys(each.method for each in entries))
    panels = [*tasks, OVERALL] if len(tasks) > 1 else list(tasks)
    bars = {task: {each.method: _bar(each) for each in entries if each.task == task} for task in tasks}
    bars[OVERALL] = {each.method: _overall_bar(each) for each in overall}
    published = {task: {} if validation else published_returns("zero_shot", split, task) for task in panels}
    names = sorted({name for level in published.values() for name in level}, key=style.order)

    def draw(axes: Axes, task: str) -> None:
        _draw(axes, task, bars[task], published[task], methods)

    handles: list[Any] = [Patch(color=style.color(name, methods), label=style.label(name)) for name in methods]
    handles.append(
        Line2D(
            [], [], linestyle="", marker="o", markersize=4, markerfacecolor="white", color=style.INK, label="one seed"
        )
    )
    if any(len(each.done) > 1 for each in entries):
        handles.append(Line2D([], [], color=style.INK, linewidth=1.4, label="95 % interval over seeds"))
    handles += [Patch(label=f"{style.label(name)}, published", **_published(name, methods)) for name in names]
    return style.draw_panels(panels, draw, path, heading=heading, legend=handles)


def _published(name: str, methods: Sequence[str]) -> dict[str, Any]:
    hatch = "....." if name.endswith("-no-ltv") else "////"
    return {"facecolor": "white", "edgecolor": style.color(name, methods), "hatch": hatch, "linewidth": 1.0}


def _bar(entry: Entry) -> Bar:
    seeds = seed_means(entry.done, entry.role)
    whole = len(entry.done) == len(entry.cells)
    return Bar(entry.held_out, tuple(seeds.tolist()), "" if whole else f"{style.label(entry.method)}: {entry.states}")


def _overall_bar(row: Overall) -> Bar:
    whole = len(row.tasks) == row.of_tasks
    # A mean over other tasks than the published one would invite a wrong comparison.
    remark = "" if whole else f"{style.label(row.method)}: only {len(row.tasks)} of {row.of_tasks} tasks"
    return Bar(row.held_out if whole else None, (), remark)


def _draw(
    axes: Axes, task: str, bars: Mapping[str, Bar], published: Mapping[str, float], methods: Sequence[str]
) -> None:
    style.set_labels(axes, task, "", "return on held-out robots")
    axes.set_xticks([])
    axes.spines["bottom"].set_visible(False)
    axes.grid(axis="y", color=style.GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    place = 0.0
    tops = [0.0, *published.values()]
    for base in dict.fromkeys(style.base_of(name) for name in (*methods, *published)):
        for method in (each for each in methods if style.base_of(each) == base):
            tops += _draw_own(axes, place, bars.get(method), style.color(method, methods))
            place += 1
        for method in (each for each in published if style.base_of(each) == base):
            axes.bar(place, published[method], width=0.8, **_published(method, methods))
            _write(axes, place, max(published[method], 0), style.number(published[method]))
            place += 1
        place += 0.35
    low, high = min(tops), max(tops)
    room = (high - low) or 1.0
    axes.set_ylim(low - (0.12 * room if low < 0 else 0), high + 0.15 * room)
    center, half = place / 2 - 0.675, max(place / 2, 2.2)
    axes.set_xlim(center - half, center + half)
    axes.axhline(0, color=style.INK, linewidth=0.9)
    remarks = [bar.remark for bar in bars.values() if bar.remark] or ([] if bars else ["not in this matrix"])
    axes.text(0.0, -0.03, "\n".join(remarks), transform=axes.transAxes, va="top", fontsize=7.5, color=style.QUIET)


def _draw_own(axes: Axes, place: float, bar: Bar | None, color: str) -> list[float]:
    """Draw one bar, or a dash where there is none; returns what the panel has to show."""
    if bar is None or bar.estimate is None:
        axes.text(place, 0, "none\nyet", ha="center", va="bottom", fontsize=7.5, color=color, linespacing=0.9)
        return []
    value, low, high = bar.estimate.value, bar.estimate.low, bar.estimate.high
    axes.bar(place, value, width=0.8, color=color)
    tops = [value]
    if low is not None and high is not None:
        axes.plot([place, place], [low, high], color=style.INK, linewidth=1.4, solid_capstyle="butt", zorder=3)
        tops += [low, high]
    if bar.seeds:
        spread = np.linspace(-0.22, 0.22, len(bar.seeds)) if len(bar.seeds) > 1 else np.zeros(1)
        axes.plot(place + spread, bar.seeds, linestyle="", marker="o", markersize=3.6, color=style.INK,
                  markerfacecolor="white", markeredgewidth=0.8, zorder=4)  # fmt: skip
        tops += bar.seeds
    _write(axes, place, max(0.0, *tops), style.number(value))
    return tops


def _write(axes: Axes, place: float, top: float, text: str) -> None:
    axes.annotate(text, (place, top), xytext=(0, 2), textcoords="offset points", ha="center", va="bottom", fontsize=7.5)
