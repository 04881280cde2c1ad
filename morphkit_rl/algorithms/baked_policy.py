"""A policy for one robot alone: its names are read, and observations and controls have their units."""

from __future__ import annotations

from typing import Any, cast

import torch
from torch import Tensor, nn

from morphkit_rl.algorithms.actions import ActionScale
from morphkit_rl.algorithms.normalizer import normalize
from morphkit_rl.models.layout import Layout


class BakedPolicy(nn.Module):
    """(batch, tokens) observations in the tokens' units -> (batch, actuators) controls in the actuators' units.

    Both are float32.

    Args:
        actor: The network.
        layout: The robot.
        scale: (tokens,) factor that normalizes observations; None leaves them as they are.
        shift: (tokens,) summand that normalizes observations; None as with `scale`.
        sign: (tokens,) factor of 1 or -1 on observations before that; None for 1.
    """

    scale: Tensor | None
    shift: Tensor | None
    sign: Tensor | None
    columns: Tensor
    center: Tensor
    half_range: Tensor

    def __init__(
        self,
        actor: nn.Module,
        layout: Layout,
        scale: Tensor | None,
        shift: Tensor | None,
        sign: Tensor | None = None,
    ):
        super().__init__()
        self.actor, self.layout = actor, layout
        (spec,), (columns,) = layout.specs, layout.actuator_columns
        controls = ActionScale(spec)
        self.register_buffer("scale", scale)
        self.register_buffer("shift", shift)
        self.register_buffer("sign", sign)
        self.register_buffer("columns", torch.tensor(columns))
        self.register_buffer("center", torch.from_numpy(controls.center))
        self.register_buffer("half_range", torch.from_numpy(controls.half))
        with torch.no_grad():
            self.names = cast(Any, actor).read_names(layout)

    def forward(self, obs: Tensor) -> Tensor:
        """Control the robot."""
        if self.sign is not None:
            obs = obs * self.sign
        action = self.actor(normalize(obs, self.scale, self.shift), self.layout, self.names)
        return (self.center + self.half_range * action[:, self.columns].double()).float()
