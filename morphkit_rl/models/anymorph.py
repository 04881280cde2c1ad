"""AnyMorph: tokens are named by an embedding that is learned for each name (Trabucco, Phielipp, Berseth 2022).

The actor is a `token_transformer`, the critics are those of Amorpheus.
"""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from morphkit.tokens.spec import TokenSpec
from morphkit_rl.config.methods import Method
from morphkit_rl.config.parsing import bounded
from morphkit_rl.models.amorpheus import TwinCritic
from morphkit_rl.models.layout import Layout
from morphkit_rl.models.limb_checks import check_limbs
from morphkit_rl.models.token_transformer import Actor, TokenTransformerSettings, check_code
from morphkit_rl.models.vocabulary import Vocabulary


@dataclass(frozen=True, slots=True)
class AnyMorphSettings(TokenTransformerSettings):
    """Sizes of actor and critics.

    Attributes:
        token_size: Size of a learned embedding.
    """

    method: str = "anymorph"
    token_size: int = bounded(32, at_least=1)


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

    def rows_of(self, part: str, other: LearnedTokens) -> Tensor:
        """Embeddings of `other` for the names of this vocabulary; zeros for names that it lacks.

        Args:
            part: `sensors` or `actions`.
            other: Embeddings of another vocabulary.
        """
        row = {name: number for number, name in enumerate(getattr(other.vocabulary, part))}
        rows = torch.tensor([row.get(name, len(row)) for name in getattr(self.vocabulary, part)], dtype=torch.long)
        return F.pad(getattr(other, part).detach(), (0, 0, 0, 1))[rows]


def _rows(names: list[str] | tuple[str, ...], known: tuple[str, ...], layout: Layout) -> Tensor:
    row = {name: number for number, name in enumerate(known)}
    return torch.tensor([row.get(name, len(known)) for name in names], device=layout.relation.device)


def check_robot(spec: TokenSpec, settings: AnyMorphSettings, vocabulary: Vocabulary | None = None) -> None:
    """Raise ConfigError where the robot's limbs are not alike, which the critics need."""
    check_limbs(settings.method, spec, vocabulary)


def build(settings: AnyMorphSettings, embedding_size: int, vocabulary: Vocabulary) -> tuple[Actor, TwinCritic]:
    """Actor and twin critics; text embeddings are not read."""
    check_code(settings, settings.token_size)
    tokens = LearnedTokens(vocabulary, settings.token_size)
    return Actor(tokens, settings.token_size, settings), TwinCritic(vocabulary.scalars, settings)


METHOD = Method(
    name="anymorph",
    summary="transformer over scalars with learned embeddings of their names",
    actions="limbs",
    settings=AnyMorphSettings,
    build=build,
    check=check_robot,
    preset="anymorph-paper",
    label="AnyMorph",
    color="#009E73",
)
