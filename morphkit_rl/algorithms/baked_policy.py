"""A policy for one robot alone: its names are read, and observations and controls have their units."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from morphkit_rl.algorithms.actions import ActionScale
from morphkit_rl.algorithms.known_part import KnownPart
from morphkit_rl.algorithms.normalizer import normalize
from morphkit_rl.models.layout import Layout


class BakedPolicy(nn.Module):
    """(batch, tokens) observations in the tokens' units -> (batch, actuators) controls in the actuators' units.

    Both are float32.

    Args:
        actor: The network.
        layout: The robot, or `part` of it.
        scale: (tokens,) factor that normalizes observations; None leaves them as they are.
        shift: (tokens,) summand that normalizes observations; None as with `scale`.
        sign: (tokens,) factor of 1 or -1 on observations before that; None for 1.
        part: What the actor is shown of the robot, whose other actuators rest in the middle of their ranges; None for
            all of it.
    """

    scale: Tensor | None
    shift: Tensor | None
    sign: Tensor | None
    sensors: Tensor | None
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
        part: KnownPart | None = None,
    ):
        super().__init__()
        self.actor, self.layout = actor, layout
        (spec,), (columns,) = layout.specs, layout.actuator_columns
        sensors = None
        if part is not None:
            spec, sensors = part.whole, torch.from_numpy(part.sensors)
            acting, columns = columns, np.full(len(spec.actuators), layout.num_actions)
            columns[part.actuators] = acting
        controls = ActionScale(spec)
        for name, values in {"scale": scale, "shift": shift, "sign": sign, "sensors": sensors}.items():
            if values is None:
                setattr(self, name, None)  # torch.export miscounts buffers that are None
            else:
                self.register_buffer(name, values)
        self.register_buffer("columns", torch.tensor(columns))
        self.register_buffer("center", torch.from_numpy(controls.center))
        self.register_buffer("half_range", torch.from_numpy(controls.half))
        with torch.no_grad():
            self.names = cast(Any, actor).read_names(layout)

    def forward(self, obs: Tensor) -> Tensor:
        """Control the robot."""
        if self.sensors is not None:
            obs = obs[:, self.sensors]
        if self.sign is not None:
            obs = obs * self.sign
        action = self.actor(normalize(obs, self.scale, self.shift), self.layout, self.names)
        if self.sensors is not None:
            action = F.pad(action, (0, 1))
        return (self.center + self.half_range * action[:, self.columns].double()).float()
