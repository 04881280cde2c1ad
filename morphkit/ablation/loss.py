"""What a cut took along."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Loss:
    """Something that a cut removed or changed besides the limbs themselves.

    Attributes:
        kind: What it was: `joint`, `actuator`, `sensor`, `tendon`, `keyframe`, `transmission`, `format`, ...
        name: Its name in the file; where it has none, that of what it referred to.
        limb: The removed limb (or fixed body) that it belonged or referred to; empty where it is no single one.
        reason: Why it went, for people.
    """

    kind: str
    name: str
    limb: str
    reason: str
