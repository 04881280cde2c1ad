"""Training: one policy for many robots, until a budget is used."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from morphkit.description import Description
from morphkit.errors import TrainingError
from morphkit.morphology import Base
from morphkit.utils.interrupts import Interrupts
from morphkit_rl.config.train_config import TrainConfig
from morphkit_rl.envs.tasks import Task
from morphkit_rl.runs import checkpoint, run_folder, run_settings, saved_policy
from morphkit_rl.runs.lock import alone
from morphkit_rl.runs.metrics_log import MetricsLog
from morphkit_rl.runs.saved_task import chosen_task, run_terms
from morphkit_rl.runs.trusted_encoder import with_encoder
from morphkit_rl.training.mended import said_once
from morphkit_rl.training.metrics_row import metrics_row
from morphkit_rl.training.progress import Clock, Mark, Progress, TrainSummary, hundredth
from morphkit_rl.training.session import Session, check_sizes

DEFAULT_MINUTES = 10.0
REPORT_SECONDS = 1.0


def train(
    descriptions: Sequence[Description],
    run: str | Path,
    config: TrainConfig,
    *,
    hold_out: Sequence[str] = (),
    validation: Sequence[str] = (),
    task: str | Task | None = None,
    base: Base | None = None,
    seed: int = 0,
    minutes: float | None = None,
    steps: int | None = None,
    device: str = "cpu",
    strict: bool = False,
    start: str | Path | None = None,
    progress: Callable[[Progress], None] | None = None,
    notice: Callable[[str], None] | None = None,
) -> TrainSummary:
    """Train one policy on several robots.

    Args:
        descriptions: The robots.
        run: Folder of the run; it must not exist or be empty.
        config: All settings.
        hold_out: Names among `descriptions` that are kept away from the run altogether.
        validation: Names among `descriptions` that are not trained on, but evaluated as the training robots are.
        task: The task, its name or its TOML file; default: each robot's own.
        base: How roots are attached to the world; default: each robot's own.
        seed: Seed of networks, environments, noise and replay.
        minutes: Training time, over all resumptions; default 10 where neither `minutes` nor `steps` is given.
        steps: Environment steps over all robots.
        device: Torch device of the learner.
        strict: Whether robots are refused of which something has to be mended.
        start: Policy to go on from, as `Policy.load` takes it, with the `config` of `fine_tuning.start_config`.
        progress: Called about once a second.
        notice: Called before training with a sentence for each thing that was mended; the run keeps them too.

    Raises:
        ConfigError: A robot has no actuators or is one that the method cannot express, two have the same name, the
            budget makes no sense, `start` is of other settings, or something has to be mended and `strict` is True.
        UnknownNameError: A name in `hold_out` or `validation` is none of the robots.
        OutputError: The run folder cannot be written or holds files.
        TrainingError: Losses or actions are no longer finite, or the simulation of a robot diverged in every episode.
    """
    run = Path(run)
    trained, validated = run_settings.split(descriptions, hold_out, validation)
    settings = run_settings.RunSettings(
        robots=tuple(trained),
        validation=tuple(validated),
        hold_out=tuple(hold_out),
        config=config.for_robots(max(len(trained), 1)),
        task=chosen_task(task),
        base=base,
        seed=seed,
        minutes=DEFAULT_MINUTES if minutes is None and steps is None else minutes,
        steps=steps,
        device=device,
        threads=torch.get_num_threads(),
        start=None if start is None else saved_policy.load(start),
    )
    trainer = Trainer(settings, strict=strict)
    run_settings.create(run, settings, trainer.session.mended)
    if notice is not None:
        list(map(notice, said_once(trainer.session.mended)))
    with alone(run):
        return trainer.run(run, progress)


def resume(
    run: str | Path,
    *,
    minutes: float | None = None,
    steps: int | None = None,
    encoder: str | None = None,
    task: Path | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> TrainSummary:
    """Continue a run from its latest checkpoint, exactly as if it had never stopped.

    Args:
        run: The run folder.
        minutes: New budget of training time in all; default: the run's own.
        steps: New budget of environment steps in all; default: the run's own.
        encoder: Text encoder in place of the run's own; see `Policy.load`.
        task: The TOML file of the run's task, where Python files with its terms are to be run.
        progress: Called about once a second.

    Raises:
        CheckpointError: The folder is no run, or its checkpoint is damaged or was deleted.
        ConfigError: The run's text encoder does not ship with morphkit, and nobody said that it may be used.
        OutputError: Another process trains there, or the folder cannot be written.
        TrainingError: As `train`.
    """
    run = Path(run)
    if task is not None:
        run_terms(task, run_settings.read(run))
    settings = run_settings.load(run)
    checkpoint.require_folder(run)
    trusted = with_encoder(settings.config, run, encoder)
    with alone(run):
        run_folder.clear_temporaries(run)
        if minutes is not None or steps is not None:
            settings = run_settings.with_budget(run, settings, minutes, steps)
        torch.set_num_threads(settings.threads)
        if checkpoint.has_checkpoint(run):
            check_sizes(run, settings.config)
        with run_settings.buildable(run):
            trainer = Trainer(replace(settings, config=trusted))
        if checkpoint.has_checkpoint(run):
            trainer.clock.elapsed_s = trainer.session.restore(run)
            trainer.session.clear_older(run)
        return trainer.run(run, progress)


class Trainer:
    """Advances a session until its budget is used or Ctrl-C, and writes metrics and checkpoints meanwhile."""

    def __init__(self, settings: run_settings.RunSettings, *, strict: bool = False):
        self.settings = settings
        self.session = Session(settings, strict=strict)
        self.clock = Clock()
        self._losses: dict[str, torch.Tensor] = {}

    def run(self, run: Path, progress: Callable[[Progress], None] | None = None) -> TrainSummary:
        """Train and end with a checkpoint; where the budget is used up already, change nothing."""
        with closing(self.session) as session:
            advanced = self._fraction() < 1 or session.monitor.due(session.collector.steps)
            if advanced:
                service = self.settings.config.trainer.track
                log = MetricsLog(run, session.collector.steps, session.agent.learner.updates, service)
                with closing(log):
                    self._run(run, log, progress)
        now, collector = self._progress(self._mark()), session.collector
        if now.fraction >= 1:
            collector.refuse_diverged(run)
        return TrainSummary(
            run=run,
            steps=now.steps,
            real_steps=collector.real_steps,
            updates=now.updates,
            elapsed_s=now.elapsed_s,
            returns=now.returns,
            first_returns=now.first_returns,
            diverged=int(collector.env.diverged.sum()),
            interrupted=now.fraction < 1,
            advanced=advanced,
        )

    def _run(self, run: Path, log: MetricsLog, progress: Callable[[Progress], None] | None) -> None:
        session, clock, config = self.session, self.clock, self.settings.config.trainer
        reported = logged = saved = clock.elapsed_s
        mark, row_of = self._mark(), self._hundredth()
        clock.start()
        with Interrupts() as interrupts:
            while not interrupts.wanted:
                if session.monitor.due(session.collector.steps):
                    evaluation = self._evaluate(interrupts)
                    if evaluation is None:
                        break
                    log.write({**self._metrics(mark), "evaluation": evaluation})
                    logged, mark = clock.elapsed_s, self._mark()
                    if config.keep == "best" and session.monitor.improved:
                        saved = clock.elapsed_s
                        self._save(run, best=True)
                if self._fraction() >= 1:
                    break
                session.agent.learner.set_rates(self._fraction())
                self._losses.update(session.schedule.advance())
                elapsed_s = clock.elapsed_s
                if progress and elapsed_s - reported >= REPORT_SECONDS:
                    reported = elapsed_s
                    progress(self._progress(mark))
                wanted = elapsed_s - logged >= config.log_seconds or self._hundredth() > row_of
                if wanted and not session.monitor.due(session.collector.steps):
                    logged = elapsed_s
                    log.write(self._metrics(mark))
                    mark, row_of = self._mark(), self._hundredth()
                if elapsed_s - saved >= config.checkpoint_seconds:
                    saved = elapsed_s
                    self._save(run)
            clock.stop()
            self._check()
            log.write(self._metrics(mark))  # first: a run whose checkpoint says that it is over is not gone on with
            self._save(run)
        log.finish(session.collector.returns(), session.collector.steps)

    def _evaluate(self, interrupts: Interrupts) -> dict[str, dict[str, Any]] | None:
        """Evaluate without using up training time; None where Ctrl-C cut it short."""
        try:
            with self.clock.paused(), interrupts.immediate():
                return self.session.monitor.evaluate(self.session.collector.steps)
        except KeyboardInterrupt:
            return None

    def _save(self, run: Path, *, best: bool = False) -> None:
        self._check()
        elapsed_s = self.clock.elapsed_s
        self.session.save(run, elapsed_s, best=best)
        self.clock.elapsed_s = elapsed_s

    def _check(self) -> None:
        spoiled = [f"{name} is {float(value)}" for name, value in self._losses.items() if not math.isfinite(value)]
        for name, network in self.session.agent.learner.networks().items():
            if not all(bool(weights.isfinite().all()) for weights in network.parameters()):
                spoiled.append(f"weights of {name} are not finite")
        if spoiled:
            raise TrainingError(
                f"training diverged: {spoiled[0]} after {self.session.collector.steps} steps; try a smaller "
                "td3.learning_rate. The last checkpoint is from before"
            )

    def _fraction(self) -> float:
        """Share of the budget that is used, 1 where it is used up."""
        shares = [0.0]
        if self.settings.steps is not None:
            shares.append(self.session.collector.steps / max(self.settings.steps, 1))
        if self.settings.minutes is not None:
            shares.append(self.clock.elapsed_s / max(60 * self.settings.minutes, 1e-9))
        return min(max(shares), 1.0)

    def _hundredth(self) -> int:
        """Which hundredth of the budget of steps the run is in."""
        return hundredth(self.session.collector.steps, self.settings.steps)

    def _mark(self) -> Mark:
        return Mark(self.clock.elapsed_s, self.session.collector.steps, self.session.agent.learner.updates)

    def _progress(self, mark: Mark) -> Progress:
        """How far the run is; rates are those since `mark`."""
        now, fraction = self._mark(), self._fraction()
        seconds = max(now.elapsed_s - mark.elapsed_s, 1e-9)
        return Progress(
            steps=now.steps,
            updates=now.updates,
            elapsed_s=now.elapsed_s,
            remaining_s=now.elapsed_s * (1 - fraction) / fraction if fraction > 0 else None,
            fraction=fraction,
            steps_per_s=(now.steps - mark.steps) / seconds,
            updates_per_s=(now.updates - mark.updates) / seconds,
            returns=self.session.collector.returns(),
            first_returns=self.session.collector.first_returns(),
        )

    def _metrics(self, mark: Mark) -> dict[str, Any]:
        """One row of metrics."""
        return metrics_row(self._progress(mark), self.session.collector, self._losses)
