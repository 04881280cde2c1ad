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
from functools import cached_property

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from morphkit.tokens.spec import TokenSpec
from morphkit_rl.config.methods import Method, ModelSettings
from morphkit_rl.config.parsing import bounded
from morphkit_rl.kernels import actuator_heads, limb_tokens
from morphkit_rl.models.blocks import MemberLinear, TransformerLayer, first
from morphkit_rl.models.layout import FOREIGN, Layout, Slots
from morphkit_rl.models.vocabulary import Vocabulary

_UNSEEN = -50.0
"""Bias of attention to limbs that are hidden: a share of 1e-22, which is no subnormal number."""


@dataclass(frozen=True, slots=True)
class LimbFormerSettings(ModelSettings):
    """Sizes of actor and critics.

    Attributes:
        d_model: Width of a limb token.
        layers: Transformer layers.
        heads: Attention heads.
        feedforward: Width of the feed-forward part of a layer.
    """

    method: str = "limb-former"
    d_model: int = bounded(64, at_least=1)
    layers: int = bounded(2, at_least=1)
    heads: int = bounded(2, at_least=1)
    feedforward: int = bounded(128, at_least=1)


@dataclass(frozen=True)
class Names:
    """What an encoder makes of a layout's names alone; the same for every row of values.

    Attributes:
        slots: Which limb reads which column.
        layout: The robots.
        vectors: (members, texts, d_model) vector that a scalar of each text is multiplied by.
        tokens: (members, limbs, d_model) part of the limb tokens that does not depend on values.
        relation_bias: (members, heads, kinds) bias of attention by kinship.
    """

    slots: Slots
    layout: Layout
    vectors: Tensor
    tokens: Tensor
    relation_bias: Tensor

    @cached_property
    def weights(self) -> Tensor:
        """(limbs, slots, members * d_model) vector of the scalar in each slot."""
        members, _, d_model = self.vectors.shape
        weights = self.vectors.index_select(1, self.slots.text.view(-1)).transpose(0, 1)
        return weights.reshape(*self.slots.column.shape, members * d_model)

    @cached_property
    def attention(self) -> list[tuple[slice, Tensor]]:
        """Groups of robots, their limbs and (members, 1, heads, limbs, limbs) bias; -inf between robots."""
        bias = F.pad(self.relation_bias, (0, 1), value=float("-inf"))
        groups = self.layout.groups
        return [(group, bias[..., self.layout.relation[group, group]].unsqueeze(1)) for group in groups]


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
        members = members or self.value.weight.shape[0]
        return Names(
            slots=slots,
            layout=layout,
            vectors=self.value(layout.embeddings.expand(members, -1, -1)),
            tokens=self.name(layout.limb_embeddings.expand(members, -1, -1)),
            relation_bias=first(self.relation_bias, members),
        )

    def forward(self, row: Tensor, names: Names) -> Tensor:
        """Encode rows of scalars.

        Args:
            row: (batch, width) scalars of all robots side by side.
            names: What `read_names` made of the layout.

        Returns:
            (members, batch, limbs, d_model) tokens, not yet normalized, as precise as the layers.
        """
        x = self._tokens(row, names)
        if all(isinstance(layer, TransformerLayer) and layer.suits_kernel(x) for layer in self.layers):
            bias = (
                F.pad(names.relation_bias, (0, 1), value=_UNSEEN) if names.layout.hides_limbs else names.relation_bias
            )
            for layer in self.layers:
                assert isinstance(layer, TransformerLayer)
                x = layer.mix_kin(x, names.layout.kinship, bias)
            return x
        return torch.cat([self._mix(x[:, :, group], bias.to(x.dtype)) for group, bias in names.attention], 2)

    def _tokens(self, row: Tensor, names: Names) -> Tensor:
        members, limbs, d_model = names.tokens.shape
        if limb_tokens.available(row, d_model, self.precision):
            return limb_tokens.limb_tokens(row, names.slots.scalars, names.vectors, names.tokens, self.precision)
        values = F.pad(row, (0, 1))[:, names.slots.column].transpose(0, 1)
        summed = torch.bmm(values, names.weights).view(limbs, -1, members, d_model).permute(2, 1, 0, 3)
        return F.layer_norm(summed + names.tokens.unsqueeze(1), (d_model,)).to(self.precision)

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
        """Act on normalized observation rows; `names`, from `read_names`, saves time while the weights stay."""
        limb_names, actuator_names = names or self.read_names(layout)
        limbs = self.encoder(obs, limb_names)[0]
        if layout.num_actions == 0:
            return obs.new_zeros(obs.shape[0], 0)
        if layout.each_action_has_a_limb and actuator_heads.available(limbs):
            return actuator_heads.actuator_heads(limbs, layout.action_limb, self.head_parameters(actuator_names))
        x = self._own_limbs(F.layer_norm(limbs.float(), limbs.shape[-1:]), layout)
        hidden = F.relu(self.read(x.reshape(1, -1, x.shape[-1])).view(x.shape) + actuator_names)
        return torch.tanh(self.head(hidden.view(1, -1, x.shape[-1])).view(x.shape[:2]))

    def head_parameters(self, actuator_names: Tensor) -> list[Tensor]:
        """What the compiled heads take, with the actuators' part of `read_names`."""
        read, head = self.read, self.head
        assert read.bias is not None
        assert head.bias is not None
        return [part[0] for part in (read.weight, read.bias, actuator_names, head.weight, head.bias)]

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
        """Value actions in [-1, 1] at normalized observation rows, by the first `members` critics."""
        slots = layout.observation_and_action
        limbs = self.encoder(torch.cat([obs, action], -1), self.encoder.read_names(slots, layout, members))
        pooled = torch.matmul(layout.robot_limbs, F.layer_norm(limbs.float(), limbs.shape[-1:]))
        members, batch, robots, width = pooled.shape
        hidden = F.relu(self.hidden(pooled.reshape(members, -1, width)))
        return self.head(hidden).view(members, batch, robots)


def check_robot(spec: TokenSpec, settings: LimbFormerSettings, vocabulary: Vocabulary | None = None) -> None:
    """Limb-Former expresses every robot."""


def build(settings: LimbFormerSettings, embedding_size: int, vocabulary: Vocabulary) -> tuple[Actor, TwinCritic]:
    """Actor and twin critics."""
    sizes = {
        "d_model": settings.d_model,
        "layers": settings.layers,
        "heads": settings.heads,
        "feedforward": settings.feedforward,
    }
    return Actor(embedding_size, **sizes), TwinCritic(embedding_size, **sizes)


METHOD = Method(
    name="limb-former",
    summary="transformer over limbs whose weights follow from names",
    actions="actuators",
    settings=LimbFormerSettings,
    build=build,
    check=check_robot,
    reads_names="both",
    preset="default",
    label="Limb-Former",
    color="#0072B2",
)
