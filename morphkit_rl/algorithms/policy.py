"""A trained policy without its trainer."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from morphkit.description import Description
from morphkit.errors import CheckpointError, ConfigError
from morphkit.morphology import Base
from morphkit.tokens.spec import TokenSpec
from morphkit_rl.algorithms.baked_policy import BakedPolicy
from morphkit_rl.algorithms.known_part import KnownPart, known_part
from morphkit_rl.algorithms.mirror import better_known, mirror_signs
from morphkit_rl.algorithms.normalizer import Normalizer
from morphkit_rl.config.methods import find_method
from morphkit_rl.config.train_config import TrainConfig
from morphkit_rl.envs.robot import Robot
from morphkit_rl.envs.tasks import Task
from morphkit_rl.models import build
from morphkit_rl.models.layout import build_layout
from morphkit_rl.models.vocabulary import Vocabulary
from morphkit_rl.runs import checkpoint as checkpoints
from morphkit_rl.runs import hub, network_arrays, run_settings, saved_policy, saved_task
from morphkit_rl.runs.run_folder import CONFIG, LATEST
from morphkit_rl.runs.saved_policy import SavedPolicy
from morphkit_rl.runs.trusted_encoder import with_encoder
from morphkit_rl.text.baselines import controlled
from morphkit_rl.text.embedder import TokenEmbedder
from morphkit_rl.text.tuning import make_tuner

Controller = Callable[[np.ndarray], np.ndarray]
"""float32 observations (batch, tokens) to float32 controls (batch, actuators) of one robot."""


class Policy:
    """One noise-free policy for any robot whose tokens have names.

    Args:
        actor: The network.
        normalizer: Observation statistics.
        embedder: Texts to embeddings.
        config: What the policy was trained with.
        trained_on: Names of the training robots.
        vocabulary: What the networks were made for.
        saved: What it was read from.

    Example:
        >>> policy = Policy.load("runs/cheetah")  # doctest: +SKIP
        >>> controls = policy.act(spec, obs)  # doctest: +SKIP
    """

    def __init__(
        self,
        actor: nn.Module,
        normalizer: Normalizer,
        embedder: TokenEmbedder,
        config: TrainConfig,
        trained_on: Sequence[str] = (),
        vocabulary: Vocabulary | None = None,
        saved: SavedPolicy | None = None,
    ):
        self.actor, self.normalizer, self.embedder, self.config = actor, normalizer, embedder, config
        self.trained_on, self.vocabulary, self.saved = tuple(trained_on), vocabulary, saved
        self._controllers: dict[TokenSpec, Controller] = {}
        self._latest: tuple[TokenSpec, Controller] | None = None  # finding a specification takes 30 us

    @classmethod
    def load(cls, run: str | Path, *, encoder: str | None = None, checkpoint: str = LATEST) -> Policy:
        """Load the policy of a run folder or a policy folder, or one that ships.

        Args:
            run: The folder, or `zoo:NAME`.
            encoder: Text encoder in place of the run's own, which needs your trust where it does not ship with
                morphkit; see `trusted_encoder.with_encoder`.
            checkpoint: `latest`, `best`, or the name of one that the run kept.

        Raises:
            UnknownNameError: No policy of that name ships.
            CheckpointError: There is none, it is damaged, or it belongs to another method.
            ConfigError: The run's text encoder does not ship with morphkit, and nobody said that it may be used.
            DependencyError: The text encoder is out of reach.
        """
        policy = saved_policy.load(run, checkpoint)
        config = run_settings.train_config(policy.folder, policy.settings)
        return cls.of(policy, with_encoder(config, policy.folder, encoder))

    @classmethod
    def of(cls, policy: SavedPolicy, config: TrainConfig) -> Policy:
        """Build the networks of a policy that was read.

        Args:
            policy: What was read.
            config: Its settings, with a text encoder that the user trusts.

        Raises:
            CheckpointError: Settings and arrays do not fit each other.
            DependencyError: The text encoder is out of reach.
        """
        state, arrays, origin = policy.state, policy.arrays, policy.origin
        vocabulary, quantities = Vocabulary.from_dict(state["vocabulary"]), state["quantities"]
        network_arrays.require_sizes([config.model], vocabulary, arrays, origin)
        counts = {f"normalizer/{key}": np.zeros(len(quantities)) for key in ("count", "mean", "m2")}
        network_arrays.require_shapes(arrays, counts, origin)
        statistics = {key.removeprefix("normalizer/"): arrays[key] for key in counts}
        try:
            mean, std = arrays["embedding/mean"], arrays["embedding/std"]
        except KeyError as error:
            raise CheckpointError(f"{origin}: damaged: it lacks {error}") from None
        source = controlled(run_settings.make_encoder(config), config.text.control, vocabulary.texts)
        embedder = TokenEmbedder(source, mean, std, arrays.get("embedding/components"))
        normalizer = Normalizer()
        normalizer.load_state_dict(statistics, quantities)
        if not mean.shape == std.shape == (source.size,):
            raise CheckpointError(
                f"{origin.parent}: made with embeddings of size {mean.size}; "
                f"{config.text.encoder!r} gives {source.size}"
            )
        components = embedder.components
        if components is not None and (components.ndim != 2 or len(components) != source.size):
            raise CheckpointError(f"{origin}: damaged: embedding/components is {components.shape}")
        method = find_method(config.model.method)
        checkpoints.check_method(origin.parent, state, method.name)
        tune = make_tuner(config.text.tune, embedder, vocabulary.texts)
        with run_settings.buildable(policy.folder):
            actor, _ = build(config.model, embedder.size, vocabulary, tune)
        network_arrays.load_modules({"actor": actor}, arrays, origin)
        return cls(actor, normalizer, embedder, config, policy.robots, vocabulary, policy)

    @classmethod
    def from_hub(cls, repository: str, *, encoder: str | None = None, **options: Any) -> Policy:
        """Load a policy from the Hugging Face hub.

        Args:
            repository: `OWNER/NAME`.
            encoder: As in `load`.
            options: `revision`, `token` and `endpoint` of `runs.hub.fetched`.

        Raises:
            DependencyError: huggingface_hub is not installed.
            CheckpointError: There is no such policy, or the hub is out of reach.
            ConfigError: As `load`.
        """
        with hub.fetched(repository, **options) as folder:
            return cls.load(folder, encoder=encoder)

    def push_to_hub(self, repository: str, *, card: str | None = None, **options: Any) -> str:
        """Upload the policy to the Hugging Face hub, as it was loaded.

        Args:
            repository: `OWNER/NAME`.
            card: The model card, Markdown; `evaluation.model_card` writes one.
            options: `private`, `token` and `endpoint` of `runs.hub.push`.

        Returns:
            Address of the repository.

        Raises:
            ConfigError: The policy was not loaded from anywhere.
            DependencyError: huggingface_hub is not installed.
            OutputError: The hub refuses or is out of reach, or the folder that the policy was loaded from is gone.
        """
        if self.saved is None:
            raise ConfigError("only a policy that was loaded can be uploaded; it was made in memory")
        return hub.push(self.saved, repository, {} if card is None else {saved_policy.CARD: card}, **options)

    def prepare(
        self,
        descriptions: Sequence[Description],
        *,
        task: str | Task | None = None,
        base: Base | None = None,
        drawn: bool = False,
    ) -> list[Robot]:
        """Robots for this policy, with tokens as it reads them.

        Args:
            descriptions: The robots.
            task: The task or its name; default: that of the run, which may be each robot's own.
            base: How roots are attached to the world; default: as `task`.
            drawn: Whether the robots are to be drawn.

        Raises:
            ConfigError: A robot has no actuators.
        """
        settings: Mapping[str, Any] = {}
        if self.saved is not None:
            settings = self.saved.settings
            task = task or saved_task.from_json(settings, str(self.saved.folder / CONFIG))
            base = base or settings.get("base")
        robots = []
        for description in descriptions:
            named = run_settings.with_names_of(settings, description)
            robots.append(run_settings.prepare_robot(self.config, named, task=task, base=base, drawn=drawn))
            if not robots[-1].spec.actuators:
                raise ConfigError(f"{description.name}: has no actuators, so there is nothing to control")
        return robots

    def act(self, spec: TokenSpec, obs: np.ndarray) -> np.ndarray:
        """Controls for one robot.

        Args:
            spec: The robot's tokens.
            obs: (tokens,) or (batch, tokens) observations in token order, in the tokens' units.

        Returns:
            float32 (actuators,) or (batch, actuators) in the actuators' units and order.

        Raises:
            ConfigError: The observations have another width than the robot has sensor tokens, the method cannot
                express the robot, or the policy was trained on a choice of quantities that `spec` goes beyond.
        """
        obs = np.asarray(obs, dtype=np.float32)
        if obs.ndim not in (1, 2) or obs.shape[-1] != len(spec.sensors):
            raise ConfigError(
                f"{spec.morphology}: expected observations of width {len(spec.sensors)}, "
                f"got an array of shape {obs.shape}"
            )
        if self._latest is None or self._latest[0] is not spec:
            self._latest = spec, self._controllers.get(spec) or self._prepare(spec)
        return self._latest[1](np.atleast_2d(obs)).reshape(*obs.shape[:-1], len(spec.actuators))

    def bake(self, spec: TokenSpec) -> BakedPolicy:
        """The policy for one robot alone, with its names read.

        Args:
            spec: The robot's tokens.

        Raises:
            ConfigError: As `act`.
        """
        if spec.naming != self.config.text.naming:
            warnings.warn(
                f"{spec.morphology}: tokens are named {spec.naming!r}, the policy was trained on "
                f"{self.config.text.naming!r} names",
                stacklevel=4,
            )
        self._check_quantities(spec)
        method = find_method(self.config.model.method)
        whole, part = self._shown(spec)
        shown = part.spec if part else whole
        method.check(shown, self.config.model, self.vocabulary)
        layout = build_layout([shown], self.embedder, actions=method.actions)
        scale = shift = None
        if self.config.trainer.normalize:
            scale, shift = map(torch.from_numpy, self.normalizer.scale_and_shift(self.normalizer.index([shown])))
        sign = None if whole is spec else torch.from_numpy(mirror_signs(shown))
        return BakedPolicy(self.actor, layout, scale, shift, sign, part)

    def reads(self, spec: TokenSpec) -> TokenSpec:
        """A robot's tokens with the texts that the policy reads: its own, or those of its mirror image."""
        return self._shown(spec)[0]

    def rests(self, spec: TokenSpec) -> tuple[str, ...]:
        """Limbs of a robot that the policy does not act by, since training had none of their names."""
        part = self._shown(spec)[1]
        return part.rests if part else ()

    def _shown(self, spec: TokenSpec) -> tuple[TokenSpec, KnownPart | None]:
        """The robot as the actor is to see it, itself or its mirror image, and what of it; None for all."""
        augment, vocabulary = self.config.augment, self.vocabulary
        if vocabulary is None:
            return spec, None
        whole = better_known(spec, vocabulary.texts_of_bodies()) if augment.mirror_unseen else spec
        return whole, known_part(whole, vocabulary.texts) if augment.rest_unseen else None

    def _prepare(self, spec: TokenSpec) -> Controller:
        baked = self.bake(spec)

        @torch.no_grad()
        def act(obs: np.ndarray) -> np.ndarray:
            controls: np.ndarray = baked(torch.from_numpy(obs)).numpy()
            return controls

        self._controllers[spec] = act
        return act

    def _check_quantities(self, spec: TokenSpec) -> None:
        chosen = self.config.trainer.sensors
        statistics = {key.partition("/")[0] for key in self.normalizer.keys}  # those of critics, too
        known = (self.vocabulary and set(self.vocabulary.quantities)) or statistics
        beyond = [quantity for quantity in dict.fromkeys(s.quantity for s in spec.sensors) if quantity not in known]
        if chosen and beyond:
            raise ConfigError(
                f"{spec.morphology}: has tokens of {', '.join(beyond)}, which the policy was trained without "
                f"(trainer.sensors is {', '.join(chosen)})"
            )
