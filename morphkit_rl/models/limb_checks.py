"""What the published methods ask of a robot: one action and the same number of scalars in each limb."""

from __future__ import annotations

import numpy as np

from morphkit.errors import ConfigError
from morphkit.tokens.spec import TokenSpec
from morphkit_rl.models.layout import parent_indices
from morphkit_rl.models.vocabulary import Vocabulary


def check_limbs(method: str, spec: TokenSpec, vocabulary: Vocabulary | None) -> None:
    """Check that limbs are alike.

    Args:
        method: Name of the method, for the message.
        spec: The robot.
        vocabulary: What the networks were made for; None before there are networks.

    Raises:
        ConfigError: An actuator drives no single limb, a limb has several actuators or another number of scalars.
    """
    where, hint = f"{spec.morphology}: method {method!r}", "limb-former can control this robot"
    limbs = [limb.name for limb in spec.limbs]
    actuators = np.bincount(spec.actuator_limb[spec.actuator_limb >= 0], minlength=len(limbs))
    for actuator in spec.actuators:
        if actuator.limb not in limbs:
            raise ConfigError(f"{where} acts by limb, but actuator {actuator.name!r} drives no single limb; {hint}")
    for limb, number in zip(limbs, actuators, strict=True):
        if number > 1:
            raise ConfigError(f"{where} gives each limb one action, but limb {limb!r} has {number} actuators; {hint}")
    scalars = np.bincount(spec.token_limb, minlength=len(limbs))
    expected = vocabulary.scalars if vocabulary else int(scalars[0])
    for limb, number in zip(limbs, scalars, strict=True):
        if number != expected:
            raise ConfigError(f"{where} takes {expected} scalars a limb, but limb {limb!r} has {number}; {hint}")
    if (spec.token_limb != np.repeat(np.arange(len(limbs)), expected)).any():
        raise ConfigError(f"{where} takes the scalars limb by limb, but the tokens are in another order")


def check_children(method: str, spec: TokenSpec, most: int) -> None:
    """Raise ConfigError where a limb has more children than `most`."""
    parents = parent_indices(spec)
    for number, limb in enumerate(spec.limbs):
        if parents.count(number) > most:
            raise ConfigError(
                f"{spec.morphology}: method {method!r} was made for at most {most} children a limb, "
                f"but limb {limb.name!r} has {parents.count(number)}; train it with a robot that has as many"
            )
