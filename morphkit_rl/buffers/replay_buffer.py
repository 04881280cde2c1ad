"""Replay buffers: one preallocated ring of arrays a robot, unpadded, in which no observation is stored twice."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

ReplayDtype = Literal["float32", "float16"]

FIELDS = ("obs", "action", "reward", "terminated", "ended")
"""Arrays of a replay buffer with one row a transition."""


@dataclass(frozen=True, slots=True)
class Batch:
    """Transitions of all robots side by side.

    Attributes:
        obs: (batch, tokens) observations.
        action: (batch, actions) actions in [-1, 1].
        reward: (batch, robots) sum of up to n discounted rewards.
        next_obs: (batch, tokens) observations after those rewards.
        discount: (batch, robots) factor on the value there: discount ** steps, 0 where the episode terminated.
    """

    obs: np.ndarray
    action: np.ndarray
    reward: np.ndarray
    next_obs: np.ndarray
    discount: np.ndarray

    def split(self, parts: int) -> Iterator[Batch]:
        """The batch in so many parts of equal size."""
        size = len(self.obs) // parts
        for first in range(0, parts * size, size):
            yield Batch(*(getattr(self, field)[first : first + size] for field in Batch.__slots__))


class Finals:
    """Observations that ended an episode, so that no next transition starts from them.

    A queue in the order of the transitions' numbers, so that a look-up is a binary search.

    Attributes:
        first: Place of the oldest entry.
        last: Place behind the newest entry.
    """

    def __init__(self, tokens: int, dtype: ReplayDtype):
        self.first = self.last = 0
        self._numbers = np.zeros(0, np.int64)
        self._obs = np.zeros((0, tokens), dtype)

    @property
    def numbers(self) -> np.ndarray:
        """Number of the transition of each entry, ascending."""
        return self._numbers[self.first : self.last]

    @property
    def obs(self) -> np.ndarray:
        """(entries, tokens)."""
        return self._obs[self.first : self.last]

    @property
    def nbytes(self) -> int:
        """Bytes allocated."""
        return self._numbers.nbytes + self._obs.nbytes

    def push(self, numbers: np.ndarray, obs: np.ndarray) -> None:
        """Append entries of transitions newer than all before."""
        end = self.last + len(numbers)
        if end > len(self._numbers):
            held = self.last - self.first
            room = 2 * (held + len(numbers))
            for name in ("_numbers", "_obs"):
                old = getattr(self, name)
                new = np.empty((room, *old.shape[1:]), old.dtype)
                new[:held] = old[self.first : self.last]
                setattr(self, name, new)
            self.first, self.last, end = 0, held, held + len(numbers)
        self._numbers[self.last : end], self._obs[self.last : end] = numbers, obs
        self.last = end

    def drop(self, before: int) -> None:
        """Forget the entries of transitions with a number below `before`."""
        self.first += int(np.searchsorted(self.numbers, before))

    def get(self, numbers: np.ndarray) -> np.ndarray:
        """(len(numbers), tokens) observations after the transitions `numbers`, which must be there."""
        return self.obs[np.searchsorted(self.numbers, numbers)]


class ReplayBuffer:
    """The transitions of one robot, sweep by sweep.

    Transition `sweep * num_envs + env` is in the row of this number modulo the capacity. The observation that it
    led to is the one that the next sweep starts from; where its episode ended, it is in `finals`; that of the
    newest sweep is in `newest`. Memory is taken up as rows are filled.

    Args:
        tokens: Width of an observation.
        actions: Width of an action.
        num_envs: Environments that are stored in step.
        capacity: Transitions kept, rounded down to whole sweeps.
        dtype: How observations and actions are stored; `float16` halves the memory, rounds to 11 significant bits and
            bounds at 65504.
    """

    def __init__(self, tokens: int, actions: int, num_envs: int, capacity: int, dtype: ReplayDtype = "float32"):
        self.num_envs = num_envs
        self.sweeps = max(capacity // num_envs, 2)
        rows = self.sweeps * num_envs
        self.added = 0
        self.obs = np.zeros((rows, tokens), dtype)
        self.action = np.zeros((rows, actions), dtype)
        self.reward = np.zeros(rows, np.float32)
        self.terminated, self.ended = np.zeros(rows, bool), np.zeros(rows, bool)
        self.newest = np.zeros((num_envs, tokens), dtype)
        self.finals = Finals(tokens, dtype)
        self._largest = np.finfo(dtype).max

    def add(
        self,
        *,
        obs: np.ndarray,
        action: np.ndarray,
        reward: np.ndarray,
        next_obs: np.ndarray,
        terminated: np.ndarray,
        ended: np.ndarray,
    ) -> None:
        """Store one transition of every environment.

        Args:
            obs: (num_envs, tokens).
            action: (num_envs, actions) in [-1, 1].
            reward: (num_envs,).
            next_obs: (num_envs, tokens) what the transition led to; where the episode goes on, the next `obs`.
            terminated: (num_envs,) nothing follows.
            ended: (num_envs,) the episode ends here, terminated or truncated; the next transition starts elsewhere.
        """
        first = (self.added % self.sweeps) * self.num_envs
        rows = slice(first, first + self.num_envs)
        self.obs[rows], self.newest[:] = self._bounded(obs), self._bounded(next_obs)
        self.action[rows], self.reward[rows] = action, reward
        self.terminated[rows], self.ended[rows] = terminated, ended
        if ended.any():
            self.finals.push(self.added * self.num_envs + np.flatnonzero(ended), self.newest[ended])
        self.added += 1
        self.finals.drop(self.oldest * self.num_envs)

    def __len__(self) -> int:
        """Number of transitions held."""
        return min(self.added, self.sweeps) * self.num_envs

    @property
    def oldest(self) -> int:
        """The oldest sweep that is held, counted from the first ever added."""
        return max(self.added - self.sweeps, 0)

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays, whether they are filled or not."""
        return sum(getattr(self, name).nbytes for name in FIELDS) + self.newest.nbytes + self.finals.nbytes

    def rows(self, first: int, last: int) -> np.ndarray:
        """Row numbers of the sweeps `first` to `last` (exclusive), counted from the first ever added."""
        sweeps = np.arange(first, last) % self.sweeps
        return (sweeps[:, None] * self.num_envs + np.arange(self.num_envs)).ravel()

    def sample(self, batch: int, n_step: int, discount: float, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
        """Draw transitions with replacement; obs, action, n-step reward, next_obs, discount as in `Batch`."""
        steps = min(n_step, self.added - self.oldest)
        sweep = rng.integers(self.oldest, self.added, batch)
        env = rng.integers(0, self.num_envs, batch)
        first = row = (sweep % self.sweeps) * self.num_envs + env
        reward, factor = self.reward[row].copy(), np.full(batch, discount, np.float32)
        last = sweep
        for step in range(1, steps):
            going = ~self.ended[row] & (sweep + step < self.added)
            last = np.where(going, sweep + step, last)
            row = (last % self.sweeps) * self.num_envs + env
            reward += np.where(going, factor * self.reward[row], 0)
            factor = np.where(going, factor * discount, factor).astype(np.float32)
        factor = np.where(self.terminated[row], 0, factor)
        return _wide(self.obs[first]), _wide(self.action[first]), reward, self._after(last, env), factor

    def _after(self, sweep: np.ndarray, env: np.ndarray) -> np.ndarray:
        """Observations that the transitions of these sweeps and environments led to."""
        obs = self.obs[((sweep + 1) % self.sweeps) * self.num_envs + env]
        ended = self.ended[(sweep % self.sweeps) * self.num_envs + env]
        obs[ended] = self.finals.get((sweep * self.num_envs + env)[ended])
        newest = sweep + 1 == self.added
        obs[newest] = self.newest[env[newest]]
        return _wide(obs)

    def _bounded(self, obs: np.ndarray) -> np.ndarray:
        return obs if self.obs.dtype == np.float32 else np.clip(obs, -self._largest, self._largest)


def sample(
    buffers: Sequence[ReplayBuffer], batch: int, n_step: int, discount: float, rng: np.random.Generator
) -> Batch:
    """Draw `batch` transitions of every robot."""
    parts = list(zip(*(buffer.sample(batch, n_step, discount, rng) for buffer in buffers), strict=True))
    obs, action, reward, next_obs, factor = parts
    return Batch(
        np.concatenate(obs, 1), np.concatenate(action, 1), np.stack(reward, 1),
        np.concatenate(next_obs, 1), np.stack(factor, 1),
    )  # fmt: skip


def _wide(values: np.ndarray) -> np.ndarray:
    return values.astype(np.float32, copy=False)
