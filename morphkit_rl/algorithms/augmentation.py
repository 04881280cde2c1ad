"""What the actor is shown in its updates besides the robots as they are: mirror images, hidden limbs, unsure names."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from morphkit.errors import ConfigError
from morphkit.tokens.spec import TokenSpec
from morphkit_rl.algorithms.mirror import mirror_image, mirror_signs
from morphkit_rl.algorithms.normalizer import CLIP
from morphkit_rl.config.augment_config import AugmentConfig
from morphkit_rl.models.layout import FOREIGN, Layout


@dataclass(frozen=True)
class Shown:
    """How an update of the actor sees the robots.

    Attributes:
        layout: The robots under the names that they have there.
        sign: (tokens,) factor on observations before they are standardized, 1 or -1; None for 1.
    """

    layout: Layout
    sign: Tensor | None = None

    def observe(self, obs: Tensor, shift: Tensor | None) -> Tensor:
        """Standardized rows as they are shown, of rows (batch, tokens) standardized with the summand `shift`."""
        if self.sign is None:
            return obs
        if shift is None:
            return obs * self.sign
        return (obs * self.sign + (1 - self.sign) * shift).clamp(-CLIP, CLIP)


class Augmentation:
    """Draws what an update of the actor is shown.

    Args:
        config: The settings.
        layout: The robots.
        lay_out: Makes the layout of other robots.

    Raises:
        ConfigError: Settings contradict each other.
    """

    def __init__(self, config: AugmentConfig, layout: Layout, lay_out: Callable[[Sequence[TokenSpec]], Layout]):
        self.config, self.layout = config, layout
        self.image: Shown | None = None
        if config.mirror:
            sign = np.concatenate([mirror_signs(spec) for spec in layout.specs])
            device = layout.embeddings.device
            self.image = Shown(
                lay_out([mirror_image(spec) for spec in layout.specs]), torch.from_numpy(sign).to(device)
            )

    def draw(self, rng: np.random.Generator) -> Shown:
        """What the next update is shown."""
        shown = Shown(self.layout)
        if self.image is not None and rng.random() < 0.5:
            shown = self.image
        layout = shown.layout
        if self.config.limb_dropout:
            layout = _hide(layout, rng.random(len(layout.relation)) < self.config.limb_dropout)
        embeddings = layout.embeddings
        if self.config.name_noise:
            noise = rng.standard_normal(embeddings.shape, dtype=np.float32) * self.config.name_noise
            embeddings = embeddings + torch.from_numpy(noise).to(embeddings.device)
        if self.config.name_dropout:
            kept = rng.random((len(embeddings), 1), dtype=np.float32) >= self.config.name_dropout
            embeddings = embeddings * torch.from_numpy(kept).to(embeddings.device)
        if embeddings is not layout.embeddings:
            layout = layout.with_embeddings(embeddings)
        return replace(shown, layout=layout)


def make_augmentation(
    config: AugmentConfig, layout: Layout, lay_out: Callable[[Sequence[TokenSpec]], Layout]
) -> Augmentation | None:
    """The augmentation of some robots; None where the settings ask for none."""
    return Augmentation(config, layout, lay_out) if config.in_updates else None


def check_augmentation(config: AugmentConfig, method: str, tune: str) -> None:
    """Raise ConfigError where a method, or embeddings that are learned, do not know what is asked for."""
    if config.limb_dropout and method != "limb-former":
        raise ConfigError(f"augment.limb_dropout hides limbs from those of limb-former, not from those of {method}")
    if tune != "frozen" and (config.name_noise or config.name_dropout):
        raise ConfigError(
            "augment.name_noise and augment.name_dropout change frozen embeddings; text.tune is not frozen"
        )


def _hide(layout: Layout, hidden: np.ndarray) -> Layout:
    """The layout in which no limb sees those of `hidden` (limbs,) but they themselves."""
    relation = layout.relation.clone()
    own = relation.diagonal().clone()
    relation[:, torch.from_numpy(hidden).to(relation.device)] = FOREIGN
    relation.diagonal().copy_(own)
    return layout.with_relation(relation)
