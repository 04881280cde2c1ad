"""Sensor and actuator tokens: the named scalars that a robot's limbs sense and accept."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import astuple, dataclass, fields
from functools import cached_property
from typing import Literal, get_args

import numpy as np

from morphkit.errors import ConfigError
from morphkit.morphology import Base, Format, Morphology, Origin
from morphkit.naming.unique import unique
from morphkit.tokens import serialization
from morphkit.tokens.declared_sensors import declared_readings
from morphkit.tokens.names import (
    Naming,
    actuator_names,
    joint_labels,
    limb_labels,
    limb_scalars,
    limb_words,
    numbered_controls,
)
from morphkit.tokens.origins import Named, given_names
from morphkit.tokens.records import ActuatorToken, SensorToken, TokenLimb

__all__ = ["ActuatorToken", "Naming", "SensorToken", "TokenLimb", "TokenSpec", "token_spec"]

Source = Literal["limb", "declared", "all"]
_About = tuple[str | None, str, str | None, str, str | None, float | None, float | None]
"""Limb, quantity, component, unit, frame, low and high of a sensor token."""


@dataclass(frozen=True)
class TokenSpec:
    """All tokens of a robot, in the order of its observations and actions.

    Attributes:
        morphology: Name of the robot.
        file: Basename of the description file.
        format: `urdf` or `mjcf`.
        sha256: SHA-256 of the file, hexadecimal.
        naming: `raw` or `canonical`.
        family: Name of the family or None.
        task: Name of the task or None.
        base: How the root is attached to the world.
        limbs: The limbs, root first.
        sensors: The scalars of an observation.
        actuators: The scalars of an action.
        given_names: Where the elements come from that the file gives no name, one that others have or read like, or one
            that `replicate` or `attach` changes. Empty where all names are the file's own.
    """

    morphology: str
    file: str
    format: Format
    sha256: str
    naming: Naming
    family: str | None
    task: str | None
    base: Base
    limbs: tuple[TokenLimb, ...]
    sensors: tuple[SensorToken, ...]
    actuators: tuple[ActuatorToken, ...]
    given_names: tuple[Origin, ...] = ()

    schema_version = serialization.SCHEMA_VERSION

    @cached_property
    def token_limb(self) -> np.ndarray:
        """Index into `limbs` of every sensor token, int64 (sensors,); -1 where it belongs to no single limb."""
        return self._limb_indices([sensor.limb for sensor in self.sensors])

    @cached_property
    def actuator_limb(self) -> np.ndarray:
        """Index into `limbs` of every actuator token, int64 (actuators,); -1 where it drives no single limb."""
        return self._limb_indices([actuator.limb for actuator in self.actuators])

    @cached_property
    def texts(self) -> tuple[str, ...]:
        """What the text encoder reads: the sensors' texts, then the actuators'."""
        return (*(sensor.text for sensor in self.sensors), *(actuator.text for actuator in self.actuators))

    def to_json(self) -> str:
        """This specification as JSON, schema version 1; the same robot gives the same bytes."""
        return serialization.to_json({field.name: getattr(self, field.name) for field in fields(self)})

    def to_csv(self) -> str:
        """One row a token, sensors first, under a header; empty fields where there is nothing."""
        return serialization.to_csv(self.sensors, self.actuators)

    @staticmethod
    def from_json(text: str) -> TokenSpec:
        """Read what `to_json` wrote.

        Raises:
            DescriptionError: Where the text is no JSON, of another schema version, or lacks a key.
        """
        return TokenSpec(**serialization.from_json(text))

    def _limb_indices(self, names: list[str | None]) -> np.ndarray:
        index: dict[str | None, int] = {limb.name: i for i, limb in enumerate(self.limbs)}
        indices = np.array([index.get(name, -1) for name in names], dtype=np.int64)
        indices.flags.writeable = False
        return indices


def token_spec(
    morphology: Morphology,
    *,
    naming: Naming = "raw",
    limb_names: Literal["body", "joint"] = "body",
    text_style: Literal["words", "raw"] = "words",
    canonical: Mapping[str, str] | None = None,
    source: Source = "limb",
) -> TokenSpec:
    """Name every scalar that a robot's limbs sense and that its actuators accept.

    Args:
        morphology: The robot.
        naming: `raw` takes the names in the file; `canonical` says side and segment in plain words.
        limb_names: Whether a limb is called by its body's (link's) name or by that of its first joint. The root and
            limbs without a joint keep their body's name.
        text_style: `words` puts spaces for underscores in `text`; `raw` sends the name as it is, as published code did.
        canonical: Raw limb name -> plain words, before the rules of `canonical` naming (`RobotInfo.canonical`).
        source: `limb` gives what every limb senses, `declared` the readings of the sensors in the file, `all` both, in
            this order.

    Returns:
        The tokens; names and texts are unique even for an uncased encoder: what reads like an earlier one is numbered.

    Raises:
        ConfigError: An option has none of its values.
    """
    for option, value, choices in (
        ("naming", naming, get_args(Naming)),
        ("limb_names", limb_names, ("body", "joint")),
        ("text_style", text_style, ("words", "raw")),
        ("source", source, get_args(Source)),
    ):
        if value not in choices:
            raise ConfigError(f"{option} is {value!r}, expected one of {', '.join(choices)}")
    labels = limb_labels(morphology, naming, limb_names, canonical or {})
    joints = {limb.name: joint_labels(limb, naming, labels[limb.name]) for limb in morphology.limbs}
    sensed: list[tuple[str, _About]] = []
    named: list[Named] = []
    body = "link" if morphology.format == "urdf" else "body"
    if source != "declared":
        for limb in morphology.limbs:
            for scalar in limb_scalars(limb, joints[limb.name]):
                name = f"{labels[limb.name]}_{scalar.suffix}"
                limit = scalar.limit
                sensed.append((name, (*scalar[:1], *scalar[2:6], limit and -limit, limit)))
                named.append((name, body, limb.name))
    if source != "limb":
        words = limb_words(morphology, naming, canonical or {}) if naming == "canonical" else None
        for name, sensor, reading in declared_readings(morphology, words):
            sensed.append((name, (sensor.limb, *astuple(reading))))
            named.append((name, "sensor", sensor.name))
    names = unique(name for name, _ in sensed)
    alone = list(actuator_names(morphology.actuators, naming, labels, joints))
    named += [(name, "actuator", each.name) for name, each in zip(alone, morphology.actuators, strict=True)]
    controls = numbered_controls(morphology.actuators, alone, names)
    origins = given_names(morphology, naming, limb_names, canonical or {}, zip([*names, *controls], named, strict=True))

    def text(name: str) -> str:
        return name.replace("_", " ") if text_style == "words" else name

    return TokenSpec(
        morphology=morphology.name,
        file=morphology.file,
        format=morphology.format,
        sha256=morphology.sha256,
        naming=naming,
        family=morphology.family,
        task=morphology.task,
        base=morphology.base,
        limbs=tuple(
            TokenLimb(limb.name, limb.parent, limb.type, tuple(joint.name for joint in limb.joints))
            for limb in morphology.limbs
        ),
        sensors=tuple(
            SensorToken(i, name, text(name), *about)
            for i, (name, about) in enumerate(zip(names, (about for _, about in sensed), strict=True))
        ),
        actuators=tuple(
            ActuatorToken(i, name, text(name), a.limb, a.joint, a.unit, _finite(a.low), _finite(a.high))
            for i, (name, a) in enumerate(zip(controls, morphology.actuators, strict=True))
        ),
        given_names=origins,
    )


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
