"""Per-robot scale of rewards, from running discounted returns."""

from __future__ import annotations

import numpy as np

_LEAST = 1e-3
"""Least divisor, so that rewards of a robot that gets none stay finite."""


class ReturnNormalizer:
    """Divides each robot's rewards so that its returns have about the same size as every other robot's.

    With G the discounted sum of an environment's past rewards, G <- discount * G + r, begun anew with each episode,
    rewards are divided by

        max( std G, max |G| / support )

    over all that a robot has seen: returns then fit into [-support, support], and robots whose rewards differ by orders
    count alike (Lee et al. 2025, SimbaV2, section 4.2; Nauman et al. 2025, BRC). Rewards are stored as they are; the
    divisor of the moment is applied when they are drawn.

    Args:
        robots: Number of robots.
        num_envs: Environments a robot.
        discount: Discount of one step.
        support: Largest value that the critics can express.
    """

    def __init__(self, robots: int, num_envs: int, discount: float, support: float):
        self.discount, self.support = discount, support
        self.running = np.zeros((robots, num_envs))
        self.count = 0.0
        self.mean, self.m2, self.largest = np.zeros(robots), np.zeros(robots), np.zeros(robots)

    def update(self, reward: np.ndarray, ended: np.ndarray) -> None:
        """Add a step of all environments.

        Args:
            reward: (robots, environments).
            ended: (robots, environments) whether the episode ended with it.
        """
        self.running = self.running * self.discount + reward
        self.largest = np.maximum(self.largest, np.abs(self.running).max(1))
        count, mean = self.running.shape[1], self.running.mean(1)
        merged, delta = self.count + count, mean - self.mean
        self.m2 = self.m2 + ((self.running - mean[:, None]) ** 2).sum(1) + delta**2 * self.count * count / merged
        self.mean = self.mean + delta * count / merged
        self.count = merged
        self.running[ended] = 0

    def scale(self) -> np.ndarray:
        """(robots,) float32 factors on rewards; 1 before anything was seen."""
        if not self.count:
            return np.ones(len(self.mean), np.float32)
        divisor = np.maximum(np.sqrt(self.m2 / self.count), self.largest / self.support)
        return (1 / np.maximum(divisor, _LEAST)).astype(np.float32)

    def state_dict(self) -> dict[str, np.ndarray]:
        """Everything that later scales follow from."""
        return {
            "running": self.running,
            "count": np.array([self.count]),
            "mean": self.mean,
            "m2": self.m2,
            "largest": self.largest,
        }

    def load_state_dict(self, state: dict[str, np.ndarray]) -> None:
        """Take over what `state_dict` gave."""
        self.running, self.mean, self.m2, self.largest = (
            np.array(state[name], np.float64) for name in ("running", "mean", "m2", "largest")
        )
        self.count = float(state["count"][0])
