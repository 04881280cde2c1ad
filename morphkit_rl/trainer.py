"""Training: one policy, all robots in every update."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from morphkit.description import Description
from morphkit.errors import CheckpointError, ConfigError
from morphkit.morphology import Base
from morphkit_rl import checkpoint, runs
from morphkit_rl.actions import ActionScale
from morphkit_rl.config import TrainConfig
from morphkit_rl.envs.batch import BatchEnv
from morphkit_rl.metrics import MetricsLog
from morphkit_rl.models.layout import build_layout
from morphkit_rl.normalizer import Normalizer
from morphkit_rl.replay import Ring, sample
from morphkit_rl.robots import prepare
from morphkit_rl.td3 import TD3, resolve_precision
from morphkit_rl.text.embedder import TokenEmbedder

RECENT_EPISODES = 8
DEFAULT_MINUTES = 10.0


@dataclass(frozen=True, slots=True)
class Progress:
    """Where a run stands.

    Attributes:
        steps: Environment steps over all robots.
        updates: Critic updates.
        elapsed_s: Training time, s, over all resumptions.
        remaining_s: Estimated time left, s; None before there is an estimate.
        fraction: Share of the budget that is used, 0 to 1.
        steps_per_s: Environment steps a second of late.
        updates_per_s: Updates a second of late.
        returns: Mean return of each robot's latest episodes, with exploration noise.
    """

    steps: int
    updates: int
    elapsed_s: float
    remaining_s: float | None
    fraction: float
    steps_per_s: float
    updates_per_s: float
    returns: dict[str, float]


@dataclass(frozen=True, slots=True)
class TrainSummary:
    """How a run ended; `interrupted` where Ctrl-C ended it before its budget."""

    run: Path
    steps: int
    updates: int
    elapsed_s: float
    returns: dict[str, float]
    interrupted: bool


def train(
    descriptions: Sequence[Description],
    run: Path,
    config: TrainConfig,
    *,
    hold_out: Sequence[str] = (),
    task: str | None = None,
    base: Base | None = None,
    seed: int = 0,
    minutes: float | None = None,
    steps: int | None = None,
    device: str = "cpu",
    progress: Callable[[Progress], None] | None = None,
) -> TrainSummary:
    """Train one policy on several robots.

    Args:
        descriptions: The robots.
        run: Folder of the run; it must not exist or be empty.
        config: All settings.
        hold_out: Names among `descriptions` that training must not see.
        task: Name of the task; default: each robot's own.
        base: How roots are attached to the world; default: each robot's own.
        seed: Seed of networks, environments, noise and replay.
        minutes: Training time, over all resumptions; default 10 where neither `minutes` nor `steps` is given.
        steps: Environment steps over all robots.
        device: Torch device of the learner.
        progress: Called about once a second.

    Raises:
        ConfigError: A robot has no actuators, two have the same name, or the budget makes no sense.
        UnknownNameError: A name in `hold_out` is none of the robots.
        OutputError: The run folder cannot be written or holds files.
    """
    kept = runs.without(descriptions, hold_out)
    settings = runs.RunSettings(
        robots=tuple(kept),
        hold_out=tuple(hold_out),
        config=config,
        task=task,
        base=base,
        seed=seed,
        minutes=DEFAULT_MINUTES if minutes is None and steps is None else minutes,
        steps=steps,
        device=device,
        threads=torch.get_num_threads(),
    )
    trainer = Trainer(settings)
    runs.create(run, settings)
    return trainer.run(run, progress)


def resume(
    run: Path,
    *,
    minutes: float | None = None,
    steps: int | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> TrainSummary:
    """Continue a run from its latest checkpoint, exactly as if it had never stopped.

    Args:
        run: The run folder.
        minutes: New budget of training time in all; default: the run's own.
        steps: New budget of environment steps in all; default: the run's own.
        progress: Called about once a second.

    Raises:
        CheckpointError: There is no checkpoint, or it is damaged.
    """
    settings = runs.load(run)
    if minutes is not None or steps is not None:
        settings = runs.with_budget(run, settings, minutes, steps)
    torch.set_num_threads(settings.threads)
    trainer = Trainer(settings)
    if checkpoint.has_checkpoint(run):
        trainer.restore(run)
    return trainer.run(run, progress)


class Trainer:
    """Collects with all robots, learns from all robots, and can stop and go on anywhere between two sweeps.

    A sweep is one step of every environment and the updates that follow it.
    """

    def __init__(self, settings: runs.RunSettings):
        config = settings.config
        self.settings, self.config = settings, config
        self.robots = [prepare(d, config.text.naming, task=settings.task, base=settings.base) for d in settings.robots]
        for robot in self.robots:
            if not robot.spec.actuators:
                raise ConfigError(
                    f"{robot.name}: has no actuators, so there is nothing to learn; add motors or leave it out"
                )
        torch.manual_seed(settings.seed)
        self.rng = np.random.default_rng([settings.seed, 1])
        self.env = BatchEnv(
            [robot.simulation for robot in self.robots],
            [robot.task for robot in self.robots],
            config.trainer.num_envs,
            observation=config.trainer.observation,
            seed=settings.seed,
        )
        specs = [robot.spec for robot in self.robots]
        texts = [text for spec in specs for text in spec.texts]
        self.embedder = TokenEmbedder.fit(runs.make_encoder(config), texts)
        self.layout = build_layout(specs, self.embedder, settings.device)
        self.learner = TD3(
            config.model,
            config.td3,
            self.embedder.size,
            device=settings.device,
            precision=resolve_precision(config.trainer.precision, settings.device),
        )
        self.normalizer = Normalizer()
        self.quantities = self.normalizer.index(specs, grow=True)
        self.scales = [ActionScale(spec) for spec in specs]
        capacity = config.trainer.replay_capacity // len(specs)
        self.rings = [Ring(len(spec.sensors), len(spec.actuators), config.trainer.num_envs, capacity) for spec in specs]
        self.steps, self.elapsed_s, self.episodes = 0, 0.0, 0
        self.recent: list[deque[float]] = [deque(maxlen=RECENT_EPISODES) for _ in specs]
        self.obs = np.concatenate(self.env.reset(), axis=1)

    def run(self, run: Path, progress: Callable[[Progress], None] | None = None) -> TrainSummary:
        """Train until the budget is used or Ctrl-C; ends with a checkpoint."""
        log = MetricsLog(run, self.steps)
        began = time.perf_counter() - self.elapsed_s
        logged = reported = saved = self.elapsed_s
        mark = (self.elapsed_s, self.steps, self.learner.updates)
        interrupted = False
        try:
            while self.fraction() < 1:
                losses = self.sweep()
                self.elapsed_s = time.perf_counter() - began
                if progress and self.elapsed_s - reported >= 1:
                    reported = self.elapsed_s
                    progress(self.progress(mark))
                if self.elapsed_s - logged >= self.config.trainer.log_seconds:
                    logged = self.elapsed_s
                    log.write(self.metrics(mark, losses))
                    mark = (self.elapsed_s, self.steps, self.learner.updates)
                if self.elapsed_s - saved >= self.config.trainer.checkpoint_seconds:
                    self.save(run)
                    began, saved = time.perf_counter() - self.elapsed_s, self.elapsed_s
        except KeyboardInterrupt:
            interrupted = True
        self.save(run)
        log.write(self.metrics(mark, {}))
        log.close()
        self.env.close()
        return TrainSummary(run, self.steps, self.learner.updates, self.elapsed_s, self.returns(), interrupted)

    def sweep(self) -> dict[str, torch.Tensor]:
        """Step every environment once, then learn; returns the losses of the last update."""
        scale, shift = (
            torch.from_numpy(a).to(self.learner.device) for a in self.normalizer.scale_and_shift(self.quantities)
        )
        shape = (len(self.obs), self.layout.num_actions)
        warm_up = self.steps < self.config.trainer.start_steps
        if warm_up:
            action = self.rng.uniform(-1, 1, shape).astype(np.float32)
        else:
            noise = self.rng.standard_normal(shape, dtype=np.float32) * self.config.td3.exploration_noise
            action = (self.learner.act(self.obs, scale, shift, self.layout) + noise).clip(-1, 1)
        parts = [action[:, columns] for columns in self.layout.actions]
        step = self.env.step([s.to_controls(part) for s, part in zip(self.scales, parts, strict=True)])
        for robot, ring in enumerate(self.rings):
            terminated = step.terminated[robot]
            ring.add(
                obs=self.obs[:, self.layout.tokens[robot]],
                action=parts[robot],
                reward=step.reward[robot],
                next_obs=step.final_obs[robot],
                terminated=terminated,
                ended=terminated | step.truncated[robot],
            )
        for robot, _, total, _ in step.episodes:
            self.recent[robot].append(float(total))
            self.episodes += 1
        self.normalizer.update(self.obs, self.quantities)
        self.obs = np.concatenate(step.obs, axis=1)
        self.steps += len(self.obs) * len(self.robots)
        losses: dict[str, torch.Tensor] = {}
        if not warm_up:
            share = -(-self.config.td3.batch_size // len(self.robots))
            for _ in range(self.config.trainer.updates_per_sweep):
                batch = sample(self.rings, share, self.config.td3.n_step, self.config.td3.discount, self.rng)
                losses.update(self.learner.update(batch, scale, shift, self.layout, self.rng))
        return losses

    def fraction(self) -> float:
        """Share of the budget that is used, 1 where it is used up."""
        shares = [0.0]
        if self.settings.steps is not None:
            shares.append(self.steps / max(self.settings.steps, 1))
        if self.settings.minutes is not None:
            shares.append(self.elapsed_s / max(60 * self.settings.minutes, 1e-9))
        return min(max(shares), 1.0)

    def returns(self) -> dict[str, float]:
        """Mean return of each robot's latest episodes, with exploration noise; robots without one are left out."""
        pairs = zip(self.robots, self.recent, strict=True)
        return {robot.name: float(np.mean(recent)) for robot, recent in pairs if recent}

    def progress(self, mark: tuple[float, int, int]) -> Progress:
        """Where the run stands; rates are those since `mark` (elapsed_s, steps, updates)."""
        elapsed, steps, updates = mark
        seconds = max(self.elapsed_s - elapsed, 1e-9)
        fraction = self.fraction()
        remaining = self.elapsed_s * (1 - fraction) / fraction if fraction > 0 else None
        return Progress(
            steps=self.steps,
            updates=self.learner.updates,
            elapsed_s=self.elapsed_s,
            remaining_s=remaining,
            fraction=fraction,
            steps_per_s=(self.steps - steps) / seconds,
            updates_per_s=(self.learner.updates - updates) / seconds,
            returns=self.returns(),
        )

    def metrics(self, mark: tuple[float, int, int], losses: dict[str, torch.Tensor]) -> dict[str, Any]:
        """One row of metrics."""
        now = self.progress(mark)
        returns = now.returns
        return {
            "steps": now.steps,
            "updates": now.updates,
            "elapsed_s": round(now.elapsed_s, 3),
            "steps_per_s": round(now.steps_per_s, 1),
            "updates_per_s": round(now.updates_per_s, 2),
            "episodes": self.episodes,
            "diverged": int(self.env.diverged.sum()),
            "return_mean": float(np.mean(list(returns.values()))) if len(returns) == len(self.robots) else None,
            "returns": returns,
            **{name: float(value) for name, value in losses.items()},
        }

    def save(self, run: Path) -> None:
        """Write a checkpoint from which `restore` continues exactly."""
        policy = {
            **checkpoint.module_arrays({"actor": self.learner.actor}),
            **{f"normalizer/{key}": array for key, array in self.normalizer.state_dict().items()},
            "embedding/mean": self.embedder.mean,
            "embedding/std": self.embedder.std,
        }
        networks = {name: net for name, net in self.learner.networks().items() if name != "actor"}
        tensors = {
            "policy": policy,
            "learner": checkpoint.module_arrays(networks),
            "optimizer": checkpoint.optimizer_arrays(self.learner.optimizers()),
            "environments": {**self.env.state_dict(), "trainer/obs": self.obs},
        }
        state = {
            "steps": self.steps,
            "updates": self.learner.updates,
            "elapsed_s": self.elapsed_s,
            "episodes": self.episodes,
            "recent": [list(recent) for recent in self.recent],
            "quantities": self.normalizer.keys,
            "rng": self.rng.bit_generator.state,
            "sweeps": self.rings[0].added,
            "precision": self.learner.precision,
            "token_texts": runs.texts_digest(self.layout.specs),
        }
        checkpoint.save(run, tensors, state, self.rings)

    def restore(self, run: Path) -> None:
        """Take over the latest checkpoint of `run`.

        Raises:
            CheckpointError: It is damaged, or belongs to other robots, another method or another size.
        """
        folder, state = checkpoint.load_state(run)
        if state["token_texts"] != runs.texts_digest(self.layout.specs):
            raise CheckpointError(f"{folder}: made for robots with other tokens than those in {run / 'config.json'}")
        policy = checkpoint.load_arrays(folder / "policy.safetensors")
        rest = checkpoint.load_arrays(folder / "learner.safetensors")
        checkpoint.load_modules(self.learner.networks(), {**policy, **rest}, folder)
        checkpoint.load_optimizers(self.learner.optimizers(), checkpoint.load_arrays(folder / "optimizer.safetensors"))
        statistics = {key: policy[f"normalizer/{key}"] for key in ("count", "mean", "m2")}
        self.normalizer.load_state_dict(statistics, state["quantities"])
        self.embedder.mean, self.embedder.std = policy["embedding/mean"], policy["embedding/std"]
        environments = checkpoint.load_arrays(folder / "environments.safetensors")
        self.obs = environments.pop("trainer/obs")
        self.env.load_state_dict(environments)
        checkpoint.load_replay(run, state["segments"], self.rings, state["sweeps"])
        self.rng.bit_generator.state = state["rng"]
        self.steps, self.elapsed_s, self.episodes = state["steps"], state["elapsed_s"], state["episodes"]
        self.learner.updates = state["updates"]
        self.learner.precision = state["precision"]
        for recent, values in zip(self.recent, state["recent"], strict=True):
            recent.extend(values)
