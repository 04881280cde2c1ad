"""Policies and critics over many morphologies, by name."""

from __future__ import annotations

from typing import TYPE_CHECKING

from morphkit.errors import ConfigError

if TYPE_CHECKING:
    from morphkit_rl.config import ModelConfig
    from morphkit_rl.models.limb_former import Actor, TwinCritic

METHODS = ("limb-former",)


def build(config: ModelConfig, embedding_size: int) -> tuple[Actor, TwinCritic]:
    """Make the actor and the twin critics of `config.method`, freshly initialised from torch's random generator.

    Raises:
        ConfigError: There is no such method.
    """
    if config.method not in METHODS:
        raise ConfigError(f"unknown method {config.method!r}; there is {', '.join(METHODS)}")
    from morphkit_rl.models.limb_former import Actor, TwinCritic

    sizes = {
        "d_model": config.d_model,
        "layers": config.layers,
        "heads": config.heads,
        "feedforward": config.feedforward,
    }
    return Actor(embedding_size, **sizes), TwinCritic(embedding_size, **sizes)
