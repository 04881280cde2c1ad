"""In which order collecting and learning follow each other, in pieces between which a run can stop and go on."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from torch import Tensor

from morphkit.errors import ConfigError
from morphkit_rl.algorithms.agent import Agent
from morphkit_rl.buffers.replay_buffer import Batch, ReplayBuffer, sample
from morphkit_rl.config.train_config import TrainConfig
from morphkit_rl.training.collector import Collector


class Schedule(Protocol):
    """An order of collecting and learning."""

    def begin(self) -> None:
        """Start the first episodes of a new run."""

    def advance(self) -> dict[str, Tensor]:
        """Do the next piece of work; the losses of its last update, if there was any."""

    def state(self) -> dict[str, Any]:
        """What it remembers between two pieces, as JSON can hold it."""

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take over what `state` gave."""


class Sweeps:
    """A piece is a sweep: one step of every environment, then some updates that mix all robots.

    Episodes of robots that never fall would all end in the same sweep, so the first ones start at random elapsed step
    counts, spread over the episode length. They are reported as such, since they are shorter.

    Args:
        config: All settings.
        agent: What acts and learns.
        collector: The environments.
        rng: Source of exploration, replay samples and target noise.
        seed: Seed of the elapsed step counts.
    """

    def __init__(self, config: TrainConfig, agent: Agent, collector: Collector, rng: np.random.Generator, seed: int):
        self.config, self.agent, self.collector, self.rng = config, agent, collector, rng
        self._first = np.ones((len(collector.robots), collector.num_envs), bool)
        self._elapsed = _elapsed(collector, seed)

    def begin(self) -> None:
        """Start the first episodes at random elapsed step counts."""
        self.collector.reset(self._elapsed)

    def advance(self) -> dict[str, Tensor]:
        """Step every environment once, then learn."""
        self.agent.refresh()
        warm_up = _warm_up(self.config, self.collector)
        action = _explore(self.config, self.agent, self.collector, self.rng)
        step = self.collector.advance(action)
        self.agent.observe(self.collector.obs)
        self.agent.observe_rewards(step.reward, np.stack(step.terminated) | np.stack(step.truncated))
        self.collector.store(action, step)
        self.collector.steps += self._first.size
        for episode in step.episodes:
            place = episode.robot, episode.env
            if self._first[place]:
                self.collector.report_first(episode, int(self._elapsed[place]))
            else:
                self.collector.report(episode)
            self._first[place] = False
        losses: dict[str, Tensor] = {}
        if not warm_up:
            for batch in batches(self.config, self.collector.buffers, self.rng, self.agent.discount):
                losses.update(self.agent.update(batch, self.rng))
        return losses

    def state(self) -> dict[str, Any]:
        """Which environments are in their first episode."""
        return {"first": self._first.tolist()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take over what `state` gave."""
        self._first = _like(self._first, state["first"])


class Rounds:
    """The order of the published code (Huang et al. 2020, One Policy to Control Them All, and its successors).

    A round: all robots step until each has ended an episode; those that have go on with a next one, which is stored but
    neither counted nor reported. Then, robot by robot, updates from its own replay: in all as many as steps were
    counted, and the same number for every robot, however long its episode was; the first ones take what is left over.
    A piece is one step of every environment, or one update.

    Args:
        config: All settings.
        agent: What acts and learns.
        collector: The environments.
        rng: Source of exploration, replay samples and target noise.

    Attributes:
        updates_due: Updates that each robot was to do when learning began in the latest round.
        updates_left: Updates that each robot still has to do in this round; all 0 while collecting.
    """

    def __init__(self, config: TrainConfig, agent: Agent, collector: Collector, rng: np.random.Generator):
        self.config, self.agent, self.collector, self.rng = config, agent, collector, rng
        shape = (len(collector.robots), collector.num_envs)
        self._over, self._counted = np.zeros(shape, bool), np.zeros(len(collector.robots), np.int64)
        self.updates_due, self.updates_left = self._counted.copy(), self._counted.copy()

    def begin(self) -> None:
        """Start the first round."""
        self.collector.reset()

    def advance(self) -> dict[str, Tensor]:
        """Step every environment once, or do one update."""
        waiting = np.flatnonzero(self.updates_left)
        if not len(waiting):
            self._collect()
            return {}
        robot, td3 = int(waiting[0]), self.config.td3
        batch = sample([self.collector.buffers[robot]], td3.batch_size, td3.n_step, self.agent.discount, self.rng)
        number = int(self.updates_due[robot] - self.updates_left[robot])
        self.updates_left[robot] -= 1
        return self.agent.update(batch, self.rng, self.agent.each[robot], number)

    def state(self) -> dict[str, Any]:
        """How far the round is."""
        return {
            "over": self._over.tolist(),
            "counted": self._counted.tolist(),
            "updates_due": self.updates_due.tolist(),
            "updates_left": self.updates_left.tolist(),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take over what `state` gave."""
        self._over, self._counted = _like(self._over, state["over"]), _like(self._counted, state["counted"])
        self.updates_due, self.updates_left = (
            _like(self._counted, state[name]) for name in ("updates_due", "updates_left")
        )

    def _collect(self) -> None:
        self.agent.refresh()
        action = _explore(self.config, self.agent, self.collector, self.rng)
        step = self.collector.advance(action)
        self.agent.observe(self.collector.obs)
        counted = (~self._over).sum(1)
        self._counted += counted
        self.collector.steps += int(counted.sum())
        for episode in step.episodes:
            if not self._over[episode.robot, episode.env]:
                self.collector.report(episode)
            self._over[episode.robot, episode.env] = True
        whole = bool(self._over.all())
        self.agent.observe_rewards(step.reward, np.stack(step.terminated) | np.stack(step.truncated) | whole)
        self.collector.store(action, step, cut=whole)
        if whole:
            self.agent.refresh()
            each, left_over = divmod(int(self._counted.sum()), len(self._counted))
            self.updates_due = each + (np.arange(len(self._counted)) < left_over).astype(np.int64)
            self.updates_left = self.updates_due.copy()
            self._counted = np.zeros_like(self._counted)
            self._over[:] = False


def _elapsed(collector: Collector, seed: int) -> np.ndarray:
    """Step counts that first episodes begin with, int64 (robots, environments), spread over the episode length."""
    rng = np.random.default_rng([seed, 2])
    order = np.stack([rng.permutation(collector.num_envs) for _ in collector.robots])
    shares = (order + rng.random(order.shape)) / collector.num_envs
    lengths = np.array([robot.task.episode_length for robot in collector.robots])
    return (shares * lengths[:, None]).astype(np.int64)


def batches(
    config: TrainConfig, buffers: Sequence[ReplayBuffer], rng: np.random.Generator, discount: float
) -> Iterator[Batch]:
    """Draw the batches of a sweep's updates.

    Args:
        config: All settings.
        buffers: Replay of each robot.
        rng: Source of the draws.
        discount: Discount of one step.
    """
    td3, updates = config.td3, config.trainer.updates_per_sweep
    share = -(-td3.batch_size // len(buffers))
    if config.learner.sample_ahead:
        yield from sample(buffers, share * updates, td3.n_step, discount, rng).split(updates)
        return
    for _ in range(updates):
        yield sample(buffers, share, td3.n_step, discount, rng)


def make_schedule(
    config: TrainConfig, agent: Agent, collector: Collector, rng: np.random.Generator, seed: int
) -> Schedule:
    """The schedule that `config` names."""
    if config.trainer.schedule == "rounds":
        return Rounds(config, agent, collector, rng)
    return Sweeps(config, agent, collector, rng, seed)


def _like(own: np.ndarray, values: Any) -> np.ndarray:
    """Saved values as an array like `own`.

    Raises:
        ConfigError: They are of other robots or numbers of environments.
    """
    array = np.array(values, own.dtype)
    if array.shape != own.shape:
        raise ConfigError(f"the schedule's state has shape {array.shape}, expected {own.shape}")
    return array


def _warm_up(config: TrainConfig, collector: Collector) -> bool:
    """Whether actions are still random."""
    trainer = config.trainer
    return collector.steps < max(trainer.start_steps, trainer.start_steps_per_robot * len(collector.robots))


def _explore(config: TrainConfig, agent: Agent, collector: Collector, rng: np.random.Generator) -> np.ndarray:
    """Actions of all robots: random ones, or the policy's with noise on every column.

    Where training goes on from a policy, that acts from the first step.
    """
    shape = (collector.num_envs, collector.layout.num_actions)
    if agent.start is None and _warm_up(config, collector):
        return rng.uniform(-1, 1, shape).astype(np.float32)
    noise = rng.standard_normal(shape, dtype=np.float32) * _noise_levels(config)
    return (agent.explore(collector.obs) + noise).clip(-1, 1)


def _noise_levels(config: TrainConfig) -> np.ndarray | float:
    """Standard deviation of the exploration noise, or (environments, 1) one an environment, from least to most."""
    middle, spread = config.td3.exploration_noise, config.learner.noise_spread
    if spread == 0:
        return middle
    levels = np.linspace(middle - spread, middle + spread, config.trainer.num_envs, dtype=np.float32)
    return levels.clip(min=0)[:, None]
