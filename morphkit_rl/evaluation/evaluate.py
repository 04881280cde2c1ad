"""Noise-free returns of a policy compared with a random one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import torch

from morphkit.description import Description
from morphkit.errors import ConfigError
from morphkit.morphology import Base
from morphkit.simulation.build import Simulation
from morphkit_rl.algorithms.policy import Policy
from morphkit_rl.envs.batch_env import BatchEnv
from morphkit_rl.envs.robot import Robot
from morphkit_rl.envs.tasks import Task
from morphkit_rl.evaluation.episodes import RobotReturns, mean_interval, normalized, play, random_controller
from morphkit_rl.runs.run_folder import LATEST


@dataclass(frozen=True)
class RobotResult(RobotReturns):
    """Noise-free returns of a trained policy on one robot, compared with those of a random one.

    Attributes:
        trained_on: Whether training saw the robot.
        random_returns: Return of each episode with actions drawn uniformly from the control ranges.
        diverged: Noise-free episodes that ended because the simulation diverged.
        random_diverged: The same of the random policy.
        mirrored: Whether it acted as for the mirror image of the robot, which training knew better; see `Policy.reads`.
        rests: Limbs that the policy did not act by, since training had none of their texts; see `Policy.rests`.
    """

    trained_on: bool
    random_returns: tuple[float, ...]
    diverged: int = 0
    random_diverged: int = 0
    mirrored: bool = False
    rests: tuple[str, ...] = ()

    @property
    def random_mean(self) -> float:
        """Mean return of the random policy."""
        return float(np.mean(self.random_returns))

    @cached_property
    def random_interval(self) -> tuple[float, float]:
        """95 % percentile bootstrap interval of the random policy's mean return."""
        return mean_interval(self.random_returns)

    @property
    def normalized(self) -> float | None:
        """(return - random) / (expert - random); None where no expert return is known."""
        return normalized(self.mean, self.random_mean, self.expert_return)


def evaluate(
    run: str | Path,
    descriptions: Sequence[Description],
    *,
    episodes: int = 10,
    seed: int = 0,
    task: str | Task | None = None,
    base: Base | None = None,
    encoder: str | None = None,
    checkpoint: str = LATEST,
) -> list[RobotResult]:
    """Run a trained policy on robots, seen or unseen.

    Args:
        run: The run folder, or what else `Policy.load` takes.
        descriptions: The robots.
        episodes: Episodes a robot, for the policy and for the random one; each starts from a reset of its own.
        seed: Seed of resets and of the random policy.
        task: The task, its name or its TOML file; default: that of the run, which may be each robot's own.
        base: How roots are attached to the world; default: as `task`.
        encoder: Text encoder in place of the run's own; see `Policy.load`.
        checkpoint: Which of the run's checkpoints; as `encoder`.

    Raises:
        CheckpointError: The run has no whole checkpoint.
        ConfigError: The run's text encoder needs trust, a robot has no actuators, `episodes` is less than 1, or `seed`
            is negative.
    """
    if episodes < 1:
        raise ConfigError(f"episodes is {episodes}; expected at least 1")
    if seed < 0:
        raise ConfigError(f"seed is {seed}; expected a non-negative number")
    policy = Policy.load(run, encoder=encoder, checkpoint=checkpoint)
    robots = policy.prepare(descriptions, task=task, base=base)
    with single_thread():
        return [_evaluate_one(policy, robot, episodes, seed) for robot in robots]


def record(
    run: str | Path,
    description: Description,
    *,
    seed: int = 0,
    max_steps: int = 500,
    task: str | Task | None = None,
    base: Base | None = None,
    encoder: str | None = None,
    checkpoint: str = LATEST,
) -> tuple[Simulation, np.ndarray, float]:
    """Play one noise-free episode for a video; task, base, encoder and checkpoint as in `evaluate`.

    Returns:
        The simulation, qpos (steps + 1, nq) of the episode, and its steps a second.
    """
    policy = Policy.load(run, encoder=encoder, checkpoint=checkpoint)
    (robot,) = policy.prepare([description], task=task, base=base, drawn=True)
    env = _single(policy, robot, 1, seed)
    obs = env.reset()[0]
    poses = [env.state(0)[0][0].copy()]
    for _ in range(max_steps):
        with single_thread():
            step = env.step([policy.act(robot.spec, obs)])
        if step.terminated[0][0] or step.truncated[0][0]:
            break
        poses.append(env.state(0)[0][0].copy())
        obs = step.obs[0]
    env.close()
    rate = 1 / (robot.simulation.model.opt.timestep * robot.task.frame_skip)
    return robot.simulation, np.stack(poses), float(rate)


@contextmanager
def single_thread() -> Iterator[None]:
    """Run torch on one thread: for a handful of rows, waiting for a second one costs more than it gives."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def _evaluate_one(policy: Policy, robot: Robot, episodes: int, seed: int) -> RobotResult:
    env = _single(policy, robot, episodes, seed)
    (returns,), (lengths,), (diverged,) = play(env, lambda obs: [policy.act(robot.spec, obs[0])])
    env.seed(seed)
    (random_returns,), _, (random_diverged,) = play(env, random_controller(env, seed))
    env.close()
    return RobotResult(
        robot=robot.name,
        trained_on=robot.name in policy.trained_on,
        returns=tuple(returns.tolist()),
        random_returns=tuple(random_returns.tolist()),
        lengths=tuple(lengths.tolist()),
        expert_return=robot.simulation.description.info.expert_return,
        diverged=diverged,
        random_diverged=random_diverged,
        mirrored=policy.reads(robot.spec) is not robot.spec,
        rests=policy.rests(robot.spec),
    )


def _single(policy: Policy, robot: Robot, num_envs: int, seed: int) -> BatchEnv:
    observation = policy.config.trainer.observation
    return BatchEnv([robot.simulation], [robot.task], num_envs, specs=[robot.spec], observation=observation, seed=seed)
