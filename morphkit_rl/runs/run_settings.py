"""What is in a run folder's `config.json`: robots, settings, budget and versions."""

from __future__ import annotations

import hashlib
import json
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib import metadata
from pathlib import Path
from types import MappingProxyType
from typing import Any

from morphkit.description import Description
from morphkit.errors import CheckpointError, ConfigError, MorphkitError, UnknownNameError
from morphkit.morphology import Base
from morphkit.naming.limbs import canonical_limb_names
from morphkit.readers import read as read_robot
from morphkit.tokens.spec import TokenSpec
from morphkit.utils.atomic_write import write_atomically, write_text
from morphkit.utils.suggest import did_you_mean_or_list
from morphkit_rl.config.train_config import TrainConfig
from morphkit_rl.envs.robot import Robot, prepare
from morphkit_rl.envs.tasks import Task
from morphkit_rl.runs import robot_entry, run_folder, saved_policy, saved_task, schema
from morphkit_rl.runs.git_commit import git_commit
from morphkit_rl.runs.lock import locked
from morphkit_rl.runs.machine import machine
from morphkit_rl.runs.run_folder import CONFIG, ROBOTS, START
from morphkit_rl.runs.saved_policy import SavedPolicy
from morphkit_rl.text.encoder import TextEncoder

_NOTHING: Mapping[str, Sequence[str]] = MappingProxyType({})
PACKAGES = ("morphkit", "mujoco", "torch", "transformers", "numpy", "gymnasium")
_ORIGIN = ("versions", "git_commit", "machine", "mended")


@dataclass(frozen=True, slots=True)
class RunSettings:
    """Everything that determines a run.

    Attributes:
        robots: The training robots.
        validation: Robots that are evaluated as the training robots are, but not trained on.
        hold_out: Names of robots that were kept away.
        config: Settings of text encoder, networks, TD3 and trainer.
        task: The task, or its name where it ships; None: each robot's own.
        base: How roots are attached to the world; None: each robot's own.
        seed: Seed of everything random.
        minutes: Budget of training time; None for none.
        steps: Budget of environment steps over all robots; None for none.
        device: Torch device of the learner.
        threads: Torch threads; sums differ in the last digits with another number.
        start: The policy that training goes on from; None begins anew.
    """

    robots: tuple[Description, ...]
    validation: tuple[Description, ...]
    hold_out: tuple[str, ...]
    config: TrainConfig
    task: str | Task | None
    base: Base | None
    seed: int
    minutes: float | None
    steps: int | None
    device: str
    threads: int
    start: SavedPolicy | None = None

    def __post_init__(self) -> None:
        if not self.robots:
            raise ConfigError("no robot is left to train on")
        names = [robot.name for robot in (*self.robots, *self.validation)]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ConfigError(f"two robots are called {twice[0]!r}; each needs a name of its own")
        if self.validation and not self.config.trainer.evaluate_steps:
            raise ConfigError("validation robots are never evaluated; set trainer.evaluate_steps, such as to 50000")
        if self.config.trainer.keep == "best" and not self.validation:
            raise ConfigError(
                "trainer.keep=best needs validation robots to choose by: --validate NAME; those held out choose nothing"
            )
        for name, value in (("minutes", self.minutes), ("steps", self.steps)):
            if value is not None and not 0 < value < float("inf"):
                raise ConfigError(f"{name} is {value}; expected a positive number")
        if not 0 <= self.seed < 2**63:
            raise ConfigError(f"seed is {self.seed}; expected a non-negative number")


def split(
    descriptions: Sequence[Description], hold_out: Sequence[str], validation: Sequence[str]
) -> tuple[list[Description], list[Description]]:
    """The descriptions to train on, and those to validate on.

    Raises:
        UnknownNameError: A name in `hold_out` or `validation` is none of them.
        ConfigError: A name is in both.
    """
    names = [description.name for description in descriptions]
    for what, chosen in (("hold out", hold_out), ("validate on", validation)):
        for name in chosen:
            if name not in names:
                hint = did_you_mean_or_list(name, names)
                raise UnknownNameError(f"cannot {what} {name!r}: none of the robots is called so{hint}")
    both = sorted(set(hold_out) & set(validation))
    if both:
        raise ConfigError(f"{both[0]!r} is both held out and to be validated on; held-out robots are never evaluated")
    return (
        [description for description in descriptions if description.name not in {*hold_out, *validation}],
        [description for description in descriptions if description.name in validation],
    )


def create(run: Path, settings: RunSettings, mended: Mapping[str, Sequence[str]] = _NOTHING) -> None:
    """Make the run folder and write `config.json` and the robots' files; `mended` is that of the session.

    With canonical naming, `config.json` holds the robots' canonical names, so that they stay whatever later rules say.

    Raises:
        OutputError: The folder cannot be written or holds files.
    """
    run_folder.create_run(run)
    with locked(run):  # against a second process that was started at the same time
        run_folder.clear_unfinished(run)
        for number, robot in enumerate((*settings.robots, *settings.validation)):
            write_atomically(run / ROBOTS / robot_entry.source_file(number, robot), _writer(robot.source))
        if settings.config.text.naming == "canonical":
            robots, validation = (tuple(map(_with_names, part)) for part in (settings.robots, settings.validation))
            settings = replace(settings, robots=robots, validation=validation)
        if settings.start is not None:
            saved_policy.save(settings.start, run / START)
        versions = {name: metadata.version(name) for name in PACKAGES}
        origin = dict(zip(_ORIGIN, (versions, git_commit(), machine(), dict(mended)), strict=True))
        _write(run, settings, origin)


def with_budget(run: Path, settings: RunSettings, minutes: float | None, steps: int | None) -> RunSettings:
    """Give a run another budget, and write it down."""
    changed = replace(settings, minutes=minutes, steps=steps)
    saved = read(run)
    _write(run, changed, {name: saved.get(name) for name in _ORIGIN})
    return changed


def read(run: Path) -> dict[str, Any]:
    """Read `config.json`.

    Raises:
        CheckpointError: It is missing or damaged, or the run folder holds links.
    """
    run_folder.require_run(run)
    return schema.read(run / CONFIG, schema.Config)


def train_config(run: Path, saved: Mapping[str, Any]) -> TrainConfig:
    """The settings of training in what `read` gave.

    Raises:
        CheckpointError: One does not exist, or has an impossible value.
    """
    try:
        return TrainConfig.from_dict(saved["config"], origin=str(run / CONFIG))
    except ConfigError as error:
        raise CheckpointError(str(error)) from None


@contextmanager
def buildable(run: Path) -> Iterator[None]:
    """Around what is built from the settings of a run, which may be anybody's.

    Raises:
        CheckpointError: The libraries refuse them, such as for their size.
    """
    try:
        yield
    except (RuntimeError, ValueError, TypeError, ArithmeticError, MemoryError) as error:
        if isinstance(error, MorphkitError):
            raise
        reason = textwrap.shorten(str(error) or type(error).__name__, 200, placeholder=" ...")
        raise CheckpointError(f"{run / CONFIG}: its settings cannot be used: {reason}") from None


def load(run: Path) -> RunSettings:
    """Settings of a run.

    Raises:
        CheckpointError: The run folder is missing or damaged.
        ConfigError: Its task has terms that are unknown.
    """
    saved = read(run)
    task = saved_task.from_json(saved, str(run / CONFIG))
    try:
        robots, validation = (
            tuple(robot_entry.from_json(run, entry) for entry in saved.get(part, ()))
            for part in ("robots", "validation")
        )
        fields = {name: saved[name] for name in ("base", "seed", "minutes", "steps", "device", "threads")}
        config = train_config(run, saved)
        hold_out = tuple(saved["hold_out"])
        start = saved_policy.load(run / START) if (run / START).exists() else None
        return RunSettings(robots, validation, hold_out, config, task=task, start=start, **fields)
    except (OSError, ConfigError) as error:
        raise CheckpointError(f"{run / CONFIG}: damaged: {error}") from None


def prepare_robot(
    config: TrainConfig,
    description: Description,
    *,
    task: str | Task | None = None,
    base: Base | None = None,
    drawn: bool = False,
    critics: bool = False,
) -> Robot:
    """A robot with the tokens that `config` asks for; `task` and `base` default to the robot's own.

    Its textures are read only where it is `drawn`. What critics see matters to `critics` only.
    """
    trainer = config.trainer
    return prepare(
        description,
        config.text.naming,
        task=task,
        base=base,
        sensors=trainer.sensors,
        limb_names=config.text.limb_names,
        text_style=config.text.style,
        drawn=drawn,
        actuation=None if trainer.actuation == "default" else trainer.actuation,
        control_frequency=trainer.control_frequency or None,
        critic_sensors=trainer.critic_sensors if critics and config.critics_see_more else (),
    )


def with_names_of(saved: Mapping[str, Any], description: Description) -> Description:
    """A robot with the canonical names that it has in a run, whose `config.json` is `saved`, if it is a robot of it."""
    for entry in (*saved.get("robots", ()), *saved.get("validation", ())):
        if (entry["sha256"], entry["root"]) == (description.sha256, description.root):
            info = replace(description.info, canonical=entry["info"]["canonical"] or description.info.canonical)
            return replace(description, info=info)
    return description


def make_encoder(config: TrainConfig) -> TextEncoder:
    """The text encoder that `config` names."""
    pooling = None if config.text.pooling == "default" else config.text.pooling
    return TextEncoder(config.text.encoder, pooling=pooling)


def texts_digest(specs: Sequence[TokenSpec]) -> str:
    """SHA-256 over the token texts of all robots, in order."""
    texts = [spec.texts for spec in specs]
    return hashlib.sha256(json.dumps(texts).encode()).hexdigest()


def _write(run: Path, settings: RunSettings, about: Mapping[str, Any]) -> None:
    described = [robot_entry.to_json(*pair) for pair in enumerate((*settings.robots, *settings.validation))]
    values = {
        "robots": described[: len(settings.robots)],
        "validation": described[len(settings.robots) :],
        "hold_out": list(settings.hold_out),
        "config": settings.config.to_dict(),
        **saved_task.to_json(settings.task),
        **{name: getattr(settings, name) for name in ("base", "seed", "minutes", "steps", "device", "threads")},
        **about,
    }
    write_text(run / CONFIG, json.dumps(values, indent=2) + "\n")


def _with_names(robot: Description) -> Description:
    names = canonical_limb_names(read_robot(robot), robot.info.canonical)
    return replace(robot, info=replace(robot.info, canonical={**robot.info.canonical, **names}))


def _writer(source: bytes) -> Callable[[Path], object]:
    return lambda file: file.write_bytes(source)
