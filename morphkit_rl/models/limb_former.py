"""Limb-Former: name-conditioned limb tokens and a small transformer over the limbs.

With `e(name)` the frozen embedding of a token's name, limb l of a robot becomes

    t_l = LayerNorm( sum over its scalars i of  v_i * P e(name_i)  +  Q mean_i e(name_i) ),

so that a scalar costs one vector, not one token. Transformer layers then mix the limbs of each robot, and

    a_k = tanh( w . relu( V t_limb(k) + U e(name_k) ) )

is the action of actuator k. A critic reads each action as one more named scalar of the limb that it drives, and
averages over the limbs before its head.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from morphkit_rl.models.blocks import MemberLinear, TransformerLayer
from morphkit_rl.models.layout import FOREIGN, Layout, Slots


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

    def forward(self, row: Tensor, slots: Slots, layout: Layout) -> Tensor:
        """Encode rows of scalars.

        Args:
            row: (batch, width) scalars of all robots side by side.
            slots: Which limb reads which column.
            layout: The robots.

        Returns:
            (members, batch, limbs, d_model).
        """
        limbs, width = slots.column.shape
        embeddings = layout.embeddings.expand(self.value.weight.shape[0], -1, -1)
        weights = self.value(embeddings)[:, slots.text] * slots.mask
        values = F.pad(row, (0, 1))[:, slots.column].transpose(0, 1)
        members, d_model = weights.shape[0], weights.shape[-1]
        stacked = weights.permute(1, 2, 0, 3).reshape(limbs, width, members * d_model)
        tokens = torch.bmm(values, stacked).view(limbs, -1, members, d_model).permute(2, 1, 0, 3)
        names = self.name(layout.limb_embeddings.expand(members, -1, -1))
        x = F.layer_norm(tokens + names.unsqueeze(1), (d_model,)).to(self.precision)
        bias = self.attention_bias(layout).to(self.precision)
        for layer in self.layers:
            x = layer(x, bias)
        return F.layer_norm(x.float(), (d_model,))

    def attention_bias(self, layout: Layout) -> Tensor:
        """(members, 1, heads, limbs, limbs) learned bias by kinship; -inf between robots."""
        bias = F.pad(self.relation_bias, (0, 1), value=float("-inf"))
        return bias[..., layout.relation].unsqueeze(1)


class Actor(nn.Module):
    """Deterministic policy: (batch, tokens) -> (batch, actuators) in [-1, 1]."""

    def __init__(self, embedding_size: int, *, d_model: int, layers: int, heads: int, feedforward: int):
        super().__init__()
        self.encoder = LimbEncoder(1, embedding_size, d_model, layers, heads, feedforward)
        self.read = MemberLinear(1, d_model, d_model)
        self.name = MemberLinear(1, embedding_size, d_model, bias=False)
        self.head = MemberLinear(1, d_model, 1, gain=0.1)

    def forward(self, obs: Tensor, layout: Layout) -> Tensor:
        """Act on normalised observation rows."""
        limbs = self.encoder(obs, layout.observation, layout)[0]
        if len(layout.actuator_limb) == 0:
            return obs.new_zeros(len(obs), 0)
        means = torch.matmul(layout.robot_limbs, limbs)[:, layout.actuator_robot]
        without_limb = (layout.actuator_limb == limbs.shape[1])[:, None]
        own = F.pad(limbs, (0, 0, 0, 1))[:, layout.actuator_limb]
        x = torch.where(without_limb, means, own)
        names = self.name(layout.embeddings[layout.actuator_text][None])
        hidden = F.relu(self.read(x.reshape(1, -1, x.shape[-1])).view(x.shape) + names)
        return torch.tanh(self.head(hidden.view(1, -1, x.shape[-1])).view(x.shape[:2]))


class TwinCritic(nn.Module):
    """Two action values in one module: (batch, tokens), (batch, actuators) -> (2, batch, robots)."""

    def __init__(self, embedding_size: int, *, d_model: int, layers: int, heads: int, feedforward: int):
        super().__init__()
        self.encoder = LimbEncoder(2, embedding_size, d_model, layers, heads, feedforward)
        self.hidden = MemberLinear(2, d_model, 2 * d_model)
        self.head = MemberLinear(2, 2 * d_model, 1)

    def forward(self, obs: Tensor, action: Tensor, layout: Layout) -> Tensor:
        """Value actions in [-1, 1] at normalised observation rows."""
        limbs = self.encoder(torch.cat([obs, action], -1), layout.observation_and_action, layout)
        pooled = torch.matmul(layout.robot_limbs, limbs)
        members, batch, robots, width = pooled.shape
        hidden = F.relu(self.hidden(pooled.reshape(members, -1, width)))
        return self.head(hidden).view(members, batch, robots)
