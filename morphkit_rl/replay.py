"""Replay: one preallocated float32 ring a robot, unpadded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

FIELDS = ("obs", "action", "reward", "next_obs", "terminated", "ended")


@dataclass(frozen=True, slots=True)
class Batch:
    """Transitions of all robots side by side.

    Attributes:
        obs: (batch, tokens) observations.
        action: (batch, actuators) actions in [-1, 1].
        reward: (batch, robots) sum of up to n discounted rewards.
        next_obs: (batch, tokens) observations after those rewards.
        discount: (batch, robots) factor on the value there: discount ** steps, 0 where the episode terminated.
    """

    obs: np.ndarray
    action: np.ndarray
    reward: np.ndarray
    next_obs: np.ndarray
    discount: np.ndarray


class Ring:
    """The transitions of one robot, sweep by sweep: row `sweep * num_envs + env`, modulo the capacity."""

    def __init__(self, tokens: int, actuators: int, num_envs: int, capacity: int):
        self.num_envs = num_envs
        self.sweeps = max(capacity // num_envs, 2)
        rows = self.sweeps * num_envs
        self.added = 0
        self.obs = np.zeros((rows, tokens), np.float32)
        self.action = np.zeros((rows, actuators), np.float32)
        self.reward = np.zeros(rows, np.float32)
        self.next_obs = np.zeros((rows, tokens), np.float32)
        self.terminated = np.zeros(rows, bool)
        self.ended = np.zeros(rows, bool)

    def add(self, **fields: np.ndarray) -> None:
        """Store one transition of every environment; `fields` are those of `FIELDS`, (num_envs, ...)."""
        start = (self.added % self.sweeps) * self.num_envs
        for name in FIELDS:
            getattr(self, name)[start : start + self.num_envs] = fields[name]
        self.added += 1

    def __len__(self) -> int:
        """Number of transitions held."""
        return min(self.added, self.sweeps) * self.num_envs

    def rows(self, first: int, last: int) -> np.ndarray:
        """Row numbers of the sweeps `first` to `last` (exclusive), counted from the first ever added."""
        sweeps = np.arange(first, last) % self.sweeps
        return (sweeps[:, None] * self.num_envs + np.arange(self.num_envs)).ravel()

    def sample(self, batch: int, n_step: int, discount: float, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
        """Draw transitions with replacement; obs, action, n-step reward, next_obs, discount as in `Batch`."""
        oldest = max(self.added - self.sweeps, 0)
        steps = min(n_step, self.added - oldest)
        sweep = rng.integers(oldest, self.added, batch)
        env = rng.integers(0, self.num_envs, batch)
        first = row = (sweep % self.sweeps) * self.num_envs + env
        reward, factor = self.reward[row].copy(), np.full(batch, discount, np.float32)
        for step in range(1, steps):
            going = ~self.ended[row] & (sweep + step < self.added)
            row = np.where(going, ((sweep + step) % self.sweeps) * self.num_envs + env, row)
            reward += np.where(going, factor * self.reward[row], 0)
            factor = np.where(going, factor * discount, factor).astype(np.float32)
        factor = np.where(self.terminated[row], 0, factor)
        return self.obs[first], self.action[first], reward, self.next_obs[row], factor


def sample(rings: Sequence[Ring], batch: int, n_step: int, discount: float, rng: np.random.Generator) -> Batch:
    """Draw `batch` transitions of every robot."""
    parts = list(zip(*(ring.sample(batch, n_step, discount, rng) for ring in rings), strict=True))
    obs, action, reward, next_obs, factor = parts
    return Batch(
        np.concatenate(obs, 1), np.concatenate(action, 1), np.stack(reward, 1),
        np.concatenate(next_obs, 1), np.stack(factor, 1),
    )  # fmt: skip
