"""Mirror images of robots that move in a plane: left is called right, and what crosses the plane changes its sign."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from morphkit.ablation.symmetry import other_side
from morphkit.tokens.spec import SensorToken, TokenSpec

_ACROSS = {"position": "y", "translational_velocity": "y", "rotational_velocity": "xz", "exponential_map": "xz",
           "gravity": "y", "body_rotational_velocity": "xz"}  # fmt: skip
"""Components that change their sign where y is mirrored: of vectors that across the plane, of rotations the others."""


def mirror_image(spec: TokenSpec) -> TokenSpec:
    """A robot whose left limbs are called right and whose right ones left, if its base is planar; else the robot."""
    if spec.base != "planar":
        return spec
    return replace(
        spec,
        sensors=tuple(replace(sensor, text=other_side(sensor.text)) for sensor in spec.sensors),
        actuators=tuple(replace(actuator, text=other_side(actuator.text)) for actuator in spec.actuators),
    )


def mirror_signs(spec: TokenSpec) -> np.ndarray:
    """float32 (tokens,), -1 where the mirror image senses the opposite."""
    across = [spec.base == "planar" and _is_across(sensor) for sensor in spec.sensors]
    return np.where(across, -1, 1).astype(np.float32)


def better_known(spec: TokenSpec, bodies: Sequence[Collection[str]]) -> TokenSpec:
    """The robot or its mirror image, whichever has more texts in common with one of the bodies.

    How much two have in common is the share of the texts of either that are texts of both.

    Args:
        spec: The robot.
        bodies: Texts of each body.

    Returns:
        The robot where both are as well known.
    """
    image = mirror_image(spec)
    own, other = (max((_common(set(each.texts), set(body)) for body in bodies), default=0.0) for each in (spec, image))
    return image if other > own else spec


def _common(one: set[str], other: set[str]) -> float:
    return len(one & other) / max(len(one | other), 1)


def _is_across(sensor: SensorToken) -> bool:
    return sensor.component is not None and sensor.component in _ACROSS.get(sensor.quantity, "")
