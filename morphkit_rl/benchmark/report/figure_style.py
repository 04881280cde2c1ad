"""What the report's figures share: size, colors, legend and labels."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from morphkit.errors import DependencyError
from morphkit.utils.atomic_write import write_output
from morphkit_rl.benchmark.published import OVERALL
from morphkit_rl.config.methods import find_method, method_names

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, QUIET, GRID = "#262626", "#7A7A7A", "#E8E8E8"

_OTHERS = ("#E69F00", "#8C564B", "#5E3C99", "#666666")
_BOX = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.5}
_WITHOUT_TYPES = "-no-ltv"
_COLUMNS = 4
_PANEL = (3.6, 2.75)  # inches

_STYLE = {
    "font.size": 9, "axes.edgecolor": INK, "axes.labelcolor": INK, "text.color": INK, "xtick.color": INK,
    "ytick.color": INK, "axes.titlesize": 10, "axes.titleweight": "bold", "axes.titlelocation": "left",
    "axes.spines.top": False, "axes.spines.right": False, "legend.frameon": False,
    "hatch.linewidth": 1.4, "text.parse_math": False,
}  # fmt: skip


def color(method: str, methods: Sequence[str]) -> str:
    """A method's color: its own, that of the method it is a preset of, or one of the others in order."""
    base = base_of(method)
    if own := _own_color(base):
        return own
    unknown = list(dict.fromkeys(base_of(each) for each in methods if not _own_color(base_of(each))))
    return _OTHERS[unknown.index(base) % len(_OTHERS)]


def _own_color(name: str) -> str:
    return find_method(name).color if name in method_names() else ""


def base_of(method: str) -> str:
    """A method without `-no-ltv`, which says that limb types are not observed."""
    return method.removesuffix(_WITHOUT_TYPES)


def label(method: str) -> str:
    """A method's name as the literature writes it."""
    base = base_of(method)
    own = find_method(base).label if base in method_names() else ""
    return (own or base) + (" without limb types" if base != method else "")


def order(method: str) -> tuple[int, str]:
    """Sorts methods: the newest first, then those of the literature, then others by name."""
    base, known = base_of(method), method_names()
    return (known.index(base) if base in known else len(known), method)


def set_labels(axes: Axes, task: str, x: str, y: str) -> None:
    """Title of a panel, and labels of the axes at the left and lower edge of the figure."""
    text = "mean of all tasks" if task == OVERALL else task
    axes.set_title(text, fontsize=10 if len(text) < 28 else 9)
    place = axes.get_subplotspec()
    if place is None or place.is_first_col():
        axes.set_ylabel(y)
    if place is None or place.is_last_row():
        axes.set_xlabel(x)


def number(value: float) -> str:
    """`2 110`, `−35`; a share with two digits."""
    text = f"{value:,.0f}" if abs(value) >= 10 or value == 0 else f"{value:.2f}"
    return text.replace(",", "\u2009").replace("-", "\u2212")


def draw_panels(
    tasks: Sequence[str], draw: Callable[[Axes, str], None], path: Path, *, heading: str, legend: Iterable[Any]
) -> Path:
    """Write a PNG with a panel a task, a heading above and a legend below.

    Args:
        tasks: The panels, row by row.
        draw: Fills the panel of a task.
        path: The file.
        heading: Text above.
        legend: Handles of the legend.

    Raises:
        OutputError: The file cannot be written.
        DependencyError: matplotlib is not installed.
    """
    try:
        import matplotlib as mpl
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise DependencyError(f'plots need matplotlib: pip install "morphkit[viewer]" ({error})') from None

    handles = list(legend)
    columns = min(_COLUMNS, len(tasks))
    rows = math.ceil(len(tasks) / columns)
    with mpl.rc_context(_STYLE):
        width = max(columns * _PANEL[0], 2 * _PANEL[0])
        entries = max(1, int(width / 3.3))
        below = 0.3 * math.ceil(len(handles) / entries)
        figure: Figure = Figure(
            figsize=(width, rows * _PANEL[1] + 0.7 + below), layout="constrained", facecolor="white"
        )
        FigureCanvasAgg(figure)
        figure.suptitle(heading, x=0.01, ha="left", fontsize=12, fontweight="bold")
        for index, axes in enumerate(figure.subplots(rows, columns, squeeze=False).flat):
            if index < len(tasks):
                draw(axes, tasks[index])
            else:
                axes.set_axis_off()
        ncols = min(entries, len(handles)) or 1
        figure.legend(handles=handles, loc="outside lower left", ncols=ncols, handlelength=3.2)
        return write_output(path, lambda target: figure.savefig(target, format="png", dpi=130))


def say(axes: Axes, text: str) -> None:
    """Put a quiet remark into the middle of a panel."""
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", color=QUIET, fontsize=9, bbox=_BOX)


def remark(axes: Axes, lines: Sequence[str]) -> None:
    """Put what is not whole into the lower right corner of a panel."""
    if lines:
        axes.text(0.985, 0.03, "\n".join(lines), transform=axes.transAxes, ha="right", va="bottom", fontsize=7.5,
                  color=QUIET, bbox=_BOX, zorder=5)  # fmt: skip
