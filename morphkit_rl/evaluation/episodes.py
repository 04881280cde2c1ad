"""Whole episodes of several robots, without learning."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from morphkit_rl.algorithms.actions import ActionScale
from morphkit_rl.envs.batch_env import BatchEnv

RESAMPLES = 10_000

Act = Callable[[list[np.ndarray]], Sequence[np.ndarray]]
"""Observations, one (environments, tokens) a robot, to controls, one (environments, actuators) a robot."""


class Played(NamedTuple):
    """One episode of every environment: returns and lengths, one (environments,) a robot; how many diverged."""

    returns: list[np.ndarray]
    lengths: list[np.ndarray]
    diverged: list[int]


@dataclass(frozen=True)
class RobotReturns:
    """Episodes of one controller on one robot.

    Attributes:
        robot: Name of the robot.
        returns: Return of each episode.
        lengths: Control steps of each episode.
        expert_return: Return of a single-robot expert; None where unknown.
    """

    robot: str
    returns: tuple[float, ...]
    lengths: tuple[int, ...]
    expert_return: float | None

    @property
    def mean(self) -> float:
        """Mean return."""
        return float(np.mean(self.returns))

    @property
    def std(self) -> float:
        """Standard deviation of the returns."""
        return float(np.std(self.returns))

    @cached_property
    def interval(self) -> tuple[float, float]:
        """95 % percentile bootstrap interval of the mean return."""
        return mean_interval(self.returns)


def play(env: BatchEnv, act: Act) -> Played:
    """Play the first episode of every environment.

    Args:
        env: The environments; they are reset.
        act: The controller.
    """
    obs = env.reset()
    returns = [np.zeros(n) for n in env.num_envs]
    lengths = [np.zeros(n, np.int64) for n in env.num_envs]
    diverged = [0] * env.num_robots
    going = [np.ones(n, bool) for n in env.num_envs]
    while any(mine.any() for mine in going):
        step = env.step(act(obs))
        for episode in step.episodes:
            diverged[episode.robot] += episode.diverged and bool(going[episode.robot][episode.env])
        for robot, mine in enumerate(going):
            returns[robot][mine] += step.reward[robot][mine]
            lengths[robot][mine] += 1
            mine &= ~(step.terminated[robot] | step.truncated[robot])
        obs = step.obs
    return Played(returns, lengths, diverged)


def random_controller(env: BatchEnv, seed: int) -> Act:
    """Controls drawn uniformly from their ranges; what a robot gets does not depend on the other robots."""
    names = [simulation.name for simulation in env.simulations]
    rngs = [np.random.default_rng([seed, zlib.crc32(name.encode())]) for name in names]
    scales = [ActionScale(spec) for spec in env.specs]
    shapes = [(n, len(spec.actuators)) for n, spec in zip(env.num_envs, env.specs, strict=True)]

    def act(_: list[np.ndarray]) -> list[np.ndarray]:
        drawn = [rng.uniform(-1, 1, shape) for rng, shape in zip(rngs, shapes, strict=True)]
        return [scale.to_controls(values) for scale, values in zip(scales, drawn, strict=True)]

    return act


def mean_interval(returns: Sequence[float]) -> tuple[float, float]:
    """95 % percentile bootstrap interval of the mean return, the same for the same returns."""
    values = np.asarray(returns)
    means = np.random.default_rng(0).choice(values, (RESAMPLES, len(values))).mean(1)
    low, high = np.percentile(means, [2.5, 97.5])
    return float(low), float(high)


def normalized(value: float, random: float, expert: float | None) -> float | None:
    """(value - random) / (expert - random); None where no expert return is known."""
    return None if expert is None else (value - random) / (expert - random)
