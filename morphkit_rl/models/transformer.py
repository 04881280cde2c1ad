"""Post-norm transformer layers (Vaswani et al. 2017), as PyTorch's `nn.Transformer` computes them, over many robots.

Tokens of all robots form one sequence without padding; robots are kept apart by attending within slices of it. Row-wise
parts run on the whole sequence at once. All shapes are (members, batch, tokens, d_model).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from morphkit_rl.kernels import cross_attention, encoder_layer, norm
from morphkit_rl.models.blocks import MemberLinear, affine, check_heads, first

Spans = Sequence[slice]


def on_cpu(x: Tensor) -> bool:
    """Whether to take the way that is quicker on CPUs; the other one runs anywhere."""
    return x.device.type == "cpu"


class Norm(nn.Module):
    """Layer norm with a scale and shift a member."""

    def __init__(self, members: int, width: int):
        super().__init__()
        self.weight = nn.Parameter(torch.ones(members, width))
        self.bias = nn.Parameter(torch.zeros(members, width))

    def forward(self, x: Tensor) -> Tensor:
        """Normalize the last axis; scale and shift stay float32 whatever `x` is."""
        if norm.available(x):
            return norm.norm(x, self.weight, self.bias)
        width = x.shape[-1:]
        weight, bias = (first(parameter, len(x)) for parameter in (self.weight, self.bias))
        if on_cpu(x):  # whose kernel takes float32 parameters with a bfloat16 input
            if len(x) == 1:
                return F.layer_norm(x, width, weight[0], bias[0])
            members = zip(x.unbind(), weight.unbind(), bias.unbind(), strict=True)
            return torch.stack([F.layer_norm(own, width, w, b) for own, w, b in members])
        shape = (len(x), *[1] * (x.dim() - 2), *width)
        return torch.addcmul(bias.view(shape), F.layer_norm(x, width), weight.view(shape)).to(x.dtype)


class FeedForward(nn.Module):
    """x + W2 relu(W1 x + b1) + b2."""

    def __init__(self, members: int, d_model: int, feedforward: int):
        super().__init__()
        self.expand = MemberLinear(members, d_model, feedforward).draw()
        self.contract = MemberLinear(members, feedforward, d_model).draw()

    def forward(self, x: Tensor) -> Tensor:
        """Map every token by itself."""
        rows = x.reshape(len(x), -1, x.shape[-1])
        return self.contract(torch.relu_(self.expand(rows))).add_(rows).view(x.shape)


class SelfAttention(nn.Module):
    """x + multi-head attention among the tokens of each robot: softmax(q k^T / sqrt(d_head)) v."""

    def __init__(self, members: int, d_model: int, heads: int):
        super().__init__()
        check_heads(d_model, heads)
        self.heads = heads
        self.qkv = MemberLinear(members, d_model, 3 * d_model).draw(math.sqrt(1.5 / d_model), 0)
        self.out = MemberLinear(members, d_model, d_model).draw(None, 0)
        scale = torch.cat([torch.full((d_model,), (d_model // heads) ** -0.5), torch.ones(2 * d_model)])
        self.scale: Tensor
        self.register_buffer("scale", scale, persistent=False)  # Of queries; cheaper on the weights than on them.

    def forward(self, x: Tensor, spans: Spans) -> Tensor:
        """Mix the tokens within each of `spans`."""
        members, batch, tokens, width = x.shape
        rows = (members, batch * tokens, width)
        assert self.qkv.bias is not None
        weight, bias = (first(p, members) * self.scale for p in (self.qkv.weight, self.qkv.bias))
        own = x.reshape(rows)
        qkv = affine(own, weight, bias).view(members, batch, tokens, 3, self.heads, width // self.heads)
        q, k, v = qkv.permute(3, 0, 1, 4, 2, 5)
        parts = [attend(q[..., s, :], k[..., s, :], v[..., s, :]) for s in spans]
        mixed = parts[0] if len(parts) == 1 else torch.cat(parts, -2)
        return self.out(mixed.transpose(2, 3).reshape(rows)).add_(own).view(x.shape)


def attend(q: Tensor, k: Tensor, v: Tensor) -> Tensor:
    """softmax(q k^T) v over (members, batch, heads, tokens, d_head); the queries are scaled already.

    Written out in low precision on CPUs, where PyTorch's fused kernel takes several times as long.
    """
    if on_cpu(q) and q.dtype == torch.bfloat16:
        return torch.matmul(torch.softmax(torch.matmul(q, k.transpose(-1, -2)), -1), v)
    shape = q.shape
    q, k, v = (x.flatten(0, 1) for x in (q, k, v))
    return F.scaled_dot_product_attention(q, k, v, scale=1.0).view(shape)


class CrossAttention(nn.Module):
    """x + attention of few queries x to many memory tokens, whose keys and values are never formed.

    Queries are carried to the memory's space instead: q . (W_k m) = (W_k^T q) . m, and sum_j p_j (W_v m_j) =
    W_v sum_j p_j m_j. A bias of the keys would add the same to all logits of a query, which softmax ignores.
    """

    def __init__(self, d_model: int, heads: int):
        super().__init__()
        self.heads = heads
        bound = math.sqrt(1.5 / d_model)
        self.query = MemberLinear(1, d_model, d_model).draw(bound, 0)
        self.key = MemberLinear(1, d_model, d_model, bias=False).draw(bound)
        self.value = MemberLinear(1, d_model, d_model).draw(bound, 0)
        self.out = MemberLinear(1, d_model, d_model).draw(None, 0)

    def forward(self, x: Tensor, memory: Tensor, spans: Spans, memory_spans: Spans) -> Tensor:
        """Read memory (1, batch, tokens, d_model) into queries (1, batch or 1, queries, d_model), robot by robot."""
        _, own, queries, width = x.shape
        memory = memory[0]
        heads, size, batch = self.heads, width // self.heads, memory.shape[0]
        key, value = (
            w.weight[0].to(x.dtype).view(width, heads, size).transpose(0, 1) for w in (self.key, self.value)
        )  # (heads, d_model, size)
        q = self.query(x.reshape(1, -1, width)).view(-1, heads, size).transpose(0, 1) * size**-0.5
        probes = torch.bmm(q, key.transpose(1, 2)).view(heads, own, queries, width).transpose(0, 1)
        probes = probes.expand(batch, -1, -1, -1)
        read = read_tokens(probes, memory, spans, memory_spans).transpose(0, 1).reshape(heads, batch * queries, width)
        assert self.value.bias is not None
        mixed = torch.bmm(read, value).transpose(0, 1).reshape(1, -1, width) + self.value.bias.to(x.dtype)
        return x + self.out(mixed).view(1, batch, queries, width)


def read_tokens(probes: Tensor, memory: Tensor, spans: Spans, memory_spans: Spans) -> Tensor:
    """softmax(p m^T) m, robot by robot, of p (batch, heads, queries, d_model) and m (batch, tokens, d_model)."""
    if cross_attention.available(probes, memory, spans, memory_spans):
        return cross_attention.read(probes, memory, spans, memory_spans)
    batch, heads, _, width = probes.shape
    parts = []
    for span, memory_span in zip(spans, memory_spans, strict=True):
        tokens = memory[:, memory_span]
        probe = probes[:, :, span].reshape(batch, -1, width)
        weights = torch.softmax(torch.bmm(probe, tokens.transpose(1, 2)), -1)
        parts.append(torch.bmm(weights, tokens).view(batch, heads, -1, width))
    return torch.cat(parts, 2)


class EncoderLayer(nn.Module):
    """x = norm(attention(x)); x = norm(feedforward(x)), each with its residual."""

    def __init__(self, members: int, d_model: int, heads: int, feedforward: int):
        super().__init__()
        self.attention = SelfAttention(members, d_model, heads)
        self.norm1, self.norm2 = Norm(members, d_model), Norm(members, d_model)
        self.feedforward = FeedForward(members, d_model, feedforward)

    def forward(self, x: Tensor, spans: Spans) -> Tensor:
        """Mix and map the tokens of each robot."""
        attention, feedforward = self.attention, self.feedforward
        if encoder_layer.available(x, spans, attention.heads, feedforward.expand.weight.shape[-1]):
            parts = (attention.qkv, attention.out, feedforward.expand, feedforward.contract, self.norm1, self.norm2)
            parameters = [parameter for part in parts for parameter in part.parameters()]
            return encoder_layer.encoder_layer(x, spans, attention.heads, parameters)
        x = self.norm1(self.attention(x, spans))
        return self.norm2(self.feedforward(x))


class Encoder(nn.Module):
    """Encoder layers and a final norm."""

    def __init__(self, members: int, d_model: int, layers: int, heads: int, feedforward: int):
        super().__init__()
        self.layers = nn.ModuleList(EncoderLayer(members, d_model, heads, feedforward) for _ in range(layers))
        self.norm = Norm(members, d_model)

    def forward(self, x: Tensor, spans: Spans) -> Tensor:
        """Encode tokens, in the precision of `x`."""
        for layer in self.layers:
            x = layer(x, spans)
        return self.norm(x)


class DecoderLayer(nn.Module):
    """x = norm(attention(x)); x = norm(cross(x, memory)); x = norm(feedforward(x)), each with its residual."""

    def __init__(self, d_model: int, heads: int, feedforward: int):
        super().__init__()
        self.attention = SelfAttention(1, d_model, heads)
        self.cross = CrossAttention(d_model, heads)
        self.norm1, self.norm2, self.norm3 = Norm(1, d_model), Norm(1, d_model), Norm(1, d_model)
        self.feedforward = FeedForward(1, d_model, feedforward)

    def mix(self, x: Tensor, spans: Spans) -> Tensor:
        """First of the three parts, which does not need the memory."""
        return self.norm1(self.attention(x, spans))

    def forward(self, x: Tensor, memory: Tensor, spans: Spans, memory_spans: Spans) -> Tensor:
        """The other two parts, on what `mix` gave."""
        x = self.norm2(self.cross(x, memory, spans, memory_spans))
        return self.norm3(self.feedforward(x))


class Decoder(nn.Module):
    """Decoder layers without causal mask, and a final norm."""

    def __init__(self, d_model: int, layers: int, heads: int, feedforward: int):
        super().__init__()
        self.layers = nn.ModuleList(DecoderLayer(d_model, heads, feedforward) for _ in range(layers))
        self.norm = Norm(1, d_model)

    def mix(self, queries: Tensor, spans: Spans) -> Tensor:
        """What the first layer does before it looks at the memory: the same for a whole batch of equal queries."""
        layer: DecoderLayer = self.layers[0]  # type: ignore[assignment]
        return layer.mix(queries, spans)

    def forward(self, mixed: Tensor, memory: Tensor, spans: Spans, memory_spans: Spans) -> Tensor:
        """Decode `mixed`, from `mix`, (1, 1, queries, d_model) into (1, batch, queries, d_model)."""
        x = mixed
        for number, layer in enumerate(self.layers):
            assert isinstance(layer, DecoderLayer)
            if number:
                x = layer.mix(x, spans)
            x = layer(x, memory, spans, memory_spans)
        return self.norm(x)
