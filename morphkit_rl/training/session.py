"""Everything of a training run that a checkpoint holds, put together from the run's settings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from morphkit.errors import CheckpointError, ConfigError, MorphkitError
from morphkit_rl.algorithms.agent import Agent
from morphkit_rl.algorithms.fine_tuning import load_start
from morphkit_rl.config.train_config import TrainConfig
from morphkit_rl.kernels import library
from morphkit_rl.models.vocabulary import Vocabulary
from morphkit_rl.runs import checkpoint, network_arrays, replay_segments, run_settings, trackers
from morphkit_rl.training.collector import Collector, make_buffers
from morphkit_rl.training.mended import mended
from morphkit_rl.training.periodic_evaluation import Monitor
from morphkit_rl.training.schedules import make_schedule


class Session:
    """Agent, environments with their replay, schedule, evaluation and random generator of a run.

    Between two calls of `schedule.advance` it can be saved, and a session that restores the checkpoint goes on exactly
    as this one.

    Args:
        settings: The run.
        strict: Whether robots are refused of which something has to be mended.

    Attributes:
        mended: What was mended of each robot, by its name; nothing of robots that are sound.

    Raises:
        ConfigError: A robot has no actuators, the method cannot express it, its replay does not fit into memory, there
            is no such device, or something has to be mended and `strict` is True.
    """

    def __init__(self, settings: run_settings.RunSettings, *, strict: bool = False):
        config = settings.config
        self.settings = settings
        robots, validation = (
            [run_settings.prepare_robot(config, d, task=settings.task, base=settings.base, critics=c) for d in group]
            for group, c in ((settings.robots, True), (settings.validation, False))
        )
        for robot in (*robots, *validation):
            if not robot.spec.actuators:
                raise ConfigError(
                    f"{robot.name}: has no actuators, so there is nothing to learn; add motors or leave it out"
                )
        check_device(settings.device)
        trackers.require(config.trainer.track)
        self.mended = mended((*robots, *validation), strict=strict)
        # Before texts are encoded, which takes long for so large bodies.
        make_buffers([(len(robot.seen.sensors), len(robot.spec.actuators)) for robot in robots], config.trainer)
        library.prepare()  # Actions are random at first, so that nobody waits.
        torch.manual_seed(settings.seed)
        self.rng = np.random.default_rng([settings.seed, 1])
        start = None if settings.start is None else load_start(settings.start, config)
        seen = [robot.seen for robot in robots] if config.critics_see_more else None
        self.agent = Agent(config, [robot.spec for robot in robots], settings.device, start, seen)
        self.collector = Collector(robots, self.agent.robots.layout.stored, config.trainer, settings.seed)
        self.schedule = make_schedule(config, self.agent, self.collector, self.rng, settings.seed)
        self.monitor = Monitor(
            self.agent, [*robots, *validation], config.trainer, settings.seed, validation=len(validation)
        )
        self.schedule.begin()

    def save(self, run: Path, elapsed_s: float, *, best: bool = False) -> None:
        """Write a checkpoint from which `restore` continues exactly.

        Args:
            run: The run folder.
            elapsed_s: Training time so far.
            best: Whether it is the best so far.

        Raises:
            OutputError: The disk is full or the folder cannot be written; the previous checkpoint stays.
        """
        buffers, number = self.collector.buffers, self._number_kept
        with checkpoint.writing(run, number):
            state = {
                "elapsed_s": elapsed_s,
                "sweeps": buffers[0].added,
                "segments": replay_segments.save_segments(run, buffers),
                "rng": self.rng.bit_generator.state,
                **self.agent.state(),
                **self.collector.state(),
                "schedule": {"name": self.settings.config.trainer.schedule, **self.schedule.state()},
                "evaluation": self.monitor.state(),
            }
            environments = {**self.collector.arrays(), **replay_segments.newest_arrays(buffers)}
            checkpoint.save(run, {**self.agent.arrays(), "environments": environments}, state, keep=number, best=best)

    def restore(self, run: Path) -> float:
        """Take over the latest checkpoint of `run`.

        Returns:
            Training time so far, s.

        Raises:
            CheckpointError: It is damaged, or belongs to other robots, another method, schedule or size.
        """
        folder, state = checkpoint.load_state(run)
        try:
            name = self.settings.config.trainer.schedule
            if state["schedule"]["name"] != name:
                raise CheckpointError(f"{folder}: of schedule {state['schedule']['name']!r}, but the run says {name!r}")
            self.agent.restore(folder, state)
            environments = checkpoint.load_arrays(folder / "environments.safetensors")
            newest = {key: environments.pop(key) for key in list(environments) if key.endswith("/newest")}
            self.collector.restore(environments, state, folder / "environments.safetensors")
            replay_segments.load_segments(run, state["segments"], newest, self.collector.buffers, state["sweeps"])
            self.schedule.restore(state["schedule"])
            self.monitor.restore(state["evaluation"])
            self.rng.bit_generator.state = state["rng"]
            return float(state["elapsed_s"])
        except (LookupError, ValueError, TypeError, ArithmeticError, RuntimeError) as error:
            if isinstance(error, MorphkitError) and not isinstance(error, ConfigError):
                raise
            raise CheckpointError(f"{folder}: does not fit the run: {error}") from None

    def clear_older(self, run: Path) -> None:
        """Remove checkpoints and replay beside those of `run` that are kept; a process leaves some that is killed."""
        checkpoint.clear_older(run, self._number_kept)

    @property
    def _number_kept(self) -> int:
        keep = self.settings.config.trainer.keep
        return keep if isinstance(keep, int) else 1

    def close(self) -> None:
        """Stop the threads of the environments."""
        self.collector.env.close()
        self.monitor.close()


def check_device(name: str) -> None:
    """Refuse a device that PyTorch does not have here.

    Raises:
        ConfigError: It does not; the message lists those that it has.
    """
    gpus = torch.cuda.device_count()
    known = ["cpu", *["cuda"][:gpus], *(f"cuda:{number}" for number in range(gpus))]
    known += ["mps"] * torch.backends.mps.is_available()
    if name not in known:
        hint = "; a GPU is called 'cuda'" if name.lower() in ("gpu", "nvidia") else ""
        raise ConfigError(f"device {name!r}: PyTorch has none of this name here{hint}; it has {', '.join(known)}")


def check_sizes(run: Path, config: TrainConfig) -> None:
    """Refuse settings that the latest checkpoint cannot be of, before anything of such a size takes up memory.

    Raises:
        CheckpointError: There are such settings, or the checkpoint is damaged.
    """
    folder, state = checkpoint.load_state(run)
    arrays = {}
    for name in ("policy", "learner"):
        arrays.update(checkpoint.load_arrays(folder / f"{name}.safetensors"))
    sizes = (config.model, *([config.learner.sizes()] if config.learner.critic == "perceptron" else []))
    network_arrays.require_sizes(sizes, Vocabulary.from_dict(state["vocabulary"]), arrays, folder)
    obs = checkpoint.load_arrays(folder / "environments.safetensors").get("trainer/obs")
    if obs is None or len(obs) != config.trainer.num_envs:
        raise CheckpointError(f"{folder}: made with another number of environments than {config.trainer.num_envs}")
