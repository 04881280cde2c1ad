"""Policies and critics over many morphologies, by name of the method.

A method is a module with two functions: `build(config, embedding_size, vocabulary) -> (actor, critic)` and
`check(spec, config)`, which raises ConfigError where the method cannot express a robot.

- `actor(obs, layout, names=None)`: (batch, tokens) -> (batch, actions) in [-1, 1]. `actor.read_names(layout)` does what
  depends on the names alone, for callers whose weights stay.
- `critic(obs, action, layout)`: -> (2, batch, values); `critic.value_robot(layout)` says which robot each value is of.
- A submodule's attribute `precision` is what its matrix products compute in.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any

from morphkit.errors import ConfigError

if TYPE_CHECKING:
    from morphkit.tokens import TokenSpec
    from morphkit_rl.config import ModelConfig
    from morphkit_rl.models.layout import Actions
    from morphkit_rl.models.vocabulary import Vocabulary


@dataclass(frozen=True)
class Method:
    """A way to build policies.

    Attributes:
        name: Its name in `model.method`.
        summary: What it is, in a sentence.
        actions: Whether an action row has one column an actuator or one a limb.
        module: Module that implements it.
    """

    name: str
    summary: str
    actions: Actions
    module: str

    def check(self, spec: TokenSpec, config: ModelConfig) -> None:
        """Raise ConfigError where the method cannot express a robot."""
        self._module().check(spec, config)

    def build(self, config: ModelConfig, embedding_size: int, vocabulary: Vocabulary) -> tuple[Any, Any]:
        """Make actor and twin critics."""
        actor, critic = self._module().build(config, embedding_size, vocabulary)
        return actor, critic

    def _module(self) -> Any:
        return import_module(f"morphkit_rl.models.{self.module}")


METHODS: dict[str, Method] = {
    method.name: method
    for method in (
        Method("limb-former", "transformer over limbs whose weights follow from names", "actuators", "limb_former"),
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


def build(config: ModelConfig, embedding_size: int, vocabulary: Vocabulary | None = None) -> tuple[Any, Any]:
    """Make the actor and the twin critics of `config.method`, freshly initialised from torch's random generator.

    Args:
        config: Method and sizes.
        embedding_size: Size of a token's text embedding.
        vocabulary: What is known of the training robots; Limb-Former needs nothing.

    Raises:
        ConfigError: There is no such method.
    """
    from morphkit_rl.models.vocabulary import Vocabulary

    return find(config.method).build(config, embedding_size, vocabulary or Vocabulary())
