"""Factors of limbs, drawn at random within ranges; mirror images share theirs."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

from morphkit.ablation.limb_scale import LimbScale
from morphkit.errors import AblationError

Range = tuple[float, float]
_DIGITS = 4
SMALLEST, LARGEST = 0.01, 100.0
"""Bounds of a factor."""


@dataclass(frozen=True, slots=True)
class ScaleRanges:
    """Lowest and highest factor of a limb's lengths, mass and gains; see `LimbScale`.

    Raises:
        AblationError: A range is empty or not within `SMALLEST` and `LARGEST`.
    """

    length: Range = (1.0, 1.0)
    mass: Range = (1.0, 1.0)
    gain: Range = (1.0, 1.0)

    def __post_init__(self) -> None:
        for each in fields(self):
            low, high = getattr(self, each.name)
            if not (math.isfinite(low) and math.isfinite(high) and SMALLEST <= low <= high <= LARGEST):
                raise AblationError(
                    f"{each.name}={low:g}:{high:g} is no range of factors: expected"
                    f" {SMALLEST:g} <= low <= high <= {LARGEST:g}"
                )


def draw_scales(
    limbs: Sequence[str], image: Mapping[str, str], ranges: ScaleRanges, *, seed: int, sample: int, salt: str = ""
) -> dict[str, LimbScale]:
    """Draw the factors of every limb, uniformly within their ranges and rounded to four digits.

    Args:
        limbs: Names of the robot's limbs, in file order.
        image: The mirror image of each limb that has one; both have the same factors.
        ranges: What to draw from.
        seed: Seed.
        sample: Number of the body among those of one seed.
        salt: What else makes a body another one, such as the limbs that it lost. The same arguments give the same
            factors, whatever else is drawn.

    Returns:
        Limb -> its factors.
    """
    key = hashlib.sha256(json.dumps([seed, sample, salt]).encode()).digest()
    random = np.random.default_rng(list(key))
    scales: dict[str, LimbScale] = {}
    for limb in limbs:
        drawn = LimbScale(**{each.name: _draw(random, *getattr(ranges, each.name)) for each in fields(ranges)})
        scales[limb] = scales.get(image.get(limb, limb), drawn)
    return scales


def _draw(random: np.random.Generator, low: float, high: float) -> float:
    return min(max(round(float(random.uniform(low, high)), _DIGITS), low), high)
