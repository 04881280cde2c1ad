"""Building blocks whose parameters have a leading member axis: twin critics are one module with two members."""

from __future__ import annotations

import math
from functools import cached_property

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from morphkit.errors import ConfigError
from morphkit_rl.kernels.limb_layer import Kinship, available, limb_layer


class MemberLinear(nn.Module):
    """One affine map a member: (members, rows, inputs) -> (members, rows, outputs).

    Weights start like those of `nn.Linear`, biases at zero. Fewer members in than there are: the first ones map them.
    """

    def __init__(self, members: int, inputs: int, outputs: int, *, bias: bool = True, gain: float = 1.0):
        super().__init__()
        bound = gain / math.sqrt(inputs)
        self.weight = nn.Parameter(torch.empty(members, inputs, outputs).uniform_(-bound, bound))
        self.bias = nn.Parameter(torch.zeros(members, 1, outputs)) if bias else None

    def forward(self, x: Tensor) -> Tensor:
        """Map each member's rows, in the precision of `x`."""
        members = x.shape[0]  # len(x) takes PyTorch several times as long
        return affine(x, first(self.weight, members), None if self.bias is None else first(self.bias, members))

    def draw(self, weight: float | None = None, bias: float | None = None) -> MemberLinear:
        """Redraw weights from [-weight, weight], biases from [-bias, bias]; None: 1 / sqrt(inputs), as `nn.Linear`."""
        default = 1 / math.sqrt(self.weight.shape[1])
        for parameter, bound in ((self.weight, weight), (self.bias, bias)):
            if parameter is not None:
                bound = default if bound is None else bound
                nn.init.uniform_(parameter, -bound, bound)
        return self


def affine(x: Tensor, weight: Tensor, bias: Tensor | None) -> Tensor:
    """x W + b for each member, in the precision of `x`."""
    weight = weight.to(x.dtype)
    if bias is None:
        return torch.bmm(x, weight)
    if x.dtype == torch.bfloat16:  # A bias inside the product costs more than one added to it.
        return torch.bmm(x, weight).add_(bias.to(x.dtype))
    return torch.baddbmm(bias.to(x.dtype), x, weight)


def first(parameter: Tensor, members: int) -> Tensor:
    """Parameter of the first `members` members."""
    return parameter if parameter.shape[0] == members else parameter[:members]


class TransformerLayer(nn.Module):
    """Pre-norm transformer layer over the limbs (Vaswani et al. 2017; Xiong et al. 2020).

    Layer norms carry no scale and shift of their own: each is followed by an affine map that can express them.
    """

    def __init__(self, members: int, d_model: int, heads: int, feedforward: int):
        super().__init__()
        check_heads(d_model, heads)
        self.heads = heads
        self.qkv = MemberLinear(members, d_model, 3 * d_model)
        self.out = MemberLinear(members, d_model, d_model)
        self.expand = MemberLinear(members, d_model, feedforward)
        self.contract = MemberLinear(members, feedforward, d_model)

    def forward(self, x: Tensor, bias: Tensor) -> Tensor:
        """Mix limbs.

        Args:
            x: (members, batch, limbs, d_model).
            bias: (members, 1, heads, limbs, limbs) added to the attention logits; -inf where limb i must not see j.
        """
        members, batch, limbs, width = x.shape
        rows = (members, batch * limbs, width)
        normed = F.layer_norm(x, (width,)).view(rows)
        qkv = self.qkv(normed).view(members, batch, limbs, 3, self.heads, width // self.heads)
        q, k, v = qkv.permute(3, 0, 1, 4, 2, 5)
        logits = torch.matmul(q * (width // self.heads) ** -0.5, k.transpose(-1, -2)) + bias
        mixed = torch.matmul(torch.softmax(logits, -1), v)
        x = x + self.out(mixed.transpose(2, 3).reshape(rows)).view(x.shape)
        hidden = F.relu(self.expand(F.layer_norm(x, (width,)).view(rows)))
        return x + self.contract(hidden).view(x.shape)

    def suits_kernel(self, x: Tensor) -> bool:
        """Whether `mix_kin` can take `x`."""
        return available(x, self.heads, self.expand.weight.shape[-1])

    def mix_kin(self, x: Tensor, kinship: Kinship, relation_bias: Tensor) -> Tensor:
        """The same by the compiled kernel, with the bias (members, heads, kinds) of each kind of kinship."""
        return limb_layer(x, kinship, self.heads, [*self.map_parameters, relation_bias])

    @cached_property
    def map_parameters(self) -> list[Tensor]:
        """Weights and biases of all maps, in the order in which they follow each other."""
        parts = (self.qkv, self.out, self.expand, self.contract)
        return [parameter for part in parts for parameter in part.parameters()]


def check_heads(d_model: int, heads: int) -> None:
    """Raise ConfigError where a width does not divide into attention heads."""
    if heads < 1 or d_model % heads:
        raise ConfigError(f"d_model is {d_model}, which does not divide into {heads} attention heads")


def set_precision(network: nn.Module, precision: torch.dtype) -> None:
    """Let all modules that have a choice compute in `precision`."""
    for module in network.modules():
        if hasattr(module, "precision"):
            vars(module)["precision"] = precision
