"""Tokens of the sensors that a robot's file declares itself."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from morphkit.morphology import Morphology, Reading, Sensor
from morphkit.naming.plain import plain_words
from morphkit.naming.unique import unique
from morphkit.naming.vocabulary import split


def declared_readings(
    morphology: Morphology, limb_words: Mapping[str, str] | None
) -> Iterator[tuple[str, Sensor, Reading]]:
    """Yield name, sensor and reading of each scalar that the declared sensors read, in file order.

    The name is `<sensor>_<component>`, with the quantity between them where a sensor reads several quantities; with
    `limb_words`, the limbs' canonical names, the sensor is called in plain words.
    """
    _, labels = sensor_labels(morphology, limb_words)
    for label, sensor in zip(labels, morphology.sensors, strict=True):
        several = len({reading.quantity for reading in sensor.readings}) > 1
        for reading in sensor.readings:
            parts = (label, reading.quantity if several else None, reading.component)
            yield "_".join(part for part in parts if part), sensor, reading


def sensor_labels(morphology: Morphology, limb_words: Mapping[str, str] | None) -> tuple[list[str], list[str]]:
    """What each declared sensor would be called in token names if there were no other, and what it is called."""
    alone = [sensor.name for sensor in morphology.sensors]
    if limb_words is not None:
        said = [limb_words.get(sensor.limb or "", "").split() for sensor in morphology.sensors]
        alone = ["_".join(plain_words(split(name), said=on).split()) for name, on in zip(alone, said, strict=True)]
    return alone, unique(alone)


def without_scalars(morphology: Morphology) -> tuple[str, ...]:
    """The declared sensors that give no tokens, such as cameras, each as `kind 'name'`."""
    return tuple(f"{sensor.kind} {sensor.name!r}" for sensor in morphology.sensors if not sensor.readings)
