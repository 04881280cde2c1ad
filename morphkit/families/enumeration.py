"""Enumerate the sub-morphologies of a robot: every body that is left when limbs and all below them are cut off."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from morphkit.ablation.ablate import Cutter, Variant
from morphkit.ablation.limb_scale import LimbScale
from morphkit.ablation.targets import variant_name
from morphkit.description import Description
from morphkit.errors import AblationError
from morphkit.morphology import Morphology


@dataclass(frozen=True, slots=True)
class Planned:
    """A variant to be made.

    Attributes:
        name: Its name.
        remove: The topmost limbs that go, in file order.
        splice: Limbs that go alone.
        mirrors: Name of an earlier variant whose mirror image this one is; None without one.
        scales: Factors of the limbs that are left; empty where none is scaled.
    """

    name: str
    remove: tuple[str, ...]
    splice: tuple[str, ...] = ()
    mirrors: str | None = None
    scales: Mapping[str, LimbScale] = field(default_factory=dict)


def sub_morphologies(
    description: Description,
    *,
    min_limbs: int = 2,
    max_limbs: int | None = None,
    limit: int | None = None,
    skip_mirrored: bool = False,
    drop_assets: bool = False,
) -> Iterator[Variant]:
    """Yield every part of a robot that holds its root and hangs together, but the robot itself and its bare root.

    They come lazily: those with the fewest limbs removed first, and among them those that lose an earlier limb of the
    file first. A robot of 30 limbs can have millions, so ask for a `limit` there.

    Args:
        description: The robot.
        min_limbs: Fewest limbs that a variant keeps, its root included.
        max_limbs: Most limbs that a variant keeps; None for all but one.
        limit: How many variants at most; None for all.
        skip_mirrored: Leave out each variant that is the mirror image of an earlier one.
        drop_assets: As in `ablation.ablate`.

    Raises:
        AblationError: A bound makes no sense.
    """
    cutter = Cutter(description)
    planned = plan_family(cutter, min_limbs=min_limbs, max_limbs=max_limbs, limit=limit, skip_mirrored=skip_mirrored)
    made = (each for each in planned if each.mirrors is None)
    return (cutter.cut(remove=each.remove, drop_assets=drop_assets, name=each.name) for each in made)


def plan_family(
    cutter: Cutter,
    *,
    min_limbs: int = 2,
    max_limbs: int | None = None,
    limit: int | None = None,
    skip_mirrored: bool = False,
) -> Iterator[Planned]:
    """The variants of `sub_morphologies`, not yet made; with `skip_mirrored` those to leave out too, marked.

    Those to leave out do not count for `limit`.
    """
    if min_limbs < 1 or (max_limbs is not None and max_limbs < min_limbs) or (limit is not None and limit < 0):
        raise AblationError(
            f"no sub-morphologies with min_limbs={min_limbs}, max_limbs={max_limbs}, limit={limit}: expected"
            " 1 <= min_limbs <= max_limbs and limit >= 0"
        )
    morphology, source = cutter.morphology, cutter.description.name
    image = cutter.counterparts(strict=True) if skip_mirrored else {}

    def planned() -> Iterator[Planned]:
        made = 0
        for removed in removals(morphology, min_limbs=min_limbs, max_limbs=max_limbs):
            if made == limit:
                return
            earlier = _earlier_image(morphology, removed, image) if image else None
            mirrors = None if earlier is None else variant_name(source, earlier)
            made += mirrors is None
            yield Planned(variant_name(source, removed), removed, mirrors=mirrors)

    return planned()


def _earlier_image(
    morphology: Morphology, removed: tuple[str, ...], image: Mapping[str, str]
) -> tuple[str, ...] | None:
    """What the mirror image of a variant loses, where that comes before it in the order of `removals`."""
    gone = {limb.name for name in removed for limb in morphology.subtree(name)}
    left = [limb.name for limb in morphology.limbs if limb.name not in gone]
    if any(name not in image for name in left):
        return None
    mirrored = {image[name] for name in left}
    order = {limb.name: number for number, limb in enumerate(morphology.limbs)}
    lost = tuple(limb.name for limb in morphology.limbs[1:] if limb.name not in mirrored and limb.parent in mirrored)
    if [order[name] for name in lost] < [order[name] for name in removed]:
        return lost
    return None


def removals(morphology: Morphology, *, min_limbs: int = 2, max_limbs: int | None = None) -> Iterator[tuple[str, ...]]:
    """Yield the topmost removed limbs of each sub-morphology, in the order of `sub_morphologies`."""
    names = [limb.name for limb in morphology.limbs]
    total = len(names)
    most_left = total - 1 if max_limbs is None else min(max_limbs, total - 1)
    below = _subtree_sizes(morphology)
    # possible[i]: how many limbs can be removed in all from limb i on; bit n stands for n limbs.
    possible = [1] * (total + 1)
    for index in reversed(range(1, total)):
        possible[index] = possible[index + 1] | possible[index + below[index]] << below[index]
    for count in range(total - most_left, total - max(min_limbs, 2) + 1):
        pending: list[tuple[int, int, tuple[str, ...]]] = [(1, count, ())]
        while pending:
            index, left, removed = pending.pop()
            if not possible[index] >> left & 1:
                continue
            if left == 0:
                yield removed
                continue
            pending.append((index + 1, left, removed))
            if below[index] <= left:
                pending.append((index + below[index], left - below[index], (*removed, names[index])))


def _subtree_sizes(morphology: Morphology) -> list[int]:
    """How many limbs hang on each limb, itself included; limbs are in depth-first order."""
    index = {limb.name: number for number, limb in enumerate(morphology.limbs)}
    sizes = [1] * len(morphology.limbs)
    for number in reversed(range(1, len(sizes))):
        parent = morphology.limbs[number].parent
        assert parent is not None
        sizes[index[parent]] += sizes[number]
    return sizes
