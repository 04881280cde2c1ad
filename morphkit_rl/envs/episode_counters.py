"""What is counted of every environment's episode: its rewards and its control steps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np


class Episode(NamedTuple):
    """A finished episode: index of robot and environment, sum of rewards, control steps, whether it diverged."""

    robot: int
    env: int
    episode_return: float
    length: int
    diverged: bool = False


class EpisodeCounters:
    """Counts in all environments of all robots at once.

    Args:
        envs: Which environments each robot has, as slices of the flat arrays.
        max_length: Control steps after which an episode of each robot is truncated.

    Attributes:
        returns: Sum of an episode's rewards so far, float64 (environments,).
        lengths: Its control steps so far, int64 (environments,).
    """

    def __init__(self, envs: Sequence[slice], max_length: Sequence[int]) -> None:
        self._envs = envs
        self._max_length = np.repeat(max_length, [mine.stop - mine.start for mine in envs])
        self.returns = np.zeros(len(self._max_length))
        self.lengths = np.zeros(len(self._max_length), np.int64)

    def restart(self, which: slice | np.ndarray, elapsed: np.ndarray | int = 0) -> None:
        """Count anew in some environments, from so many control steps."""
        self.returns[which], self.lengths[which] = 0, elapsed

    def add(self, reward: np.ndarray) -> np.ndarray:
        """Count a control step of every environment; bool (environments,), whether its episode has its full length."""
        self.returns += reward
        self.lengths += 1
        return self.lengths >= self._max_length

    def end(self, done: np.ndarray, diverged: np.ndarray | None) -> list[Episode]:
        """End the episodes of the environments that are `done`, bool (environments,), and count anew there.

        Args:
            done: Where an episode ends.
            diverged: Where the simulation diverged; None for nowhere.

        Returns:
            The episodes that ended, robot by robot.
        """
        episodes = []
        for robot, mine in enumerate(self._envs if done.any() else ()):
            for env in np.flatnonzero(done[mine]):
                at = mine.start + env
                bad = diverged is not None and bool(diverged[at])
                episodes.append(Episode(robot, int(env), float(self.returns[at]), int(self.lengths[at]), bad))
        self.restart(done)
        return episodes
