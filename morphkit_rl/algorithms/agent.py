"""What learns: a method's networks under TD3, the embeddings of the robots' names, and observation statistics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from morphkit.errors import CheckpointError
from morphkit.tokens.spec import TokenSpec
from morphkit_rl.algorithms import fine_tuning
from morphkit_rl.algorithms.augmentation import Augmentation, check_augmentation, make_augmentation
from morphkit_rl.algorithms.normalizer import Normalizer
from morphkit_rl.algorithms.policy import Policy
from morphkit_rl.algorithms.return_normalizer import ReturnNormalizer
from morphkit_rl.algorithms.td3 import TD3, resolve_precision
from morphkit_rl.algorithms.view import View, part_of
from morphkit_rl.buffers.replay_buffer import Batch
from morphkit_rl.config.methods import find_method
from morphkit_rl.config.train_config import TrainConfig
from morphkit_rl.models.layout import Layout, build_layout
from morphkit_rl.models.vocabulary import Vocabulary
from morphkit_rl.runs import checkpoint, network_arrays, run_settings
from morphkit_rl.text.baselines import controlled
from morphkit_rl.text.embedder import TokenEmbedder
from morphkit_rl.text.tuning import make_tuner


class Agent:
    """Acts for and learns from several robots.

    Args:
        config: All settings.
        specs: The training robots.
        device: Torch device.
        start: The policy to go on from; None begins anew.
        critic_specs: The same robots as critics see them, with all tokens of `specs`; None where these see the same.

    Attributes:
        robots: All training robots side by side.
        each: The training robots one by one.

    Raises:
        ConfigError: There is no such method, or it cannot express one of the robots.
    """

    def __init__(
        self,
        config: TrainConfig,
        specs: Sequence[TokenSpec],
        device: str,
        start: Policy | None = None,
        critic_specs: Sequence[TokenSpec] | None = None,
    ):
        self.config, self.device, self.start = config, device, start
        self.method = find_method(config.model.method)
        check_augmentation(config.augment, self.method.name, config.text.tune)
        self.vocabulary = Vocabulary.of(specs)
        if start is not None:
            self.vocabulary = fine_tuning.join_vocabulary(self.vocabulary, start)
        for spec in specs:  # before the networks, whose sizes would make no sense
            self.check(spec)
        self.embedder = self._make_embedder(specs)
        self.learner = TD3(
            config.model,
            config.td3,
            self.embedder.size,
            learner=config.learner,
            vocabulary=self.vocabulary,
            critic_vocabulary=None if critic_specs is None else Vocabulary.of(critic_specs),
            tune=make_tuner(config.text.tune, self.embedder, self.vocabulary.texts),
            device=device,
            precision=resolve_precision(config.trainer.precision, device),
        )
        self.normalizer = Normalizer()
        if start is not None:
            for actor in self.learner.actors():
                fine_tuning.take_over(actor, start.actor)
            keys, statistics = fine_tuning.take_over_statistics(start)
            self.normalizer.load_state_dict(statistics, keys)
        self.normalizer.index(specs, grow=True)
        self.normalizer.index(critic_specs or (), grow=True)
        self.returns = None
        if config.learner.normalize_returns:
            self.returns = ReturnNormalizer(
                len(specs), config.trainer.num_envs, config.td3.discount, config.learner.support
            )
        self.robots = self.view(specs, critic_specs)
        seen = [None] * len(specs) if critic_specs is None else [[spec] for spec in critic_specs]
        self.each = [self.view([spec], own) for spec, own in zip(specs, seen, strict=True)]
        self._standard: dict[View, tuple[Tensor, Tensor]] = {}
        self._reward_scale: dict[View, Tensor] = {}
        self._augmentations: dict[View, Augmentation | None] = {}

    def _make_embedder(self, specs: Sequence[TokenSpec]) -> TokenEmbedder:
        config = self.config.text
        source = controlled(run_settings.make_encoder(self.config), config.control, self.vocabulary.texts)
        if self.start is not None:
            known = self.start.embedder
            return TokenEmbedder(source, known.mean, known.std, known.components)
        texts = [text for spec in specs for text in spec.texts]
        return TokenEmbedder.fit(source, texts, standardize=config.standardize, components=config.components)

    @property
    def discount(self) -> float:
        """Discount of one step, for now."""
        options, first = self.config.learner, self.config.td3.discount
        if options.final_discount == 0:
            return first
        used = min(self.learner.updates / options.discount_updates, 1.0)
        return float(1 - (1 - first) ** (1 - used) * (1 - options.final_discount) ** used)

    def check(self, spec: TokenSpec) -> None:
        """Raise ConfigError where the method, made for the training robots, cannot express the robot `spec`."""
        known = self.vocabulary if self.start is None else self.start.vocabulary
        self.method.check(spec, self.config.model, known)

    def view(self, specs: Sequence[TokenSpec], critic_specs: Sequence[TokenSpec] | None = None) -> View:
        """Robots, of training or not, side by side.

        Args:
            specs: The robots.
            critic_specs: As critics see them; None where these see the same, or for robots that are not learned from.

        Raises:
            ConfigError: The method cannot express one of them.
        """
        for spec in specs:
            self.check(spec)
        layout = self._lay_out(specs)
        place = {name: number for number, name in enumerate(self.vocabulary.robots)}
        robots = np.array([place.get(spec.morphology, -1) for spec in specs])
        if critic_specs is not None:
            layout = part_of(layout, critic_specs, self.method.actions)
        return View(layout, self.normalizer.index(layout.stored.specs), robots)

    def observe(self, obs: np.ndarray) -> None:
        """Add observations of all training robots, (batch, stored tokens), to the statistics; see `refresh`."""
        if self.config.trainer.normalize:
            self.normalizer.update(obs, self.robots.quantities)

    def observe_rewards(self, reward: Sequence[np.ndarray], ended: np.ndarray) -> None:
        """Add the rewards of a step, one array (environments,) a robot, to the statistics of returns; see `refresh`.

        Args:
            reward: Rewards.
            ended: (robots, environments) whether the episode ended.
        """
        if self.returns is not None:
            self.returns.discount = self.discount
            self.returns.update(np.stack(reward), ended)

    def refresh(self) -> None:
        """From now on, standardize with the statistics of all that was observed so far."""
        self._standard.clear()
        self._reward_scale.clear()

    def act(self, obs: np.ndarray, view: View | None = None, *, final: bool = False) -> np.ndarray:
        """Noise-free actions in [-1, 1] (batch, actions) at raw observations (batch, tokens) of the robots of `view`.

        Args:
            obs: Observations.
            view: The robots; default: all training robots.
            final: Whether the actor acts that is kept in the end; see `TD3.act`.
        """
        view = view or self.robots
        return self.learner.act(obs, *self._scale_and_shift(view), view.layout, final=final)

    def explore(self, obs: np.ndarray) -> np.ndarray:
        """`act` for all training robots at observations as they are stored, (batch, stored tokens)."""
        return self.act(self.robots.part(obs))

    def update(
        self, batch: Batch, rng: np.random.Generator, view: View | None = None, number: int | None = None
    ) -> dict[str, Tensor]:
        """One TD3 update.

        Args:
            batch: Transitions of the robots of `view`.
            rng: Source of the target noise and of what the actor is shown.
            view: The robots; default: all training robots.
            number: Which update it is, from 0, for `td3.policy_delay`; default: that of all so far.

        Returns:
            The losses.
        """
        view = view or self.robots
        return self.learner.update(
            batch,
            *self._scale_and_shift(view, stored=True),
            view.layout,
            rng,
            number,
            self._scale_of_rewards(view),
            self._augmentation_of(view),
        )

    def arrays(self) -> dict[str, dict[str, np.ndarray]]:
        """Everything of a checkpoint that is large: arrays by name, a group a file."""
        networks = self.learner.networks()
        return {
            "policy": {
                **network_arrays.module_arrays({"actor": networks.pop("actor")}),
                **{f"normalizer/{key}": array for key, array in self.normalizer.state_dict().items()},
                "embedding/mean": self.embedder.mean,
                "embedding/std": self.embedder.std,
                **({} if self.embedder.components is None else {"embedding/components": self.embedder.components}),
            },
            "learner": {
                **network_arrays.module_arrays(networks),
                **{f"returns/{key}": a for key, a in (self.returns.state_dict() if self.returns else {}).items()},
            },
            "optimizer": network_arrays.optimizer_arrays(self.learner.optimizers()),
        }

    def state(self) -> dict[str, Any]:
        """Everything of a checkpoint that JSON can hold."""
        return {
            "method": self.method.name,
            "updates": self.learner.updates,
            "precision": self.learner.precision,
            "quantities": self.normalizer.keys,
            "vocabulary": self.vocabulary.to_dict(),
            "token_texts": self._texts_digest(),
        }

    def restore(self, folder: Path, state: Mapping[str, Any]) -> None:
        """Take over the checkpoint in `folder`.

        Raises:
            CheckpointError: It is damaged, or belongs to other robots, another method or another size.
        """
        checkpoint.check_method(folder, state, self.method.name)
        if state["token_texts"] != self._texts_digest():
            raise CheckpointError(f"{folder}: made for robots with other tokens than those of this run")
        if state["quantities"] != self.normalizer.keys:
            raise CheckpointError(f"{folder}: made for robots with other quantities than those of this run")
        policy = checkpoint.load_arrays(folder / "policy.safetensors")
        rest = checkpoint.load_arrays(folder / "learner.safetensors")
        optimizer = checkpoint.load_arrays(folder / "optimizer.safetensors", infinite=True)
        own = self.arrays()
        numbers = {key: array for key, array in own["policy"].items() if key.startswith(("normalizer/", "embedding/"))}
        network_arrays.require_shapes(policy, numbers, folder / "policy.safetensors")
        returns = {key: array for key, array in own["learner"].items() if key.startswith("returns/")}
        network_arrays.require_shapes(rest, returns, folder / "learner.safetensors")
        network_arrays.load_modules(self.learner.networks(), {**policy, **rest}, folder)
        network_arrays.load_optimizers(self.learner.optimizers(), optimizer, folder / "optimizer.safetensors")
        statistics = {key: policy[f"normalizer/{key}"] for key in ("count", "mean", "m2")}
        self.normalizer.load_state_dict(statistics, state["quantities"])
        self.embedder.mean, self.embedder.std = policy["embedding/mean"], policy["embedding/std"]
        self.embedder.components = policy.get("embedding/components")
        if self.returns is not None:
            self.returns.load_state_dict({key: rest[f"returns/{key}"] for key in self.returns.state_dict()})
        self.learner.updates, self.learner.precision = state["updates"], state["precision"]
        self.refresh()

    def _texts_digest(self) -> str:
        layout = self.robots.layout
        return run_settings.texts_digest((*layout.specs, *(layout.whole.specs if layout.whole else ())))

    def _scale_and_shift(self, view: View, *, stored: bool = False) -> tuple[Tensor | None, Tensor | None]:
        if not self.config.trainer.normalize:
            return None, None
        if view not in self._standard:
            arrays = self.normalizer.scale_and_shift(view.quantities)
            scale, shift = (torch.from_numpy(array).to(self.device) for array in arrays)
            self._standard[view] = scale, shift
        scale, shift = self._standard[view]
        return (scale, shift) if stored else (view.layout.part(scale), view.layout.part(shift))

    def _lay_out(self, specs: Sequence[TokenSpec]) -> Layout:
        return build_layout(specs, self.embedder, self.device, actions=self.method.actions)

    def _augmentation_of(self, view: View) -> Augmentation | None:
        if view not in self._augmentations:
            self._augmentations[view] = make_augmentation(self.config.augment, view.layout, self._lay_out)
        return self._augmentations[view]

    def _scale_of_rewards(self, view: View) -> Tensor | None:
        if self.returns is None:
            return None
        if view not in self._reward_scale:
            self._reward_scale[view] = torch.from_numpy(self.returns.scale()[view.robots]).to(self.device)
        return self._reward_scale[view]
