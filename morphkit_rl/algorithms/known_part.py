"""The part of a robot that training knew by name: limbs that it never met rest, and the others act as if alone."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from morphkit.tokens.records import ActuatorToken, SensorToken, TokenLimb
from morphkit.tokens.spec import TokenSpec

_Token = TypeVar("_Token", SensorToken, ActuatorToken)


@dataclass(frozen=True, eq=False)
class KnownPart:
    """Some limbs of a robot.

    Attributes:
        whole: The robot.
        spec: Their tokens, as of a robot of its own.
        sensors: Where its sensors are among the robot's, int64.
        actuators: Where its actuators are among the robot's, int64.
        rests: Names of the limbs that are left out.
    """

    whole: TokenSpec
    spec: TokenSpec
    sensors: np.ndarray
    actuators: np.ndarray
    rests: tuple[str, ...]


def known_part(spec: TokenSpec, texts: Collection[str]) -> KnownPart | None:
    """Leave out the limbs none of whose tokens has a text of training.

    The root stays, and so does what belongs to no limb; children of a limb that is left out hang on its parent.

    Args:
        spec: The robot.
        texts: What training knew.

    Returns:
        None where nothing is left out, or no motor of a limb that training knew would be left: such a robot is foreign,
        and a policy can only act by how much its names are like others.
    """
    rests = _unknown(spec, set(texts))
    if not rests or all(actuator.limb in rests or actuator.limb is None for actuator in spec.actuators):
        return None
    parents = {limb.name: limb.parent for limb in spec.limbs}
    limbs = [replace(limb, parent=_kept_parent(limb, parents, rests)) for limb in spec.limbs if limb.name not in rests]
    sensors, actuators = _kept(spec.sensors, rests), _kept(spec.actuators, rests)
    part = replace(
        spec,
        limbs=tuple(limbs),
        sensors=_numbered([spec.sensors[i] for i in sensors]),
        actuators=_numbered([spec.actuators[i] for i in actuators]),
    )
    return KnownPart(spec, part, np.array(sensors), np.array(actuators), tuple(rests))


def _unknown(spec: TokenSpec, texts: set[str]) -> dict[str, None]:
    """The limbs that have tokens, of which training knew none, without the root; in order."""
    own: dict[str | None, set[str]] = {}
    tokens: tuple[SensorToken | ActuatorToken, ...] = (*spec.sensors, *spec.actuators)
    for token in tokens:
        own.setdefault(token.limb, set()).add(token.text)
    return dict.fromkeys(
        limb.name for limb in spec.limbs if limb.parent is not None and limb.name in own and not own[limb.name] & texts
    )


def _kept_parent(limb: TokenLimb, parents: dict[str, str | None], rests: Collection[str]) -> str | None:
    parent = limb.parent
    while parent is not None and parent in rests:
        parent = parents[parent]
    return parent


def _kept(tokens: Sequence[SensorToken | ActuatorToken], rests: Collection[str]) -> list[int]:
    return [i for i, token in enumerate(tokens) if token.limb not in rests]


def _numbered(tokens: Sequence[_Token]) -> tuple[_Token, ...]:
    return tuple(replace(token, index=i) for i, token in enumerate(tokens))
