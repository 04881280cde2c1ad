"""Robots side by side as networks see them; critics may see more than the policy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from morphkit.tokens.spec import TokenSpec
from morphkit_rl.envs.selection import sensor_columns
from morphkit_rl.models.layout import Actions, Layout, build_layout


@dataclass(frozen=True, eq=False)
class View:
    """Some robots side by side, as the networks see them.

    Attributes:
        layout: Where their tokens, limbs and actions are.
        quantities: Row of observation statistics of each token that is stored.
        robots: Number of each robot among those of training; -1 for others.
    """

    layout: Layout
    quantities: np.ndarray
    robots: np.ndarray

    def part(self, obs: np.ndarray) -> np.ndarray:
        """What the policy sees of observations (batch, stored tokens)."""
        columns = self.layout.columns
        return obs if columns is None else obs.take(columns.cpu().numpy(), axis=1)


def part_of(layout: Layout, specs: Sequence[TokenSpec], actions: Actions) -> Layout:
    """A layout as a part of that of the same robots with more tokens.

    Args:
        layout: The robots as policies see them.
        specs: The same robots as critics see them.
        actions: As in `build_layout`.

    Returns:
        `layout` with its `whole`, whose texts have no embeddings: perceptron critics read none.
    """
    device = layout.token_text.device
    whole = build_layout(specs, lambda texts: np.zeros((len(texts), 1), np.float32), device, actions=actions)
    columns = [
        own.start + sensor_columns(spec, seen)
        for own, spec, seen in zip(whole.tokens, layout.specs, specs, strict=True)
    ]
    return replace(layout, whole=whole, columns=torch.as_tensor(np.concatenate(columns), device=device))
