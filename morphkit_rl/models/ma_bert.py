"""MA-BERT: tokens are named by the frozen BERT embedding of their text (the study, chapters 4 and 5).

The actor is a `token_transformer`, the critics are those of Amorpheus.
"""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor, nn

from morphkit.tokens.spec import TokenSpec
from morphkit_rl.config.methods import Method
from morphkit_rl.models.amorpheus import TwinCritic
from morphkit_rl.models.layout import Layout
from morphkit_rl.models.limb_checks import check_limbs
from morphkit_rl.models.token_transformer import Actor, TokenTransformerSettings, check_code
from morphkit_rl.models.vocabulary import Vocabulary


@dataclass(frozen=True, slots=True)
class MaBertSettings(TokenTransformerSettings):
    """Sizes of actor and critics."""

    method: str = "ma-bert"


class TextTokens(nn.Module):
    """Frozen text embeddings."""

    def forward(self, layout: Layout) -> tuple[Tensor, Tensor]:
        """Embeddings of the observation's tokens (tokens, size) and of the actions (actions, size)."""
        return layout.embeddings[layout.token_text], layout.embeddings[layout.action_text]


def check_robot(spec: TokenSpec, settings: MaBertSettings, vocabulary: Vocabulary | None = None) -> None:
    """Raise ConfigError where the robot's limbs are not alike, which the critics need."""
    check_limbs(settings.method, spec, vocabulary)


def build(settings: MaBertSettings, embedding_size: int, vocabulary: Vocabulary) -> tuple[Actor, TwinCritic]:
    """Actor and twin critics."""
    check_code(settings, embedding_size)
    return Actor(TextTokens(), embedding_size, settings), TwinCritic(vocabulary.scalars, settings)


METHOD = Method(
    name="ma-bert",
    summary="transformer over scalars named by embeddings of texts",
    actions="limbs",
    settings=MaBertSettings,
    build=build,
    check=check_robot,
    reads_names="actor",
    preset="ma-bert-paper",
    label="MA-BERT",
    color="#D55E00",
)
