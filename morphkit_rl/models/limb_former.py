"""Limb-Former: name-conditioned limb tokens and a small transformer over the limbs.

With `e(name)` the frozen embedding of a token's name, limb l of a robot becomes

    t_l = LayerNorm( sum over its scalars i of  v_i * P e(name_i)  +  Q mean_i e(name_i) ),

so that a scalar costs one vector, not one token. Transformer layers then mix the limbs of each robot, and

    a_k = tanh( w . relu( V t_limb(k) + U e(name_k) ) )

is the action of actuator k. A critic reads each action as one more named scalar of the limb that it drives, and
averages over the limbs before its head.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from morphkit.tokens.spec import TokenSpec
from morphkit_rl.config.train_config import ModelConfig
from morphkit_rl.kernels.limb_layer import Kinship
from morphkit_rl.models.blocks import MemberLinear, TransformerLayer, first
from morphkit_rl.models.layout import FOREIGN, Layout, Slots
from morphkit_rl.models.vocabulary import Vocabulary


@dataclass(frozen=True)
class Names:
    """What an encoder makes of a layout's names alone; the same for every row of values.

    Attributes:
        weights: (limbs, slots, members * d_model) vector that each scalar is multiplied by.
        tokens: (members, limbs, d_model) part of the limb tokens that does not depend on values.
        attention: For each group of robots, its limbs and (members, 1, heads, limbs, limbs) bias by kinship; -inf
            between robots.
        relation_bias: (members, heads, kinds) the same by kinship alone, for the compiled kernel.
        kinship: How the limbs of each robot are related.
    """

    weights: Tensor
    tokens: Tensor
    attention: tuple[tuple[slice, Tensor], ...]
    relation_bias: Tensor
    kinship: Kinship


class LimbEncoder(nn.Module):
    """Named scalars -> limb tokens mixed by transformer layers.

    Args:
        members: Number of independent networks evaluated side by side.
        embedding_size: Size of a token's text embedding.
        d_model: Width of a limb token.
        layers: Number of transformer layers.
        heads: Attention heads.
        feedforward: Width of the feed-forward part.

    Attributes:
        precision: What the transformer layers compute in; everything around them is float32.
    """

    def __init__(self, members: int, embedding_size: int, d_model: int, layers: int, heads: int, feedforward: int):
        super().__init__()
        self.precision = torch.float32
        self.value = MemberLinear(members, embedding_size, d_model, bias=False)
        self.name = MemberLinear(members, embedding_size, d_model)
        self.relation_bias = nn.Parameter(torch.zeros(members, heads, FOREIGN))
        self.layers = nn.ModuleList(TransformerLayer(members, d_model, heads, feedforward) for _ in range(layers))

    def read_names(self, slots: Slots, layout: Layout, members: int | None = None) -> Names:
        """Do what depends on the layout's names only, for the first `members` networks; default: all."""
        d_model, members = self.value.weight.shape[-1], members or len(self.value.weight)
        values = self.value(layout.embeddings.expand(members, -1, -1)).index_select(1, slots.text.view(-1))
        bias = F.pad(self.relation_bias[:members], (0, 1), value=float("-inf"))
        return Names(
            weights=values.transpose(0, 1).reshape(*slots.column.shape, members * d_model),
            tokens=self.name(layout.limb_embeddings.expand(members, -1, -1)),
            attention=tuple(
                (group, bias[..., layout.relation[group, group]].unsqueeze(1).to(self.precision))
                for group in layout.groups
            ),
            relation_bias=first(self.relation_bias, members),
            kinship=layout.kinship,
        )

    def forward(self, row: Tensor, slots: Slots, names: Names) -> Tensor:
        """Encode rows of scalars.

        Args:
            row: (batch, width) scalars of all robots side by side.
            slots: Which limb reads which column.
            names: What `read_names` made of the same slots.

        Returns:
            (members, batch, limbs, d_model).
        """
        members, limbs, d_model = names.tokens.shape
        values = F.pad(row, (0, 1))[:, slots.column].transpose(0, 1)
        tokens = torch.bmm(values, names.weights).view(limbs, -1, members, d_model).permute(2, 1, 0, 3)
        x = F.layer_norm(tokens + names.tokens.unsqueeze(1), (d_model,)).to(self.precision)
        if self._suits_kernel(x):
            for layer in self.layers:
                assert isinstance(layer, TransformerLayer)
                x = layer.mix_kin(x, names.kinship, names.relation_bias)
        else:
            x = torch.cat([self._mix(x[:, :, group], bias) for group, bias in names.attention], 2)
        return F.layer_norm(x.float(), (d_model,))

    def _suits_kernel(self, x: Tensor) -> bool:
        return all(isinstance(layer, TransformerLayer) and layer.suits_kernel(x) for layer in self.layers)

    def _mix(self, x: Tensor, bias: Tensor) -> Tensor:
        for layer in self.layers:
            x = layer(x, bias)
        return x


class Actor(nn.Module):
    """Deterministic policy: (batch, tokens) -> (batch, actuators) in [-1, 1]."""

    last_layers = ("read.", "name.", "head.")

    def __init__(self, embedding_size: int, *, d_model: int, layers: int, heads: int, feedforward: int):
        super().__init__()
        self.encoder = LimbEncoder(1, embedding_size, d_model, layers, heads, feedforward)
        self.read = MemberLinear(1, d_model, d_model)
        self.name = MemberLinear(1, embedding_size, d_model, bias=False)
        self.head = MemberLinear(1, d_model, 1, gain=0.1)

    def read_names(self, layout: Layout) -> tuple[Names, Tensor]:
        """Do what depends on the layout's names only: for the encoder, and (1, actuators, d_model) for the head."""
        return self.encoder.read_names(layout.observation, layout), self.name(
            layout.embeddings[layout.action_text][None]
        )

    def forward(self, obs: Tensor, layout: Layout, names: tuple[Names, Tensor] | None = None) -> Tensor:
        """Act on normalised observation rows; `names`, from `read_names`, saves time while the weights stay."""
        limb_names, actuator_names = names or self.read_names(layout)
        limbs = self.encoder(obs, layout.observation, limb_names)[0]
        if len(layout.action_limb) == 0:
            return obs.new_zeros(len(obs), 0)
        x = self._own_limbs(limbs, layout)
        hidden = F.relu(self.read(x.reshape(1, -1, x.shape[-1])).view(x.shape) + actuator_names)
        return torch.tanh(self.head(hidden.view(1, -1, x.shape[-1])).view(x.shape[:2]))

    def _own_limbs(self, limbs: Tensor, layout: Layout) -> Tensor:
        """(batch, actuators, d_model) tokens of the limbs that actuators drive; the mean where it is no single one."""
        if layout.each_action_has_a_limb:
            return limbs.index_select(1, layout.action_limb)
        means = torch.matmul(layout.robot_limbs, limbs)[:, layout.action_robot]
        without_limb = (layout.action_limb == limbs.shape[1])[:, None]
        return torch.where(without_limb, means, F.pad(limbs, (0, 0, 0, 1))[:, layout.action_limb])


class TwinCritic(nn.Module):
    """Two action values in one module: (batch, tokens), (batch, actuators) -> (2, batch, robots)."""

    last_layers = ("hidden.", "head.")

    def __init__(self, embedding_size: int, *, d_model: int, layers: int, heads: int, feedforward: int):
        super().__init__()
        self.encoder = LimbEncoder(2, embedding_size, d_model, layers, heads, feedforward)
        self.hidden = MemberLinear(2, d_model, 2 * d_model)
        self.head = MemberLinear(2, 2 * d_model, 1)

    def value_robot(self, layout: Layout) -> Tensor:
        """(robots,) robot of each value: one value a robot."""
        return torch.arange(layout.num_robots, device=layout.relation.device)

    def forward(self, obs: Tensor, action: Tensor, layout: Layout, members: int = 2) -> Tensor:
        """Value actions in [-1, 1] at normalised observation rows, by the first `members` critics."""
        slots = layout.observation_and_action
        limbs = self.encoder(torch.cat([obs, action], -1), slots, self.encoder.read_names(slots, layout, members))
        pooled = torch.matmul(layout.robot_limbs, limbs)
        members, batch, robots, width = pooled.shape
        hidden = F.relu(self.hidden(pooled.reshape(members, -1, width)))
        return self.head(hidden).view(members, batch, robots)


def check(spec: TokenSpec, config: ModelConfig, vocabulary: Vocabulary | None = None) -> None:
    """Limb-Former expresses every robot."""


def build(config: ModelConfig, embedding_size: int, vocabulary: Vocabulary) -> tuple[Actor, TwinCritic]:
    """Actor and twin critics."""
    sizes = {
        "d_model": config.d_model,
        "layers": config.layers,
        "heads": config.heads,
        "feedforward": config.feedforward,
    }
    return Actor(embedding_size, **sizes), TwinCritic(embedding_size, **sizes)
