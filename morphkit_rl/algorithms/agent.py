"""What learns: a method's networks under TD3, the embeddings of the robots' names, and observation statistics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from morphkit.errors import CheckpointError
from morphkit.tokens.spec import TokenSpec
from morphkit_rl.algorithms.normalizer import Normalizer
from morphkit_rl.algorithms.td3 import TD3, resolve_precision
from morphkit_rl.buffers.replay_buffer import Batch
from morphkit_rl.config.train_config import TrainConfig
from morphkit_rl.models import find
from morphkit_rl.models.layout import Layout, build_layout
from morphkit_rl.models.vocabulary import Vocabulary
from morphkit_rl.runs import checkpoint, run_settings
from morphkit_rl.text.baselines import controlled
from morphkit_rl.text.embedder import TokenEmbedder
from morphkit_rl.text.tuning import make_tuner


@dataclass(frozen=True, eq=False)
class View:
    """Some robots side by side, as the networks see them.

    Attributes:
        layout: Where their tokens, limbs and actions stand.
        quantities: Row of observation statistics of each token.
    """

    layout: Layout
    quantities: np.ndarray


class Agent:
    """Acts for and learns from several robots.

    Args:
        config: All settings.
        specs: The training robots.
        device: Torch device.

    Attributes:
        robots: All training robots side by side.
        each: The training robots one by one.

    Raises:
        ConfigError: There is no such method, or it cannot express one of the robots.
    """

    def __init__(self, config: TrainConfig, specs: Sequence[TokenSpec], device: str):
        self.config, self.device = config, device
        self.method = find(config.model.method)
        self.vocabulary = Vocabulary.of(specs)
        for spec in specs:  # before the networks, whose sizes would make no sense
            self.check(spec)
        texts = [text for spec in specs for text in spec.texts]
        source = controlled(run_settings.make_encoder(config), config.text.control, self.vocabulary.texts)
        self.embedder = TokenEmbedder.fit(source, texts, standardize=config.text.standardize)
        self.learner = TD3(
            config.model,
            config.td3,
            self.embedder.size,
            vocabulary=self.vocabulary,
            tune=make_tuner(config.text.tune, self.embedder, self.vocabulary.texts),
            device=device,
            precision=resolve_precision(config.trainer.precision, device),
        )
        self.normalizer = Normalizer()
        self.normalizer.index(specs, grow=True)
        self.robots = self.view(specs)
        self.each = [self.view([spec]) for spec in specs]
        self._standard: dict[View, tuple[Tensor | None, Tensor | None]] = {}

    def check(self, spec: TokenSpec) -> None:
        """Raise ConfigError where the method, made for the training robots, cannot express the robot `spec`."""
        self.method.check(spec, self.config.model, self.vocabulary)

    def view(self, specs: Sequence[TokenSpec]) -> View:
        """Robots, of training or not, side by side.

        Raises:
            ConfigError: The method cannot express one of them.
        """
        for spec in specs:
            self.check(spec)
        layout = build_layout(specs, self.embedder, self.device, actions=self.method.actions)
        return View(layout, self.normalizer.index(specs))

    def observe(self, obs: np.ndarray) -> None:
        """Add observations (batch, tokens) of all training robots to the statistics; see `refresh`."""
        if self.config.trainer.normalize:
            self.normalizer.update(obs, self.robots.quantities)

    def refresh(self) -> None:
        """From now on, standardise with the statistics of all that was observed so far."""
        self._standard.clear()

    def act(self, obs: np.ndarray, view: View | None = None) -> np.ndarray:
        """Noise-free actions in [-1, 1] (batch, actions) at raw observations (batch, tokens) of the robots of `view`.

        Args:
            obs: Observations.
            view: The robots; default: all training robots.
        """
        view = view or self.robots
        return self.learner.act(obs, *self._scale_and_shift(view), view.layout)

    def update(
        self, batch: Batch, rng: np.random.Generator, view: View | None = None, number: int | None = None
    ) -> dict[str, Tensor]:
        """One TD3 update.

        Args:
            batch: Transitions of the robots of `view`.
            rng: Source of the target noise.
            view: The robots; default: all training robots.
            number: Which update it is, from 0, for `td3.policy_delay`; default: that of all so far.

        Returns:
            The losses.
        """
        view = view or self.robots
        return self.learner.update(batch, *self._scale_and_shift(view), view.layout, rng, number)

    def arrays(self) -> dict[str, dict[str, np.ndarray]]:
        """Everything of a checkpoint that is large: arrays by name, a group a file."""
        networks = self.learner.networks()
        return {
            "policy": {
                **checkpoint.module_arrays({"actor": networks.pop("actor")}),
                **{f"normalizer/{key}": array for key, array in self.normalizer.state_dict().items()},
                "embedding/mean": self.embedder.mean,
                "embedding/std": self.embedder.std,
            },
            "learner": checkpoint.module_arrays(networks),
            "optimizer": checkpoint.optimizer_arrays(self.learner.optimizers()),
        }

    def state(self) -> dict[str, Any]:
        """Everything of a checkpoint that JSON can hold."""
        return {
            "method": self.method.name,
            "updates": self.learner.updates,
            "precision": self.learner.precision,
            "quantities": self.normalizer.keys,
            "vocabulary": self.vocabulary.to_dict(),
            "token_texts": run_settings.texts_digest(self.robots.layout.specs),
        }

    def restore(self, folder: Path, state: Mapping[str, Any]) -> None:
        """Take over the checkpoint in `folder`.

        Raises:
            CheckpointError: It is damaged, or belongs to other robots, another method or another size.
        """
        checkpoint.check_method(folder, state, self.method.name)
        if state["token_texts"] != run_settings.texts_digest(self.robots.layout.specs):
            raise CheckpointError(f"{folder}: made for robots with other tokens than those of this run")
        policy = checkpoint.load_arrays(folder / "policy.safetensors")
        rest = checkpoint.load_arrays(folder / "learner.safetensors")
        checkpoint.load_modules(self.learner.networks(), {**policy, **rest}, folder)
        checkpoint.load_optimizers(self.learner.optimizers(), checkpoint.load_arrays(folder / "optimizer.safetensors"))
        statistics = {key: policy[f"normalizer/{key}"] for key in ("count", "mean", "m2")}
        self.normalizer.load_state_dict(statistics, state["quantities"])
        self.embedder.mean, self.embedder.std = policy["embedding/mean"], policy["embedding/std"]
        self.learner.updates, self.learner.precision = state["updates"], state["precision"]
        self.refresh()

    def _scale_and_shift(self, view: View) -> tuple[Tensor | None, Tensor | None]:
        if not self.config.trainer.normalize:
            return None, None
        if view not in self._standard:
            arrays = self.normalizer.scale_and_shift(view.quantities)
            scale, shift = (torch.from_numpy(array).to(self.device) for array in arrays)
            self._standard[view] = scale, shift
        return self._standard[view]
