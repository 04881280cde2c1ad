"""How a training run shows itself: a live bar in a terminal, a line now and then elsewhere."""

from __future__ import annotations

import sys
from statistics import fmean
from types import TracebackType
from typing import TYPE_CHECKING, Any

from . import common
from .terminal import line

if TYPE_CHECKING:
    from morphkit_rl.training.progress import Progress

LINE_INTERVAL_S = 30.0
"""Time between two lines where stderr is no terminal, s."""
LINE_WIDTH = 240
"""Columns of such a line."""


class ProgressDisplay:
    """Shows the progress of a run on stderr.

    Args:
        title: What runs; shown with the first progress, when the run is known to have started.
        quiet: Show nothing.
    """

    def __init__(self, title: str, *, quiet: bool = False) -> None:
        self._title = title
        self._quiet = quiet
        from rich.console import Console

        terminal = sys.stderr.isatty()
        self._console = Console(
            file=sys.stderr, width=None if terminal else LINE_WIDTH, highlight=False, emoji=False, markup=False
        )
        self._live: Any = None
        self._next_line_s = 0.0

    def __enter__(self) -> ProgressDisplay:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if self._live is not None:
            self._live.stop()

    def update(self, progress: Progress) -> None:
        """Show `progress`."""
        if self._quiet:
            return
        if self._title:
            self._console.print(line(self._title))
            self._title = ""
            if self._console.is_terminal:
                self._start_bar()
        if self._live is not None:
            from rich.console import Group

            self._bar.update(self._task, completed=progress.fraction)
            lines = (line(rates(progress)), line(returns(progress)))
            self._live.update(Group(self._bar, *lines), refresh=True)
        elif progress.elapsed_s >= self._next_line_s:
            self._next_line_s = progress.elapsed_s + LINE_INTERVAL_S
            self._console.print(line(f"{progress.fraction:4.0%}  {rates(progress)}; {returns(progress)}"))

    def say(self, sentence: str) -> None:
        """Print a sentence of its own."""
        if not self._quiet:
            self._console.print(line(sentence))

    def _start_bar(self) -> None:
        from rich.live import Live
        from rich.progress import BarColumn, TaskProgressColumn, TextColumn
        from rich.progress import Progress as Bar

        self._bar = Bar(TextColumn("training"), BarColumn(bar_width=40), TaskProgressColumn(), auto_refresh=False)
        self._task = self._bar.add_task("training", total=1.0)
        self._live = Live(self._bar, console=self._console, auto_refresh=False)
        self._live.start()


def rates(progress: Progress) -> str:
    """`12 000 steps (1 500/s), 840 updates (31/s), 2 min 10 s, 5 min 50 s left`."""
    text = (
        f"{_thousands(progress.steps)} steps ({_thousands(progress.steps_per_s)}/s), "
        f"{_thousands(progress.updates)} updates ({progress.updates_per_s:.0f}/s), "
        f"{common.duration(progress.elapsed_s)}"
    )
    return text if progress.remaining_s is None else f"{text}, {common.duration(progress.remaining_s)} left"


def returns(progress: Progress) -> str:
    """The mean training return over the robots, with the worst and the best of them."""
    found = {**progress.first_returns, **progress.returns}
    if not found:
        return "no episode has ended yet"
    ranked = sorted(found.items(), key=lambda item: item[1])
    (worst, low), (best, high) = ranked[0], ranked[-1]
    text = f"mean return {fmean(found.values()):.0f}"
    if len(ranked) > 1:
        text += f", from {low:.0f} ({worst}) to {high:.0f} ({best})"
    return f"{text}; of first, shorter episodes, scaled up" if progress.first_returns else text


def _thousands(number: float) -> str:
    return f"{round(number):,}".replace(",", " ")
