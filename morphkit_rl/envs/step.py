"""What a control step of many environments gives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from morphkit_rl.envs.episode_counters import Episode


@dataclass(frozen=True, slots=True)
class Step:
    """What a control step gave; each list has one array a robot, environments along the first axis.

    Attributes:
        obs: Observations to act on next: where an episode ended, the first of the next one. float32 (n, tokens).
        final_obs: Observations that the step led to, before any reset. The same array as `obs` where no episode ended.
            Where the simulation diverged, the last finite observation.
        reward: float64 (n,).
        terminated: bool (n,); the robot fell or the simulation diverged: nothing follows.
        truncated: bool (n,); the episode reached its length.
        episodes: Episodes that ended in this step.
    """

    obs: list[np.ndarray]
    final_obs: list[np.ndarray]
    reward: list[np.ndarray]
    terminated: list[np.ndarray]
    truncated: list[np.ndarray]
    episodes: list[Episode]
