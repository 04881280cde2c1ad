"""Bodies of other proportions: which a family has, and with which factors."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain

from morphkit.ablation.ablate import Cutter, Variant
from morphkit.ablation.limb_scale import LimbScale
from morphkit.description import Description
from morphkit.families.enumeration import Planned, plan_family
from morphkit.scaling.draw import ScaleRanges, draw_scales
from morphkit.scaling.scale import scale_limbs


@dataclass(frozen=True, slots=True)
class Sampling:
    """How bodies are scaled.

    Attributes:
        ranges: What factors are drawn from.
        samples: How many bodies are made of each.
        seed: Seed of the factors.
    """

    ranges: ScaleRanges
    samples: int = 1
    seed: int = 0


def scaled_variants(
    description: Description,
    ranges: ScaleRanges,
    *,
    samples: int = 1,
    seed: int = 0,
    remove: Sequence[str] = (),
    splice: Sequence[str] = (),
    keep: Sequence[str] = (),
    mirror: bool = False,
) -> Iterator[Variant]:
    """Yield bodies whose limbs have other lengths, masses and gains; see `scaling.scale.scale_limbs`.

    Mirror images share their factors. The same arguments give the same bodies.

    Args:
        description: The robot.
        ranges: What factors are drawn from, uniformly.
        samples: How many bodies.
        seed: Seed of the factors.
        remove: As in `ablation.ablate`; limbs are cut off before what is left is scaled.
        splice: As in `ablation.ablate`.
        keep: As in `ablation.ablate`.
        mirror: As in `ablation.ablate`.

    Raises:
        AblationError: As in `ablation.ablate`, or something cannot be scaled.
    """
    cutter = Cutter(description)
    base = plan_one(cutter, remove=remove, splice=splice, keep=keep, mirror=mirror)
    for plan in plan_scaled(cutter, [base], Sampling(ranges, samples, seed)):
        cut = cutter.cut(remove=plan.remove, splice=plan.splice, name=base.name)
        yield scale_limbs(cut, scales_left(plan, cut), name=plan.name)


def scales_left(plan: Planned, cut: Variant) -> dict[str, LimbScale]:
    """The factors that a plan has for the limbs that a cut left."""
    return {limb: plan.scales[limb] for limb in cut.limbs}


def plan_one(
    cutter: Cutter,
    *,
    remove: Sequence[str] = (),
    splice: Sequence[str] = (),
    keep: Sequence[str] = (),
    mirror: bool = False,
    name: str | None = None,
) -> Planned:
    """The variant that `ablation.ablate` would make; the robot itself where nothing is asked for.

    Raises:
        AblationError: As in `ablation.ablate`.
    """
    cutter.ablate(remove=remove, splice=splice, keep=keep, mirror=mirror)
    wish, own_name = cutter.wish(remove=remove, splice=splice, keep=keep, mirror=mirror)
    return Planned(name or own_name, wish.remove, wish.splice)


def plan_scaled_family(
    cutter: Cutter,
    sampling: Sampling,
    *,
    min_limbs: int = 2,
    max_limbs: int | None = None,
    limit: int | None = None,
    skip_mirrored: bool = False,
) -> Iterator[Planned]:
    """The bodies of `plan_family`, scaled; the whole robot comes first, which is another body once it is scaled."""
    bodies: Iterable[Planned] = plan_family(
        cutter, min_limbs=min_limbs, max_limbs=max_limbs, skip_mirrored=skip_mirrored
    )
    count = len(cutter.morphology.limbs)
    if min_limbs <= count and (max_limbs is None or count <= max_limbs):
        bodies = chain([plan_one(cutter)], bodies)
    made = 0
    for plan in plan_scaled(cutter, bodies, sampling):
        if made == limit:
            return
        made += plan.mirrors is None
        yield plan


def plan_scaled(cutter: Cutter, bodies: Iterable[Planned], sampling: Sampling) -> Iterator[Planned]:
    """Each of `bodies` as often as asked for, with factors of its own; what is left out stays as it is."""
    limbs = [limb.name for limb in cutter.morphology.limbs]
    image = cutter.counterparts()
    for body in bodies:
        if body.mirrors is not None:
            yield body
            continue
        salt = json.dumps([body.remove, body.splice])
        for sample in range(1, sampling.samples + 1):
            scales = draw_scales(limbs, image, sampling.ranges, seed=sampling.seed, sample=sample, salt=salt)
            yield replace(body, name=f"{body.name}-scaled-{sample}", scales=scales)
