"""Training settings: frozen dataclasses, read from TOML presets, changed with `key=value`."""

from __future__ import annotations

import dataclasses
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any, Literal

from morphkit.errors import ConfigError, UnknownNameError
from morphkit_rl.config.augment_config import AugmentConfig
from morphkit_rl.config.learner_config import LearnerConfig
from morphkit_rl.config.methods import DEFAULT, ModelSettings, find_method, settings_of
from morphkit_rl.config.parsing import bounded, fill, lists_for_tuples, override


@dataclass(frozen=True, slots=True)
class TextConfig:
    """How token texts become vectors.

    Attributes:
        encoder: `minilm`, a model name of the Hugging Face hub, or a local folder.
        pooling: `mean`, `cls`, or `default` for what suits the encoder.
        naming: `canonical` gives like limbs of different robots like texts; `raw` keeps the file's names.
        limb_names: Whether limbs are called by their body (link) or by their joint.
        style: Whether texts are words or, as in published code, names with their underscores.
        standardize: Whether embeddings are standardized over the training texts; published code takes them as they are.
        components: Principal components of the training texts' embeddings that are kept; 0 for the embeddings as they
            are. Fewer make name-conditioned weights cheaper.
        control: `none`, or what replaces the embeddings to see whether the text matters: `random` vectors,
            `shuffled` ones of other training texts, or `one-hot` numbers of training texts.
        tune: Whether embeddings stay `frozen`, get a learned `residual` each, or the whole `encoder` learns; texts that
            training does not know keep their frozen ones.
    """

    encoder: str = "minilm"
    pooling: Literal["default", "mean", "cls"] = "default"
    naming: Literal["canonical", "raw"] = "raw"
    limb_names: Literal["body", "joint"] = "body"
    style: Literal["words", "raw"] = "words"
    standardize: bool = True
    components: int = 0
    control: Literal["none", "random", "shuffled", "one-hot"] = "none"
    tune: Literal["frozen", "residual", "encoder"] = "frozen"


@dataclass(frozen=True, slots=True)
class TD3Config:
    """TD3 (Fujimoto et al. 2018).

    Attributes:
        batch_size: Transitions in an update over all robots; every robot gives the same share, rounded up. In the
            schedule `rounds`, those of the one robot that is updated.
        discount: Discount of one step.
        n_step: Rewards summed before the target bootstraps.
        tau: Share of the online networks that a Polyak update moves into the targets.
        policy_delay: Critic updates per actor and target update.
        actor_first: Whether the first update of the critics is followed by one of the actor, as in published code; else
            the `policy_delay`-th is.
        learning_rate: Adam's step size, for actor and critics.
        target_noise: Standard deviation of the noise on target actions, on actions in [-1, 1].
        target_noise_clip: Bound of that noise.
        exploration_noise: Standard deviation of the noise on actions in [-1, 1] while collecting.
        gradient_clip: Largest gradient norm; 0 for none.
        reset_updates: Updates after which the last layers are drawn anew, again and again (Nikishin et al. 2022); 0 for
            never.
        reward_scale: Factor on rewards before they are learned from.
        saturation_penalty: Factor, in the actor's loss, on the mean square of atanh(action). Above 0 it keeps a young
            actor from fleeing to the ends of its range, where tanh passes no gradient back; 0, as published, for none.
    """

    batch_size: int = bounded(252, at_least=1)
    discount: float = bounded(0.99, at_most=1)
    n_step: int = bounded(1, at_least=1)
    tau: float = bounded(0.02, at_most=1)
    policy_delay: int = bounded(2, at_least=1)
    actor_first: bool = False
    learning_rate: float = 6e-4
    target_noise: float = 0.2
    target_noise_clip: float = 0.5
    exploration_noise: float = 0.2
    gradient_clip: float = 10.0
    reset_updates: int = 0
    reward_scale: float = 0.1
    saturation_penalty: float = 0.0


@dataclass(frozen=True, slots=True)
class TrainerConfig:
    """Collection, logging and checkpoints.

    Attributes:
        schedule: `sweeps`: after each step of all environments a few updates that mix all robots. `rounds`: the
            published order; an episode of every robot, then, robot by robot, updates from its own replay: as many for
            each, and in all as many as counted steps.
        num_envs: Environments a robot; more where `total_envs` says so.
        total_envs: Environments of all robots together, at least: few robots get more each, so that a robot alone is
            stepped as often for each update as a family; 0 for `num_envs` a robot, as where that is changed by name.
        start_steps: Environment steps, over all robots, before the first update; actions are random, or those of the
            policy that training goes on from.
        start_steps_per_robot: The same as steps a robot; the larger of the two holds.
        updates_per_sweep: Updates after each step of all environments, of the schedule `sweeps`.
        replay_capacity: Transitions kept, over all robots.
        replay_dtype: How observations and actions are kept; `float16` takes half the memory.
        normalize: Whether observations are standardized by running statistics.
        observation: `fixed`, or `legacy` with the published code's defects.
        sensors: Quantities that are observed, such as `position`, or `no_ltv`: all but `type`; none named: all.
        critic_sensors: What perceptron critics see besides what the policy does, named as `sensors` are; none: the
            same. Critics are not saved with a policy, which needs its own sensors only.
        actuation: How motors are driven: `torque`, `position`, `as-file`, or `default`: by position on a free base
            whose file has no actuators, otherwise as the file says.
        control_frequency: Control steps per second, Hz; 0 for the robot's own, else the task's.
        evaluate_steps: Steps between two noise-free evaluations of the training and validation robots; 0 for none.
        evaluate_episodes: Episodes a robot in such an evaluation.
        precision: `bfloat16`, `float32`, or `auto` for what the processor is good at.
        log_seconds: Seconds between two rows of metrics.
        checkpoint_seconds: Seconds between two checkpoints.
        keep: `last`: the newest checkpoint only; `best`: also the one whose noise-free evaluation was best on the
            validation robots; a number: the newest so many.
        track: Where curves are shown besides `metrics.jsonl`; `wandb` and `trackio` are extras.
    """

    schedule: Literal["sweeps", "rounds"] = "sweeps"
    num_envs: int = bounded(8, at_least=1)
    total_envs: int = 0
    start_steps: int = 20_000
    start_steps_per_robot: int = 0
    updates_per_sweep: int = bounded(4, at_least=1)
    replay_capacity: int = bounded(2_000_000, at_least=1)
    replay_dtype: Literal["float32", "float16"] = "float32"
    normalize: bool = True
    observation: Literal["fixed", "legacy"] = "fixed"
    sensors: tuple[str, ...] = ()
    critic_sensors: tuple[str, ...] = ()
    actuation: Literal["default", "torque", "position", "as-file"] = "default"
    control_frequency: float = 0.0
    evaluate_steps: int = 0
    evaluate_episodes: int = bounded(10, at_least=1)
    precision: Literal["auto", "float32", "bfloat16"] = "auto"
    log_seconds: float = 10.0
    checkpoint_seconds: float = 60.0
    keep: Literal["last", "best"] | int = bounded("last", at_least=1)
    track: Literal["tensorboard", "wandb", "trackio"] = "tensorboard"


def _default_model() -> ModelSettings:
    return find_method(DEFAULT).settings(method=DEFAULT)


@dataclass(frozen=True, slots=True)
class TrainConfig:
    """All settings of a training run."""

    text: TextConfig = field(default_factory=TextConfig)
    model: ModelSettings = field(default_factory=_default_model, metadata={"choose": settings_of})
    td3: TD3Config = field(default_factory=TD3Config)
    learner: LearnerConfig = field(default_factory=LearnerConfig)
    augment: AugmentConfig = field(default_factory=AugmentConfig)
    trainer: TrainerConfig = field(default_factory=TrainerConfig)

    def __post_init__(self) -> None:
        if self.critics_see_more and self.learner.critic != "perceptron":
            raise ConfigError(
                "trainer.critic_sensors needs learner.critic = 'perceptron': the critics of a published method see what"
                " its policy sees; set trainer.critic_sensors to []"
            )

    @property
    def critics_see_more(self) -> bool:
        """Whether critics see what the policy does not."""
        policy, critics = self.trainer.sensors, self.trainer.critic_sensors
        everything = not policy or "all" in policy
        return bool(critics) and not (everything and set(critics) == {"all"})

    def to_dict(self) -> dict[str, dict[str, Any]]:
        """Sections and their settings, as JSON and TOML can hold them."""
        return dataclasses.asdict(self, dict_factory=lists_for_tuples)

    def for_robots(self, number: int) -> TrainConfig:
        """These settings with the environments that each of so many training robots gets."""
        num_envs = max(self.trainer.num_envs, -(-self.trainer.total_envs // number))
        return dataclasses.replace(self, trainer=dataclasses.replace(self.trainer, num_envs=num_envs))

    @classmethod
    def from_dict(cls, values: Mapping[str, Any], *, origin: str) -> TrainConfig:
        """Build from sections of settings.

        Raises:
            ConfigError: A section or key does not exist, or a value has the wrong type or range.
        """
        return fill(cls, values, origin)


def presets() -> tuple[str, ...]:
    """Names of the presets that ship with morphkit_rl."""
    folder = resources.files("morphkit_rl.config") / "presets"
    return tuple(sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml")))


def load_config(preset: str | Path = "default", overrides: Sequence[str] = ()) -> TrainConfig:
    """Read a preset and change single settings.

    Args:
        preset: Name of a shipped preset, or path of a TOML file.
        overrides: Settings such as `td3.tau=0.01`; the value is TOML, or a bare word.

    Raises:
        UnknownNameError: There is no such preset.
        ConfigError: The file is no TOML, or a setting does not exist or has an impossible value.
    """
    if str(preset) in presets():
        origin = f"preset {preset}"
        source = (resources.files("morphkit_rl.config") / "presets" / f"{preset}.toml").read_bytes()
    elif Path(preset).suffix == ".toml" and Path(preset).is_file():
        origin, source = str(preset), Path(preset).read_bytes()
    else:
        raise UnknownNameError(f"no preset {str(preset)!r} and no such .toml file; presets: {', '.join(presets())}")
    try:
        values: dict[str, Any] = tomllib.loads(source.decode())
    except ValueError as error:
        raise ConfigError(f"{origin}: not valid TOML: {error}") from None
    for text in overrides:
        override(values, text)
    changed = [text.partition("=")[0].strip() for text in overrides]
    if "trainer.num_envs" in changed and "trainer.total_envs" not in changed:
        override(values, "trainer.total_envs=0")  # the number that somebody asks for holds
    return TrainConfig.from_dict(values, origin=origin)
