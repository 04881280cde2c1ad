"""MA-BERT and AnyMorph: one token a scalar, one query a limb.

MA-BERT names tokens by the frozen BERT embedding of their text (the study, chapters 4 and 5); AnyMorph learns an
embedding for each name (Trabucco, Phielipp, Berseth 2022). With e_i the embedding of scalar i, v_i its value, and q_l
the embedding of limb l's action,

    f(v) = sqrt(2) [ sin(1000 v w_j) ; cos(1000 v w_j) ]_j     w_j = 10000^(-2j/k), j = 0 .. k/2 - 1
    x_i  = norm( W [e_i ; f(v_i)] + b )                         `combine = "add"`: W (e_i + f(v_i)) + b, k = size of e_i
    y_l  = decoder( norm(U q_l + c), encoder(x) )               post-norm, no masks, final norms
    a_l  = tanh( w . [q_l ; y_l] + d )

`model.hidden` puts one more layer between W and the norm: norm( H relu( W [..] + b ) + g ). The critics are those of
Amorpheus.

Embeddings are the same for a whole batch, so they never travel through it: W [e ; f] = W_e e + W_f f, the first term
once an update. Likewise the first decoder layer's attention among the queries, and the head's part of q.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from morphkit.errors import ConfigError
from morphkit.tokens.spec import TokenSpec
from morphkit_rl.config.train_config import ModelConfig
from morphkit_rl.models.amorpheus import INITIAL_RANGE, TwinCritic
from morphkit_rl.models.blocks import MemberLinear
from morphkit_rl.models.layout import Layout
from morphkit_rl.models.limb_checks import check_limbs
from morphkit_rl.models.transformer import Decoder, Encoder, Norm
from morphkit_rl.models.vocabulary import Vocabulary

VALUE_SCALE = 1000.0


def frequency_code(values: Tensor, size: int, dtype: torch.dtype = torch.float32) -> Tensor:
    """Sines, then cosines, of 1000 * value at size / 2 frequencies (..., size); angles are float32, the code `dtype`.

    The factor of sqrt(2) is left to the weights that read the code.
    """
    exponents = torch.arange(0, size, 2, device=values.device, dtype=torch.float32)
    frequencies = torch.exp(exponents * (-math.log(10000.0) / size))
    angles = (VALUE_SCALE * values.float())[..., None] * frequencies
    return torch.cat([torch.sin(angles).to(dtype), torch.cos(angles).to(dtype)], -1)


class TextTokens(nn.Module):
    """Frozen text embeddings."""

    def forward(self, layout: Layout) -> tuple[Tensor, Tensor]:
        """Embeddings of the observation's tokens (tokens, size) and of the actions (actions, size)."""
        return layout.embeddings[layout.token_text], layout.embeddings[layout.action_text]


class LearnedTokens(nn.Module):
    """A learned embedding for each name in the vocabulary, shared by all robots; zeros for any other name."""

    def __init__(self, vocabulary: Vocabulary, size: int):
        super().__init__()
        self.vocabulary = vocabulary
        self.sensors = nn.Parameter(torch.randn(len(vocabulary.sensors), size))
        self.actions = nn.Parameter(torch.randn(len(vocabulary.actions), size))
        self._rows: WeakKeyDictionary[Layout, tuple[Tensor, Tensor]] = WeakKeyDictionary()

    def forward(self, layout: Layout) -> tuple[Tensor, Tensor]:
        """Embeddings of the observation's tokens (tokens, size) and of the actions (actions, size)."""
        if layout not in self._rows:
            names = [sensor.name for spec in layout.specs for sensor in spec.sensors]
            self._rows[layout] = (
                _rows(names, self.vocabulary.sensors, layout),
                _rows(layout.action_names, self.vocabulary.actions, layout),
            )
        sensors, actions = self._rows[layout]
        return F.pad(self.sensors, (0, 0, 0, 1))[sensors], F.pad(self.actions, (0, 0, 0, 1))[actions]


def _rows(names: list[str] | tuple[str, ...], known: tuple[str, ...], layout: Layout) -> Tensor:
    row = {name: number for number, name in enumerate(known)}
    return torch.tensor([row.get(name, len(known)) for name in names], device=layout.relation.device)


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
        config: Sizes.

    Attributes:
        precision: What the transformer computes in.
    """

    def __init__(self, tokens: nn.Module, size: int, config: ModelConfig):
        super().__init__()
        d_model = config.d_model
        sizes = (d_model, config.layers, config.heads, config.feedforward)
        self.precision = torch.float32
        self.last_layers = (f"decoder.layers.{config.layers - 1}.", "decoder.norm.", "head.", "head_name.")
        self.tokens = tokens
        adds = config.combine == "add"
        self.code_size = size if adds else config.code_size
        bias = 1 / math.sqrt(size if adds else size + config.code_size)
        self.read_name = MemberLinear(1, size, d_model).draw(INITIAL_RANGE, bias)
        self.read_code = None if adds else MemberLinear(1, self.code_size, d_model, bias=False).draw(INITIAL_RANGE)
        self.hidden = MemberLinear(1, d_model, d_model).draw() if config.hidden else None
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


def check(spec: TokenSpec, config: ModelConfig, vocabulary: Vocabulary | None = None) -> None:
    """Raise ConfigError where the robot's limbs are not alike, which the critics need, or a size makes no sense."""
    check_limbs(config.method, spec, vocabulary)


def build(config: ModelConfig, embedding_size: int, vocabulary: Vocabulary) -> tuple[Actor, TwinCritic]:
    """Actor and twin critics."""
    learned = config.method == "anymorph"
    size = config.token_size if learned else embedding_size
    if (size if config.combine == "add" else config.code_size) % 2:
        raise ConfigError(f"method {config.method!r}: a frequency code has as many sines as cosines, so an even size")
    tokens = LearnedTokens(vocabulary, size) if learned else TextTokens()
    return Actor(tokens, size, config), TwinCritic(vocabulary.scalars, config)
