"""Amorpheus: a transformer over the limbs, whose kinship it does not know (Kurin et al. 2021, "My Body is a Cage").

With o_l the scalars of limb l,

    x_l = sqrt(d) (W o_l + b)
    z   = norm(encoder(x))                       post-norm layers, attention among the robot's limbs
    a_l = tanh( w . [z_l ; o_l] + c )            `model.conditioned`; without: tanh( w . z_l + c )

The critics, which MA-BERT and AnyMorph take too, are the same network on [o_l ; a_l] without tanh: each limb has a
value Q_l of its own. A robot's reward is the reward of all of its limbs, roots included; minima are taken limb by limb.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from morphkit.tokens.spec import TokenSpec
from morphkit_rl.config.train_config import ModelConfig
from morphkit_rl.models.blocks import MemberLinear
from morphkit_rl.models.layout import Layout
from morphkit_rl.models.limb_checks import check_limbs
from morphkit_rl.models.transformer import Encoder
from morphkit_rl.models.vocabulary import Vocabulary

INITIAL_RANGE = 0.1
"""Bound of the first weights of input layer and head, as published."""


class LimbTransformer(nn.Module):
    """Limb scalars to one number a limb.

    Args:
        members: Number of independent networks evaluated side by side.
        scalars: Number of scalars in a limb.
        config: Sizes, and whether the head is conditioned on the limb's scalars.

    Attributes:
        precision: What the encoder computes in; everything around it is float32.
    """

    def __init__(self, members: int, scalars: int, config: ModelConfig):
        super().__init__()
        d_model = config.d_model
        self.precision, self.conditioned = torch.float32, config.conditioned
        self.read = MemberLinear(members, scalars, d_model).draw(INITIAL_RANGE, None)
        self.encoder = Encoder(members, d_model, config.layers, config.heads, config.feedforward)
        self.head = MemberLinear(members, d_model + scalars * config.conditioned, 1).draw(INITIAL_RANGE, 0)

    def forward(self, limbs: Tensor, layout: Layout) -> Tensor:
        """Map (members, batch, limbs, scalars) to (members, batch, limbs)."""
        members, batch, number, scalars = limbs.shape
        rows = limbs.reshape(members, batch * number, scalars)
        x = self.read(rows) * math.sqrt(self.read.weight.shape[-1])
        x = x.view(members, batch, number, -1).to(self.precision)
        z = self.encoder(x, layout.limbs).to(rows.dtype).view(members, batch * number, -1)
        return self.head(torch.cat([z, rows], -1) if self.conditioned else z).view(members, batch, number)


class Actor(nn.Module):
    """(batch, tokens) -> (batch, limbs) in [-1, 1]."""

    def __init__(self, scalars: int, config: ModelConfig):
        super().__init__()
        self.network = LimbTransformer(1, scalars, config)
        self.last_layers = _last_layers(config)

    def read_names(self, layout: Layout) -> None:
        """Names mean nothing to this method."""

    def forward(self, obs: Tensor, layout: Layout, names: None = None) -> Tensor:
        """Act on observation rows."""
        return torch.tanh(self.network(obs.reshape(1, len(obs), layout.num_actions, -1), layout)[0])


class TwinCritic(nn.Module):
    """Two values a limb: (batch, tokens), (batch, limbs) -> (2, batch, limbs)."""

    def __init__(self, scalars: int, config: ModelConfig):
        super().__init__()
        self.network = LimbTransformer(2, scalars + 1, config)
        self.last_layers = _last_layers(config)

    def value_robot(self, layout: Layout) -> Tensor:
        """(limbs,) robot of each value: one value a limb."""
        return layout.action_robot

    def forward(self, obs: Tensor, action: Tensor, layout: Layout, members: int = 2) -> Tensor:
        """Value actions in [-1, 1] at observation rows, by the first `members` critics."""
        limbs = torch.cat([obs.reshape(*action.shape, -1), action[..., None]], -1)
        return self.network(limbs.expand(members, -1, -1, -1), layout)


def check(spec: TokenSpec, config: ModelConfig, vocabulary: Vocabulary | None = None) -> None:
    """Raise ConfigError where the robot's limbs are not alike."""
    check_limbs(config.method, spec, vocabulary)


def build(config: ModelConfig, embedding_size: int, vocabulary: Vocabulary) -> tuple[Actor, TwinCritic]:
    """Actor and twin critics."""
    return Actor(vocabulary.scalars, config), TwinCritic(vocabulary.scalars, config)


def _last_layers(config: ModelConfig) -> tuple[str, ...]:
    return (f"network.encoder.layers.{config.layers - 1}.", "network.encoder.norm.", "network.head.")
