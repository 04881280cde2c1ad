"""The result of a run as one picture: learning curves, and the trained policy compared with a random one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from morphkit.errors import ConfigError, DependencyError
from morphkit.utils.atomic_write import write_output

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Okabe and Ito's colors: told apart by people with any kind of color vision.
_TRAINED, _HELD_OUT, _RANDOM = "#0072B2", "#D55E00", "#8A8A8A"
_CURVES = ("#56B4E9", "#E69F00", "#009E73", "#CC79A7", "#F0E442", "#999999")
_INK, _GRID = "#262626", "#E4E4E4"


class Result(Protocol):
    """What the picture takes of a robot's evaluation."""

    @property
    def robot(self) -> str:
        """Name of the body."""

    @property
    def trained_on(self) -> bool:
        """Whether the body was among the training bodies."""

    @property
    def returns(self) -> tuple[float, ...]:
        """Return of each episode of the trained policy."""

    @property
    def mean(self) -> float:
        """Mean of `returns`."""

    @property
    def random_mean(self) -> float:
        """Mean return of the random policy."""

    @property
    def random_interval(self) -> tuple[float, float]:
        """Interval of the random policy's mean return, low and high."""

    @property
    def normalized(self) -> float | None:
        """(mean - random) / (expert - random); None without an expert's return."""


def results_figure(metrics: Sequence[Mapping[str, Any]], results: Sequence[Result], path: Path) -> Path:
    """Write a PNG (or PDF, SVG): left the learning curves, right bars of trained against random for each body.

    Args:
        metrics: Rows of metrics.jsonl: `steps` (environment steps so far), `return_mean` (over the training bodies,
            None before the first episode ends), `first_return_mean` (the same, of bodies that have ended only their
            first, shorter episodes too) and `returns` (body -> mean return of its latest episodes).
        results: One a body, in the order of the bars.
        path: The file; one of that name is replaced.

    Raises:
        ConfigError: The name ends in something that matplotlib cannot write.
        OutputError: The file cannot be written.
        DependencyError: matplotlib is not installed.
    """
    path = Path(path)
    if path.suffix.lower() not in (".png", ".pdf", ".svg"):
        raise ConfigError(f"{path}: the name must end in .png, .pdf or .svg")
    try:
        import matplotlib as mpl
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise DependencyError(f'plots need matplotlib: pip install "morphkit[viewer]" ({error})') from None

    style = {
        "font.size": 10, "axes.edgecolor": _INK, "axes.labelcolor": _INK, "text.color": _INK, "xtick.color": _INK,
        "ytick.color": _INK, "axes.titlesize": 12, "axes.titleweight": "bold", "axes.titlelocation": "left",
        "axes.spines.top": False, "axes.spines.right": False, "svg.hashsalt": "morphkit", "text.parse_math": False,
    }  # fmt: skip
    with mpl.rc_context(style):
        figure = Figure(figsize=(12, max(4.6, 1.6 + 0.52 * len(results))), layout="constrained", facecolor="white")
        FigureCanvasAgg(figure)
        left, right = figure.subplots(1, 2, width_ratios=(1.1, 1))
        _draw_curves(left, metrics)
        _draw_bars(right, results)
        kind = path.suffix.lower()[1:]
        return write_output(path, lambda target: figure.savefig(target, format=kind, dpi=150))


def _curve(metrics: Sequence[Mapping[str, Any]], values: Sequence[Any]) -> tuple[np.ndarray, np.ndarray]:
    """Steps and values of the rows that have a finite value."""
    points = [
        (float(row["steps"]), float(value))
        for row, value in zip(metrics, values, strict=True)
        if value is not None and math.isfinite(value)
    ]
    steps, kept = zip(*points, strict=True) if points else ((), ())
    return np.array(steps), np.array(kept)


def _draw_curves(axes: Axes, metrics: Sequence[Mapping[str, Any]]) -> None:
    from matplotlib.ticker import EngFormatter

    axes.set_title("Learning curve")
    axes.set_xlabel("environment steps, all training bodies together")
    axes.set_ylabel("return of training episodes (sum of rewards)")
    axes.xaxis.set_major_formatter(EngFormatter(sep=""))
    axes.grid(color=_GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    robots = list(dict.fromkeys(robot for row in metrics for robot in row.get("returns") or ()))
    few = len(robots) <= len(_CURVES)
    for index, robot in enumerate(robots):
        steps, values = _curve(metrics, [(row.get("returns") or {}).get(robot) for row in metrics])
        label = robot if few else ("each body" if index == 0 else None)
        axes.plot(steps, values, color=_CURVES[index] if few else "#9CC9E6", linewidth=1.0, label=label,
                  marker="." if len(steps) == 1 else None)  # fmt: skip
    steps, values = _curve(metrics, [row.get("first_return_mean") for row in metrics])
    if len(steps):
        axes.plot(steps, values, color=_TRAINED, linewidth=1.6, linestyle=":", marker="." if len(steps) == 1 else None,
                  label="mean, with first, shorter episodes scaled up")  # fmt: skip
    steps, values = _curve(metrics, [row.get("return_mean") for row in metrics])
    if len(steps):
        axes.plot(steps, values, color=_TRAINED, linewidth=2.8, label="mean of the training bodies",
                  marker="o" if len(steps) == 1 else None)  # fmt: skip
    if axes.lines:
        axes.legend(loc="best", fontsize=9, framealpha=0.8, edgecolor="none")
        axes.set_xlim(left=0)
    else:
        _say(axes, "no episode has ended yet")


def _draw_bars(axes: Axes, results: Sequence[Result]) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    axes.set_title("Trained policy against random actions")
    scored = any(result.normalized is not None for result in results)
    axes.set_xlabel("return of an episode (sum of rewards)" + ("; score: 0 random, 1 expert" if scored else ""))
    if not results:
        _say(axes, "nothing was evaluated")
        return
    axes.grid(axis="x", color=_GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.axvline(0, color=_INK, linewidth=0.8)
    for row, result in enumerate(results):
        color = _TRAINED if result.trained_on else _HELD_OUT
        axes.barh(row - 0.19, result.mean, height=0.36, color=color, hatch=None if result.trained_on else "//",
                  edgecolor="white", linewidth=0)  # fmt: skip
        axes.plot(result.returns, np.full(len(result.returns), row - 0.19), linestyle="", marker="o", markersize=3.2,
                  color=_INK, alpha=0.55)  # fmt: skip
        low, high = result.random_interval
        axes.barh(row + 0.19, result.random_mean, height=0.36, color=_RANDOM)
        axes.plot([low, high], [row + 0.19] * 2, color=_INK, linewidth=1.6, solid_capstyle="butt")
        axes.annotate(_bar_text(result), (max(0.0, result.mean, *result.returns), row - 0.19), xytext=(6, 0),
                      textcoords="offset points", va="center", fontsize=9)  # fmt: skip
    labels = axes.set_yticks(range(len(results)), [result.robot for result in results])
    for tick, result in zip(labels, results, strict=True):
        if not result.trained_on:
            tick.label1.set(color=_HELD_OUT, fontweight="bold")
    axes.set_ylim(len(results) - 0.5, -0.5)
    ends = [number for result in results for number in (result.mean, *result.returns, *result.random_interval)]
    ends = [number for number in ends if math.isfinite(number)]
    low, high = min([0.0, *ends]), max([0.0, *ends])
    room = (high - low) or 1.0
    axes.set_xlim(low - 0.04 * room, high + 0.36 * room)
    entries: list[Any] = []
    if any(result.trained_on for result in results):
        entries.append(Patch(color=_TRAINED, label="training body"))
    if not all(result.trained_on for result in results):
        entries.append(Patch(facecolor=_HELD_OUT, hatch="//", edgecolor="white", linewidth=0, label="held-out body"))
    entries.append(Patch(color=_RANDOM, label="random actions (line: 95 % interval of the mean)"))
    entries.append(Line2D([], [], linestyle="", marker="o", markersize=4, color=_INK, alpha=0.55, label="one episode"))
    axes.figure.legend(handles=entries, frameon=False, fontsize=9, loc="outside lower right", ncols=len(entries))


def _bar_text(result: Result) -> str:
    score = "" if result.normalized is None else f"  (score {result.normalized:.2f})".replace("-", "\u2212")
    return f"{result.mean:,.0f}".replace(",", "\u2009").replace("-", "\u2212") + score


def _say(axes: Axes, text: str) -> None:
    axes.set(xticks=[], yticks=[])
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", color=_RANDOM, fontsize=12)
