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
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from morphkit.tokens.spec import TokenSpec
from morphkit_rl.config.methods import Method, ModelSettings
from morphkit_rl.config.parsing import bounded
from morphkit_rl.models.blocks import MemberLinear
from morphkit_rl.models.layout import Layout
from morphkit_rl.models.limb_checks import check_limbs
from morphkit_rl.models.transformer import Encoder
from morphkit_rl.models.vocabulary import Vocabulary

INITIAL_RANGE = 0.1
"""Bound of the first weights of input layer and head, as published."""


@dataclass(frozen=True, slots=True)
class AmorpheusSettings(ModelSettings):
    """Sizes of actor and critics.

    Attributes:
        d_model: Width of a limb token.
        layers: Transformer layers.
        heads: Attention heads.
        feedforward: Width of the feed-forward part of a layer.
        conditioned: Whether the head reads a limb's scalars again.
    """

    method: str = "amorpheus"
    d_model: int = bounded(64, at_least=1)
    layers: int = bounded(2, at_least=1)
    heads: int = bounded(2, at_least=1)
    feedforward: int = bounded(128, at_least=1)
    conditioned: bool = True


class LimbTransformer(nn.Module):
    """Limb scalars to one number a limb.

    Args:
        members: Number of independent networks evaluated side by side.
        scalars: Number of scalars in a limb.
        settings: Sizes, and whether the head is conditioned on the limb's scalars.

    Attributes:
        precision: What the encoder computes in; everything around it is float32.
    """

    def __init__(self, members: int, scalars: int, settings: AmorpheusSettings):
        super().__init__()
        d_model = settings.d_model
        self.precision, self.conditioned = torch.float32, settings.conditioned
        self.read = MemberLinear(members, scalars, d_model).draw(INITIAL_RANGE, None)
        self.encoder = Encoder(members, d_model, settings.layers, settings.heads, settings.feedforward)
        self.head = MemberLinear(members, d_model + scalars * settings.conditioned, 1).draw(INITIAL_RANGE, 0)

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

    def __init__(self, scalars: int, settings: AmorpheusSettings):
        super().__init__()
        self.network = LimbTransformer(1, scalars, settings)
        self.last_layers = _last_layers(settings)

    def read_names(self, layout: Layout) -> None:
        """Names mean nothing to this method."""

    def forward(self, obs: Tensor, layout: Layout, names: None = None) -> Tensor:
        """Act on observation rows."""
        return torch.tanh(self.network(obs.reshape(1, obs.shape[0], layout.num_actions, -1), layout)[0])


class TwinCritic(nn.Module):
    """Two values a limb: (batch, tokens), (batch, limbs) -> (2, batch, limbs)."""

    def __init__(self, scalars: int, settings: AmorpheusSettings):
        super().__init__()
        self.network = LimbTransformer(2, scalars + 1, settings)
        self.last_layers = _last_layers(settings)

    def value_robot(self, layout: Layout) -> Tensor:
        """(limbs,) robot of each value: one value a limb."""
        return layout.action_robot

    def forward(self, obs: Tensor, action: Tensor, layout: Layout, members: int = 2) -> Tensor:
        """Value actions in [-1, 1] at observation rows, by the first `members` critics."""
        limbs = torch.cat([obs.reshape(*action.shape, -1), action[..., None]], -1)
        return self.network(limbs.expand(members, -1, -1, -1), layout)


def check_robot(spec: TokenSpec, settings: AmorpheusSettings, vocabulary: Vocabulary | None = None) -> None:
    """Raise ConfigError where the robot's limbs are not alike."""
    check_limbs(settings.method, spec, vocabulary)


def build(settings: AmorpheusSettings, embedding_size: int, vocabulary: Vocabulary) -> tuple[Actor, TwinCritic]:
    """Actor and twin critics."""
    return Actor(vocabulary.scalars, settings), TwinCritic(vocabulary.scalars, settings)


def _last_layers(settings: AmorpheusSettings) -> tuple[str, ...]:
    return (f"network.encoder.layers.{settings.layers - 1}.", "network.encoder.norm.", "network.head.")


METHOD = Method(
    name="amorpheus",
    summary="transformer over limbs that knows neither names nor kinship",
    actions="limbs",
    settings=AmorpheusSettings,
    build=build,
    check=check_robot,
    preset="amorpheus-paper",
    label="Amorpheus",
    color="#CC79A7",
)
