"""A penalty on actions at their bounds, where tanh lets hardly any gradient through."""

from __future__ import annotations

import torch
from torch import Tensor

_BOUND = 1 - 1e-6


def saturation(action: Tensor, margin: float = 0.0) -> Tensor:
    """Mean square of what tanh made into `action`, a scalar; there is no gradient where that was beyond 7.25.

    Args:
        action: Actions in [-1, 1].
        margin: Only what goes beyond this counts, in either direction.
    """
    before = torch.atanh(action.clamp(-_BOUND, _BOUND))
    if margin > 0:
        before = (before.abs() - margin).relu()
    return before.square().mean()


def saturation_and_gradient(action: Tensor, margin: float = 0.0) -> tuple[Tensor, Tensor]:
    """`saturation`, and its gradient with regard to the actions, like them."""
    inside = action.clamp(-_BOUND, _BOUND)
    before = torch.atanh(inside)
    beyond = before - before.clamp(-margin, margin)
    slope = beyond * (2 / action.numel()) / (1 - inside.square())
    return beyond.square().mean(), slope.masked_fill_(inside != action, 0.0)
