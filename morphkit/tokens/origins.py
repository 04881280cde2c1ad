"""From the names that tokens use back to the elements of the file."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

from morphkit.morphology import Morphology, Origin
from morphkit.naming.limbs import renumbered_limbs
from morphkit.tokens.declared_sensors import sensor_labels
from morphkit.tokens.names import Naming, label_alone, limb_labels, limb_words

Named = tuple[str, str, str]
"""Of a token: its name before it is numbered, and kind and name of the element that it belongs to."""


def given_names(
    morphology: Morphology,
    naming: Naming,
    limb_names: str,
    canonical: Mapping[str, str],
    tokens: Iterable[tuple[str, Named]],
) -> tuple[Origin, ...]:
    """Where the elements come from that tokens call by a name which is not the file's own, each name once.

    Args:
        morphology: The robot.
        naming: As in `tokens`, like the next two.
        limb_names: Whether limbs are called by bodies or by joints.
        canonical: Raw limb name -> plain words.
        tokens: Every token's name, and what it would be called if no other token's name read alike.
    """
    tokens = list(tokens)
    origins = {(origin.kind, origin.given): origin for origin in morphology.origins}
    spoken = {("joint", joint.name) for joint in morphology.joints}
    spoken |= {("joint", actuator.joint) for actuator in morphology.actuators if actuator.joint is not None}
    spoken |= {(kind, name) for _, (_, kind, name) in tokens}
    spoken |= {(kind, member) for limb in morphology.limbs for member in limb.members for kind in ("body", "link")}
    found = [each for key, each in origins.items() if each.given != each.original and key in spoken]
    said = limb_words(morphology, naming, canonical) if naming == "canonical" else None
    renamed = [
        *_limbs(morphology, naming, limb_names, canonical),
        *((label, "sensor", name) for label, name in _sensors(morphology, said) if ("sensor", name) in spoken),
        *((name, kind, element) for name, (alone, kind, element) in tokens if name != alone),
    ]
    unknown = Origin("", "", None, None)
    for name, kind, element in renamed:
        origin = origins.get((kind, element), replace(unknown, kind=kind, original=element))
        found.append(replace(origin, given=name))
    return tuple(found)


def _limbs(morphology: Morphology, naming: Naming, limb_names: str, canonical: Mapping[str, str]) -> Iterator[Named]:
    """Label, kind and name of each limb's element that would be called something else if it were alone."""
    body = "link" if morphology.format == "urdf" else "body"
    labels = limb_labels(morphology, naming, limb_names, canonical)
    said = limb_words(morphology, naming, canonical)
    words = renumbered_limbs(morphology, canonical) if naming == "canonical" and limb_names == "body" else None
    for limb in morphology.limbs:
        label = labels[limb.name]
        by_joint = limb_names == "joint" and limb.joints and limb.parent is not None
        if limb.name in words if words is not None else label != label_alone(limb, naming, limb_names, said):
            yield (label, "joint", limb.joints[0].name) if by_joint else (label, body, limb.name)


def _sensors(morphology: Morphology, said: Mapping[str, str] | None) -> Iterator[tuple[str, str]]:
    alone, labels = sensor_labels(morphology, said)
    for sensor, own, label in zip(morphology.sensors, alone, labels, strict=True):
        if own != label:
            yield label, sensor.name
