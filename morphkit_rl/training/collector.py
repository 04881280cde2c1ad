"""Collection: the environments of all training robots, and the replay that they fill."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from morphkit.errors import CheckpointError, ConfigError, TrainingError
from morphkit_rl.algorithms.actions import ActionRows
from morphkit_rl.buffers.replay_buffer import ReplayBuffer
from morphkit_rl.config.train_config import TrainerConfig
from morphkit_rl.envs.batch_env import BatchEnv
from morphkit_rl.envs.episode_counters import Episode
from morphkit_rl.envs.robot import Robot
from morphkit_rl.envs.step import Step
from morphkit_rl.models.layout import Layout
from morphkit_rl.runs.network_arrays import require_shapes
from morphkit_rl.runs.schema import check_generators

RECENT_EPISODES = 8
LEAST_SHARE = 0.05
"""Of an episode of full length, what of it has to be played for its return to be scaled up."""


class Collector:
    """Steps all environments with action rows of a layout and stores what happened.

    Args:
        robots: The training robots.
        layout: The same robots in rows, with all that is stored of them.
        config: Numbers of environments and of transitions, kind of observation.
        seed: Seed of the start states.

    Attributes:
        obs: (environments a robot, tokens) the observations that the next step starts from.
        buffers: Replay of each robot.
        steps: Environment steps over all robots that count for the budget.
        real_steps: All environment steps.
        episodes: Episodes that were reported.
        recent: Returns of each robot's latest reported episodes.
        first: The same of its first episodes, which are shorter, and whose returns are scaled to the full length.
        ended: Episodes of each robot that ended, int64 (robots,).
    """

    def __init__(self, robots: Sequence[Robot], layout: Layout, config: TrainerConfig, seed: int):
        self.robots, self.layout, self.num_envs = robots, layout, config.num_envs
        self.env = BatchEnv(
            [robot.simulation for robot in robots],
            [robot.task for robot in robots],
            config.num_envs,
            specs=[robot.seen for robot in robots],
            observation=config.observation,
            seed=seed,
        )
        self._rows = ActionRows(layout)
        widths = [
            (tokens.stop - tokens.start, a.stop - a.start)
            for tokens, a in zip(layout.tokens, layout.actions, strict=True)
        ]
        self.buffers = make_buffers(widths, config)
        self.steps = self.real_steps = self.episodes = 0
        self.recent: list[deque[float]] = [deque(maxlen=RECENT_EPISODES) for _ in robots]
        self.first: list[deque[float]] = [deque(maxlen=RECENT_EPISODES) for _ in robots]
        self.ended = np.zeros(len(robots), np.int64)
        self.obs = np.zeros(0)

    def reset(self, elapsed: np.ndarray | None = None) -> None:
        """Start all episodes anew.

        Args:
            elapsed: (robots, environments) steps that count as done already, so that the first episodes are shorter.
        """
        self.obs = np.concatenate(self.env.reset(elapsed), axis=1)

    def advance(self, action: np.ndarray) -> Step:
        """Step every environment; `store` must follow.

        Args:
            action: (environments a robot, actions) in [-1, 1].

        Raises:
            TrainingError: The policy's actions are not finite.
        """
        if not np.isfinite(action).all():
            raise TrainingError(
                f"training diverged: actions are not finite after {self.steps} steps; try a smaller td3.learning_rate. "
                "The last checkpoint is from before"
            )
        step = self.env.step(self._rows.to_controls(action))
        for episode in step.episodes:
            self.ended[episode.robot] += 1
        return step

    def store(self, action: np.ndarray, step: Step, *, cut: bool = False) -> None:
        """Put what `advance` gave into the replay, and go on from there.

        Args:
            action: What was given to `advance`.
            step: What it returned.
            cut: Whether the episodes that still run stop here, so that all start anew.
        """
        for robot, buffer in enumerate(self.buffers):
            buffer.add(
                obs=self.obs[:, self.layout.tokens[robot]],
                action=action[:, self.layout.actions[robot]],
                reward=step.reward[robot],
                next_obs=step.final_obs[robot],
                terminated=step.terminated[robot],
                ended=step.terminated[robot] | step.truncated[robot] | cut,
            )
        self.real_steps += self.num_envs * len(self.robots)
        self.obs = np.concatenate(step.obs, axis=1)
        if cut:
            self.reset()

    def report(self, episode: Episode) -> None:
        """Count an episode and remember its return."""
        self.recent[episode.robot].append(float(episode.episode_return))
        self.episodes += 1

    def report_first(self, episode: Episode, elapsed: int) -> None:
        """Remember the return of an episode that began as if so many steps were done already.

        Where the time limit ended it, its return is scaled to the full length; one too short for that is left out.
        """
        full = self.robots[episode.robot].task.episode_length
        share = (full - elapsed) / full if episode.length >= full else 1.0
        if share >= LEAST_SHARE:
            self.first[episode.robot].append(float(episode.episode_return) / share)

    def returns(self) -> dict[str, float]:
        """Mean return of each robot's latest episodes, with exploration noise; robots without one are left out."""
        pairs = zip(self.robots, self.recent, strict=True)
        return {robot.name: float(np.mean(recent)) for robot, recent in pairs if recent}

    def first_returns(self) -> dict[str, float]:
        """As `returns`, of the first episodes of robots that have no other yet."""
        triples = zip(self.robots, self.first, self.recent, strict=True)
        return {robot.name: float(np.mean(first)) for robot, first, recent in triples if first and not recent}

    def only_diverged(self) -> dict[str, int]:
        """Robots whose every episode ended because the simulation diverged, with how many those were.

        One for each environment is the least that counts.
        """
        pairs = zip(self.robots, self.ended.tolist(), self.env.diverged.tolist(), strict=True)
        return {robot.name: ended for robot, ended, diverged in pairs if ended == diverged and ended >= self.num_envs}

    def refuse_diverged(self, run: Path) -> None:
        """Raise where a robot has `only_diverged`.

        Raises:
            TrainingError: There is such a robot.
        """
        robots = self.only_diverged()
        if robots:
            found = ", ".join(f"{name} ({count})" for name, count in robots.items())
            raise TrainingError(
                f"{run}: the simulation diverged in every episode of {found}: there was nothing to learn from. Give"
                " the file a smaller timestep, or look for masses, inertias and gains that do not fit with morphkit"
                " check; else leave it out"
            )

    def arrays(self) -> dict[str, np.ndarray]:
        """State of the environments and their observations."""
        return {**self.env.state_dict(), "trainer/obs": self.obs}

    def state(self) -> dict[str, Any]:
        """Counters and returns."""
        return {
            "steps": self.steps,
            "real_steps": self.real_steps,
            "episodes": self.episodes,
            "recent": [list(recent) for recent in self.recent],
            "recent_first": [list(first) for first in self.first],
            "ended": self.ended.tolist(),
        }

    def restore(self, arrays: dict[str, np.ndarray], state: Mapping[str, Any], origin: Path) -> None:
        """Take over what `arrays` and `state` gave; the replay is filled separately.

        Raises:
            CheckpointError: They are of other robots or numbers of environments, or make no sense.
        """
        own = self.arrays()
        own["generators"] = arrays.get("generators", own["generators"])  # text, of any length
        require_shapes(arrays, own, origin, exactly=True)
        check_generators(arrays["generators"].astype(np.uint8).tobytes(), f"{origin}: generators")
        self.obs = arrays.pop("trainer/obs")
        self.env.load_state_dict(arrays)
        self.steps, self.real_steps, self.episodes = state["steps"], state["real_steps"], state["episodes"]
        ended = state.get("ended")
        if ended is not None and len(ended) != len(self.robots):
            raise CheckpointError(f"{origin.parent}: made with another number of robots than {len(self.robots)}")
        self.ended[:] = self.env.diverged + 1 if ended is None else ended  # older runs, which did not count, lost none
        for recent, values in zip(self.recent, state["recent"], strict=True):
            recent.extend(values)
        for first, values in zip(self.first, state.get("recent_first") or [[]] * len(self.first), strict=True):
            first.extend(values)


def make_buffers(widths: Sequence[tuple[int, int]], config: TrainerConfig) -> list[ReplayBuffer]:
    """The empty replay of robots, given the numbers of sensor and actuator tokens of each.

    Raises:
        ConfigError: There is not enough memory.
    """
    capacity = config.replay_capacity // len(widths)
    try:
        return [ReplayBuffer(*width, config.num_envs, capacity, config.replay_dtype) for width in widths]
    except MemoryError as error:
        most = max(sensors for sensors, _ in widths)
        raise ConfigError(
            f"a replay of {config.replay_capacity:,} transitions, of up to {most:,} sensor tokens each, does not fit"
            f" into memory ({error}); set trainer.replay_capacity to less, or train on bodies with fewer limbs"
        ) from None
