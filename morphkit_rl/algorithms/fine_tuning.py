"""Training that goes on from a policy, on its bodies or on others: what is taken over from it, and what must fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
from torch import nn

from morphkit.errors import ConfigError
from morphkit_rl.algorithms.policy import Policy
from morphkit_rl.config.parsing import override
from morphkit_rl.config.train_config import TrainConfig, load_config
from morphkit_rl.models.anymorph import LearnedTokens
from morphkit_rl.models.vocabulary import Vocabulary, places
from morphkit_rl.runs import run_settings, saved_policy
from morphkit_rl.runs.saved_policy import SavedPolicy
from morphkit_rl.runs.trusted_encoder import with_encoder

DEFAULTS = ("learner.actor_start=1000",)
"""Settings of training that goes on: young critics would lead an actor astray that is good already."""
_KEPT = ("observation", "sensors", "normalize")


def start_config(
    start: str | Path, preset: str | Path | None = None, overrides: Sequence[str] = (), *, encoder: str | None = None
) -> TrainConfig:
    """Settings for going on from a policy: its own with `DEFAULTS`, and single ones changed.

    Args:
        start: What to go on from, as `Policy.load` takes it.
        preset: Where to take those settings from that may differ; default: the policy's.
        overrides: Settings such as `td3.tau=0.01`.
        encoder: Text encoder in place of the policy's own; see `Policy.load`.

    Raises:
        CheckpointError: There is no such policy, or it is damaged.
        ConfigError: A setting does not exist or has an impossible value, or the text encoder needs trust.
    """
    policy = saved_policy.load(start)
    own = with_encoder(run_settings.train_config(policy.folder, policy.settings), policy.folder, encoder)
    values = (own if preset is None else _fit(load_config(preset), own)).to_dict()
    for text in (*DEFAULTS, *overrides):
        override(values, text)
    return TrainConfig.from_dict(values, origin=f"settings for {start}")


def load_start(start: SavedPolicy, config: TrainConfig) -> Policy:
    """The policy that training with `config` begins with.

    Raises:
        ConfigError: Settings do not fit it: the network, its texts or its observations would be others; or its
            embeddings learn with it, which cannot go on with other texts.
    """
    own = run_settings.train_config(start.folder, start.settings)
    own = replace(own, text=replace(own.text, encoder=config.text.encoder))
    if own.text.tune != "frozen" or own.text.control != "none":
        raise ConfigError("training goes on from policies with frozen text embeddings alone (text.tune, text.control)")
    fitted = _fit(config, own)
    for section in ("model", "text", "trainer"):
        asked, needed = getattr(config, section), getattr(fitted, section)
        names = [field.name for field in fields(needed)] if type(asked) is type(needed) else ["method"]
        for name in names:
            if getattr(asked, name) != getattr(needed, name):
                raise ConfigError(
                    f"{section}.{name} is {getattr(asked, name)!r}, but the policy that training begins with was made "
                    f"with {getattr(needed, name)!r}"
                )
    return Policy.of(start, own)


def _fit(config: TrainConfig, own: TrainConfig) -> TrainConfig:
    """Settings with those of `own` where networks, texts and observations depend on them."""
    trainer = replace(config.trainer, **{name: getattr(own.trainer, name) for name in _KEPT})
    return replace(config, text=own.text, model=own.model, trainer=trainer)


def join_vocabulary(own: Vocabulary, policy: Policy) -> Vocabulary:
    """The vocabulary of the training robots with the names that the policy knows besides."""
    known = policy.vocabulary or Vocabulary()
    texts = tuple(sorted({*own.texts, *known.texts}))
    return replace(
        own,
        sensors=tuple(sorted({*own.sensors, *known.sensors})),
        actions=tuple(sorted({*own.actions, *known.actions})),
        texts=texts,
        scalars=max(own.scalars, known.scalars),
        children=max(own.children, known.children),
        quantities=tuple(sorted({*own.quantities, *known.quantities})),
        bodies=places([*own.texts_of_bodies(), *known.texts_of_bodies()], texts),
    )


def take_over(actor: nn.Module, known: nn.Module) -> None:
    """Give an actor the weights of a known one of the same method and sizes, whose vocabulary may be smaller.

    Names that it did not know begin where it reads them: at zeros.
    """
    weights = known.state_dict()
    for (name, own), other in zip(actor.named_modules(), known.modules(), strict=True):
        if isinstance(own, LearnedTokens) and isinstance(other, LearnedTokens):
            for part in ("sensors", "actions"):
                key = f"{name}.{part}"
                weights[key] = own.rows_of(part, other).to(weights[key])
    actor.load_state_dict(weights)


def take_over_statistics(policy: Policy) -> tuple[list[str], dict[str, np.ndarray]]:
    """Quantities and statistics of the policy's observations, as copies."""
    return list(policy.normalizer.keys), {k: array.copy() for k, array in policy.normalizer.state_dict().items()}
