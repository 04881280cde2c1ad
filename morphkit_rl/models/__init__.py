"""Policies and critics over many morphologies, by name of the method.

A method is a module with its settings, its networks and a `METHOD`, a `config.methods.Method`.

- `actor(obs, layout, names=None)`: (batch, tokens) -> (batch, actions) in [-1, 1]. `actor.read_names(layout)` does what
  depends on the names alone, for callers whose weights stay.
- `critic(obs, action, layout, members=2)`: -> (members, batch, values), of the first `members` of the twin critics;
  `critic.value_robot(layout)` says which robot each value is of.
- `last_layers` of both: prefixes of the parameters that `td3.reset_updates` draws anew.
- A submodule's attribute `precision` is what its matrix products compute in.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from morphkit_rl.config.methods import ModelSettings, find_method

if TYPE_CHECKING:
    from collections.abc import Callable

    from torch import nn

    from morphkit_rl.models.vocabulary import Vocabulary

    Tuner = Callable[[], nn.Module]


def build(
    settings: ModelSettings, embedding_size: int, vocabulary: Vocabulary | None = None, tune: Tuner | None = None
) -> tuple[Any, Any]:
    """Make the actor and the twin critics of a method, freshly initialized from torch's random generator.

    Args:
        settings: Method and sizes.
        embedding_size: Size of a token's text embedding.
        vocabulary: What is known of the training robots; Limb-Former needs nothing.
        tune: Makes a network's own embeddings (`morphkit_rl.text.tuning`); None: the layout's frozen ones.

    Raises:
        ConfigError: There is no such method, or a size is impossible.
    """
    from morphkit_rl.models.tuned_embeddings import TunedActor, TunedCritic
    from morphkit_rl.models.vocabulary import Vocabulary

    method = find_method(settings.method)
    actor, critic = method.build(settings, embedding_size, vocabulary or Vocabulary())
    if tune is None or method.reads_names == "none":
        return actor, critic
    return TunedActor(actor, tune()), TunedCritic(critic, tune()) if method.reads_names == "both" else critic


def load_published(
    method: str,
    tensors: Mapping[str, Any],
    limbs: Sequence[str],
    parents: Sequence[int],
    num_heads: int = 2,
) -> tuple[Any, Any]:
    """Actor and twin critics from weights of the published programs; see `morphkit_rl.models.published.load`."""
    from morphkit_rl.models.published import load

    return load.load_published(method, tensors, limbs, parents, num_heads)
