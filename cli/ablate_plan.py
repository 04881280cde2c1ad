"""Which variants `morphkit ablate` makes where it makes several: all sub-morphologies, scaled bodies, or both."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from typing import TYPE_CHECKING, Any

from . import common

if TYPE_CHECKING:
    from morphkit.ablation.ablate import Cutter
    from morphkit.families.enumeration import Planned
    from morphkit.families.scaled import Sampling

_NUMBER = r"\d+(?:\.\d*)?|\.\d+"
_SCALE = re.compile(rf"(length|mass|gain)=({_NUMBER})(?::({_NUMBER}))?")


def read_scales(options: Sequence[str]) -> dict[str, tuple[float, float]]:
    """What `--scale` says: a range of factors for each of `length`, `mass` and `gain` that is named.

    Raises:
        UsageError: An option has another form, or names what another names.
    """
    ranges: dict[str, tuple[float, float]] = {}
    for option in options:
        found = _SCALE.fullmatch(option)
        if found is None:
            raise common.UsageError(
                f"--scale {option}: expected WHAT=LOW:HIGH or WHAT=FACTOR, where WHAT is length, mass or gain"
            )
        what, low, high = found.groups()
        if what in ranges:
            raise common.UsageError(f"--scale {option}: {what} is scaled already; give one range for it.")
        ranges[what] = float(low), float(high or low)
    return ranges


def sampling(options: Sequence[str], samples: int, seed: int) -> Sampling | None:
    """How bodies are scaled; None where they are not.

    Raises:
        UsageError: As `read_scales`.
        AblationError: A range makes no sense.
    """
    from morphkit.families.scaled import Sampling
    from morphkit.scaling.draw import ScaleRanges

    ranges = read_scales(options)
    return Sampling(ScaleRanges(**ranges), samples, seed) if ranges else None


def plan_family(cutter: Cutter, how: Sampling | None, bounds: Mapping[str, Any]) -> Iterator[Planned]:
    """The variants of `--all`; an error where there are none.

    Args:
        cutter: The robot.
        how: How they are scaled; None for not at all.
        bounds: The named arguments of `families.enumeration.plan_family`.
    """
    from morphkit.errors import AblationError
    from morphkit.families import enumeration, scaled

    planned = scaled.plan_scaled_family(cutter, how, **bounds) if how else enumeration.plan_family(cutter, **bounds)
    first = next(planned, None)
    if first is None:
        low, high = bounds["min_limbs"], bounds["max_limbs"]
        wanted = f"{low} or more" if high is None else f"{low} to {high}"
        raise AblationError(
            f"{cutter.description.name} has {common.count(len(cutter.morphology.limbs), 'limb')}, and no variant of"
            f" it has {wanted}; change --min-limbs or --max-limbs."
        )
    return chain([first], planned)
