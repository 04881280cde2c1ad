"""One token a scalar, one query a limb: the transformer of MA-BERT and AnyMorph, which differ in how tokens are named.

With e_i the embedding of scalar i, v_i its value, and q_l the embedding of limb l's action,

    f(v) = sqrt(2) [ sin(1000 v w_j) ; cos(1000 v w_j) ]_j     w_j = 10000^(-2j/k), j = 0 .. k/2 - 1
    x_i  = norm( W [e_i ; f(v_i)] + b )                         `combine = "add"`: W (e_i + f(v_i)) + b, k = size of e_i
    y_l  = decoder( norm(U q_l + c), encoder(x) )               post-norm, no masks, final norms
    a_l  = tanh( w . [q_l ; y_l] + d )

`model.hidden` puts one more layer between W and the norm: norm( H relu( W [..] + b ) + g ).

Embeddings are the same for a whole batch, so they never travel through it: W [e ; f] = W_e e + W_f f, the first term
once an update. Likewise the first decoder layer's attention among the queries, and the head's part of q.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from morphkit.errors import ConfigError
from morphkit_rl.config.parsing import bounded
from morphkit_rl.models.amorpheus import INITIAL_RANGE, AmorpheusSettings
from morphkit_rl.models.blocks import MemberLinear
from morphkit_rl.models.layout import Layout
from morphkit_rl.models.transformer import Decoder, Encoder, Norm

VALUE_SCALE = 1000.0


def frequency_code(values: Tensor, size: int, dtype: torch.dtype = torch.float32) -> Tensor:
    """Sines, then cosines, of 1000 * value at size / 2 frequencies (..., size); angles are float32, the code `dtype`.

    The factor of sqrt(2) is left to the weights that read the code.
    """
    exponents = torch.arange(0, size, 2, device=values.device, dtype=torch.float32)
    frequencies = torch.exp(exponents * (-math.log(10000.0) / size))
    angles = (VALUE_SCALE * values.float())[..., None] * frequencies
    return torch.cat([torch.sin(angles).to(dtype), torch.cos(angles).to(dtype)], -1)


@dataclass(frozen=True, slots=True)
class TokenTransformerSettings(AmorpheusSettings):
    """Sizes of the actor, and of the critics, which are those of Amorpheus.

    Attributes:
        code_size: Size of the frequency code of a value; even.
        combine: Whether a token's embedding and frequency code are concatenated or added.
        hidden: Whether one more hidden layer is before the transformer.
    """

    method: str = "ma-bert"
    code_size: int = bounded(96, at_least=1)
    combine: Literal["concat", "add"] = "concat"
    hidden: bool = False


def check_code(settings: TokenTransformerSettings, embedding_size: int) -> None:
    """Raise ConfigError where the frequency code could not have as many sines as cosines."""
    if (embedding_size if settings.combine == "add" else settings.code_size) % 2:
        raise ConfigError(f"method {settings.method!r}: a frequency code has as many sines as cosines, so an even size")


@dataclass(frozen=True)
class Names:
    """What an actor makes of a layout's names alone; the same for every row of values.

    Attributes:
        tokens: (tokens, d_model) part of the observation's tokens that does not depend on values.
        queries: (1, 1, actions, d_model) queries as the first decoder layer's own attention leaves them.
        head: (actions,) part of the head that does not depend on values.
    """

    tokens: Tensor
    queries: Tensor
    head: Tensor


class Actor(nn.Module):
    """(batch, tokens) -> (batch, limbs) in [-1, 1].

    Args:
        tokens: Layout to embeddings of tokens and actions.
        size: Size of an embedding.
        settings: Sizes.

    Attributes:
        precision: What the transformer computes in.
    """

    def __init__(self, tokens: nn.Module, size: int, settings: TokenTransformerSettings):
        super().__init__()
        d_model = settings.d_model
        sizes = (d_model, settings.layers, settings.heads, settings.feedforward)
        self.precision = torch.float32
        self.last_layers = (f"decoder.layers.{settings.layers - 1}.", "decoder.norm.", "head.", "head_name.")
        self.tokens = tokens
        adds = settings.combine == "add"
        self.code_size = size if adds else settings.code_size
        bias = 1 / math.sqrt(size if adds else size + settings.code_size)
        self.read_name = MemberLinear(1, size, d_model).draw(INITIAL_RANGE, bias)
        self.read_code = None if adds else MemberLinear(1, self.code_size, d_model, bias=False).draw(INITIAL_RANGE)
        self.hidden = MemberLinear(1, d_model, d_model).draw() if settings.hidden else None
        self.obs_norm, self.query_norm = Norm(1, d_model), Norm(1, d_model)
        self.read_query = MemberLinear(1, size, d_model).draw(INITIAL_RANGE, None)
        self.encoder, self.decoder = Encoder(1, *sizes), Decoder(*sizes)
        self.head_name = MemberLinear(1, size, 1).draw(INITIAL_RANGE, 0)
        self.head = MemberLinear(1, d_model, 1, bias=False).draw(INITIAL_RANGE)
        for network in (self.encoder, self.decoder):
            for name, parameter in network.named_parameters():
                if name.endswith(("out.weight", "expand.weight", "contract.weight")):
                    nn.init.xavier_uniform_(parameter[0])

    def read_names(self, layout: Layout) -> Names:
        """Do what depends on the layout's names only."""
        tokens, actions = self.tokens(layout)
        queries = self.query_norm(self.read_query(actions[None])[:, None])
        return Names(
            self.read_name(tokens[None])[0],
            self.decoder.mix(queries, layout.actions),
            self.head_name(actions[None])[0, :, 0],
        )

    def forward(self, obs: Tensor, layout: Layout, names: Names | None = None) -> Tensor:
        """Act on observation rows; `names`, from `read_names`, saves time while the weights stay."""
        names = names or self.read_names(layout)
        code = frequency_code(obs, self.code_size, self.precision)
        weight = (self.read_name if self.read_code is None else self.read_code).weight[0] * (2 / math.sqrt(2))
        x = torch.matmul(code, weight.to(self.precision)).add_(names.tokens.to(self.precision))
        if self.hidden is not None:
            x = self.hidden(F.relu(x).view(1, -1, x.shape[-1])).view(x.shape)
        memory = self.encoder(self.obs_norm(x[None]), layout.tokens)
        y = self.decoder(names.queries.to(self.precision), memory, layout.actions, layout.tokens)[0]
        return torch.tanh(torch.matmul(y.to(names.head.dtype), self.head.weight[0, :, 0]) + names.head)
