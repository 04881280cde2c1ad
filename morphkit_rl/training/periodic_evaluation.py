"""Noise-free evaluation while a run trains: of the training robots, and of validation robots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from morphkit.errors import ConfigError
from morphkit_rl.algorithms.actions import ActionRows
from morphkit_rl.algorithms.agent import Agent
from morphkit_rl.config.train_config import TrainerConfig
from morphkit_rl.envs.batch_env import BatchEnv
from morphkit_rl.envs.robot import Robot
from morphkit_rl.evaluation.episodes import normalized, play, random_controller

_STREAM = 3  # keeps the start states apart from those of training


class Monitor:
    """Evaluates an agent every so many steps, from environments and random generators of its own.

    The start states of an evaluation follow from the seed and the evaluation's number alone, so that a resumed run
    repeats them and that training does not notice.

    Args:
        agent: What acts.
        robots: Training robots, then validation robots.
        config: How often, and how many episodes.
        seed: Seed of the run.
        validation: How many of the robots are validation robots.

    Attributes:
        done: Number of the last evaluation: steps / `evaluate_steps`, rounded down.
        best: What the best evaluation so far was worth; None before the first.
        improved: Whether the last evaluation was the best so far.
    """

    def __init__(self, agent: Agent, robots: Sequence[Robot], config: TrainerConfig, seed: int, validation: int = 0):
        self.agent, self.robots, self.config, self.seed = agent, robots, config, seed
        self.done, self._validation = 0, validation
        self.best: float | None = None
        self.improved = False
        self._random: list[float] = []
        self._env: BatchEnv | None = None
        self._view = agent.view([robot.spec for robot in robots])
        self._rows = ActionRows(self._view.layout)

    def due(self, steps: int) -> bool:
        """Whether an evaluation is to be done after so many steps."""
        return 0 < self.config.evaluate_steps <= steps - self.done * self.config.evaluate_steps

    def evaluate(self, steps: int) -> dict[str, dict[str, Any]]:
        """Play noise-free episodes on every robot.

        Returns:
            For each robot `returns`, their `mean`, and `score` = (mean - random) / (expert - random), None where no
            expert return is known. The random policy's return is measured once, from as many episodes.
        """
        number = steps // self.config.evaluate_steps
        env = self._environments()
        if not self._random:
            env.seed([self.seed, _STREAM, 0])
            self._random = [float(returns.mean()) for returns in play(env, random_controller(env, self.seed))[0]]
        env.seed([self.seed, _STREAM, number])
        self.agent.refresh()
        returns = play(env, self._act).returns
        self.done = number
        found = {
            robot.name: {
                "mean": float(own.mean()),
                "returns": own.tolist(),
                "score": normalized(float(own.mean()), random, robot.simulation.description.info.expert_return),
            }
            for robot, own, random in zip(self.robots, returns, self._random, strict=True)
        }
        worth = _worth(list(found.values())[-self._validation :]) if self._validation else None
        self.improved = worth is not None and (self.best is None or worth > self.best)
        self.best = worth if self.improved else self.best
        return found

    def state(self) -> dict[str, Any]:
        """What a resumed run must know."""
        return {"done": self.done, "random": self._random, "best": self.best}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take over what `state` gave.

        Raises:
            ConfigError: It is of other robots.
        """
        if len(state["random"]) not in (0, len(self.robots)):
            raise ConfigError(f"the evaluation's state is of {len(state['random'])} robots, not {len(self.robots)}")
        self.done, self._random, self.best = state["done"], list(state["random"]), state.get("best")

    def close(self) -> None:
        """Stop the threads of the environments."""
        if self._env is not None:
            self._env.close()

    def _environments(self) -> BatchEnv:
        if self._env is None:
            self._env = BatchEnv(
                [robot.simulation for robot in self.robots],
                [robot.task for robot in self.robots],
                self.config.evaluate_episodes,
                specs=[robot.spec for robot in self.robots],
                observation=self.config.observation,
            )
        return self._env

    def _act(self, obs: list[np.ndarray]) -> list[np.ndarray]:
        return self._rows.to_controls(self.agent.act(np.concatenate(obs, axis=1), self._view, final=True))


def _worth(results: Sequence[Mapping[str, Any]]) -> float:
    """Mean score of an evaluation, or mean return where a robot has no score."""
    scores = [result["score"] for result in results]
    return float(np.mean([result["mean"] for result in results] if None in scores else scores))
