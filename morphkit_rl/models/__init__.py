"""Policies and critics over many morphologies, by name of the method.

A method is a module with two functions: `build(config, embedding_size, vocabulary) -> (actor, critic)` and
`check(spec, config, vocabulary=None)`, which raises ConfigError where the method cannot express a robot.

- `actor(obs, layout, names=None)`: (batch, tokens) -> (batch, actions) in [-1, 1]. `actor.read_names(layout)` does what
  depends on the names alone, for callers whose weights stay.
- `critic(obs, action, layout, members=2)`: -> (members, batch, values), of the first `members` of the twin critics;
  `critic.value_robot(layout)` says which robot each value is of.
- `last_layers` of both: prefixes of the parameters that `td3.reset_updates` draws anew.
- A submodule's attribute `precision` is what its matrix products compute in.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal

from morphkit.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Callable

    from torch import nn

    from morphkit.tokens.spec import TokenSpec
    from morphkit_rl.config.train_config import ModelConfig
    from morphkit_rl.models.layout import Actions
    from morphkit_rl.models.vocabulary import Vocabulary

    Tuner = Callable[[], nn.Module]


@dataclass(frozen=True)
class Method:
    """A way to build policies.

    Attributes:
        name: Its name in `model.method`.
        summary: What it is, in a sentence.
        actions: Whether an action row has one column an actuator or one a limb.
        module: Module that implements it.
        reads_names: Which of its networks read text embeddings.
    """

    name: str
    summary: str
    actions: Actions
    module: str
    reads_names: Literal["none", "actor", "both"] = "none"

    def check(self, spec: TokenSpec, config: ModelConfig, vocabulary: Vocabulary | None = None) -> None:
        """Raise ConfigError where the method, or networks made for `vocabulary`, cannot express a robot."""
        self._module().check(spec, config, vocabulary)

    def build(
        self, config: ModelConfig, embedding_size: int, vocabulary: Vocabulary, tune: Tuner | None = None
    ) -> tuple[Any, Any]:
        """Make actor and twin critics; `tune` as in `morphkit_rl.models.build`."""
        from morphkit_rl.models.tuned_embeddings import TunedActor, TunedCritic

        actor, critic = self._module().build(config, embedding_size, vocabulary)
        if tune is None or self.reads_names == "none":
            return actor, critic
        return TunedActor(actor, tune()), TunedCritic(critic, tune()) if self.reads_names == "both" else critic

    def _module(self) -> Any:
        return import_module(f"morphkit_rl.models.{self.module}")


METHODS: dict[str, Method] = {
    method.name: method
    for method in (
        Method(
            "limb-former", "transformer over limbs whose weights follow from names", "actuators", "limb_former", "both"
        ),
        Method("ma-bert", "transformer over scalars named by embeddings of texts", "limbs", "ma_bert", "actor"),
        Method("anymorph", "transformer over scalars with learned embeddings of their names", "limbs", "ma_bert"),
        Method("amorpheus", "transformer over limbs that knows neither names nor kinship", "limbs", "amorpheus"),
        Method("smp", "one module for all limbs, with messages along the tree", "limbs", "smp"),
    )
}


def find(name: str) -> Method:
    """The method of a name.

    Raises:
        ConfigError: There is no such method.
    """
    if name not in METHODS:
        raise ConfigError(f"unknown method {name!r}; there is {', '.join(METHODS)}")
    return METHODS[name]


def build(
    config: ModelConfig, embedding_size: int, vocabulary: Vocabulary | None = None, tune: Tuner | None = None
) -> tuple[Any, Any]:
    """Make the actor and the twin critics of `config.method`, freshly initialised from torch's random generator.

    Args:
        config: Method and sizes.
        embedding_size: Size of a token's text embedding.
        vocabulary: What is known of the training robots; Limb-Former needs nothing.
        tune: Makes a network's own embeddings (`morphkit_rl.text.tuning`); None: the layout's frozen ones.

    Raises:
        ConfigError: There is no such method.
    """
    from morphkit_rl.models.vocabulary import Vocabulary

    return find(config.method).build(config, embedding_size, vocabulary or Vocabulary(), tune)


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
