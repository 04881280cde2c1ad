"""How far a training run is, and the clock that its budget is measured with."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a run is.

    Attributes:
        steps: Environment steps over all robots; those that the schedule counts.
        updates: Critic updates.
        elapsed_s: Training time, s, over all resumptions.
        remaining_s: Estimated time left, s; None before there is an estimate.
        fraction: Share of the budget that is used, 0 to 1.
        steps_per_s: Environment steps a second of late.
        updates_per_s: Updates a second of late.
        returns: Mean return of each robot's latest episodes, with exploration noise.
        first_returns: The same of robots that have ended only first, shorter episodes; scaled to the full length.
    """

    steps: int
    updates: int
    elapsed_s: float
    remaining_s: float | None
    fraction: float
    steps_per_s: float
    updates_per_s: float
    returns: dict[str, float]
    first_returns: dict[str, float]


@dataclass(frozen=True, slots=True)
class TrainSummary:
    """How a run ended.

    Attributes:
        run: The run folder.
        steps: Environment steps over all robots; those that the schedule counts.
        real_steps: All environment steps.
        updates: Critic updates.
        elapsed_s: Training time, s, over all resumptions.
        returns: Mean return of each robot's latest episodes, with exploration noise.
        first_returns: The same of robots that have ended only first, shorter episodes; scaled to the full length.
        diverged: Episodes that ended because the simulation diverged.
        interrupted: Whether Ctrl-C ended it before its budget.
        advanced: Whether anything was done; not where a resumed run had used up its budget.
    """

    run: Path
    steps: int
    real_steps: int
    updates: int
    elapsed_s: float
    returns: dict[str, float]
    first_returns: dict[str, float]
    diverged: int
    interrupted: bool
    advanced: bool = True


def hundredth(steps: int, budget: int | None) -> int:
    """Which hundredth of a budget of steps such a number of steps is in; 0 where there is no budget.

    A row of metrics is written where one begins, so that these rows are the same however fast a run goes.
    """
    return 0 if budget is None else 100 * steps // budget


class Mark(NamedTuple):
    """A moment of a run, to measure rates from."""

    elapsed_s: float
    steps: int
    updates: int


class Clock:
    """Training time, s, over all resumptions; it is stopped until `start` and while `paused`."""

    def __init__(self) -> None:
        self._before, self._began = 0.0, None

    _began: float | None

    @property
    def elapsed_s(self) -> float:
        """The training time so far."""
        return self._before + (0.0 if self._began is None else time.perf_counter() - self._began)

    @elapsed_s.setter
    def elapsed_s(self, value: float) -> None:
        self._before = value
        self._began = None if self._began is None else time.perf_counter()

    def start(self) -> None:
        """Let it run."""
        self._began = time.perf_counter()

    def stop(self) -> None:
        """Stop it."""
        self._before, self._began = self.elapsed_s, None

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Stop it for a while."""
        self.stop()
        try:
            yield
        finally:
            self.start()
