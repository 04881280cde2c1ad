"""Enumerate the sub-morphologies of a robot: every body that is left when limbs and all below them are cut off."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

from morphkit.ablation import Variant, cut, variant_name
from morphkit.description import Description
from morphkit.errors import AblationError
from morphkit.io import read
from morphkit.morphology import Morphology


def sub_morphologies(
    description: Description, *, min_limbs: int = 2, max_limbs: int | None = None, limit: int | None = None
) -> Iterator[Variant]:
    """Yield every part of a robot that holds its root and hangs together, but the robot itself and its bare root.

    They come lazily: those with the fewest limbs removed first, and among them those that lose an earlier limb of the
    file first. A robot of 30 limbs can have millions, so ask for a `limit` there.

    Args:
        description: The robot.
        min_limbs: Fewest limbs that a variant keeps, its root included.
        max_limbs: Most limbs that a variant keeps; None for all but one.
        limit: How many variants at most; None for all.

    Raises:
        AblationError: A bound makes no sense.
    """
    if min_limbs < 1 or (max_limbs is not None and max_limbs < min_limbs) or (limit is not None and limit < 0):
        raise AblationError(
            f"no sub-morphologies with min_limbs={min_limbs}, max_limbs={max_limbs}, limit={limit}: expected"
            " 1 <= min_limbs <= max_limbs and limit >= 0"
        )
    morphology = read(description)
    cuts = removals(morphology, min_limbs=min_limbs, max_limbs=max_limbs)
    return (
        cut(description, morphology, remove=removed, name=variant_name(description.name, removed))
        for removed in islice(cuts, limit)
    )


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
    """How many limbs hang on each limb, itself included; limbs stand in depth-first order."""
    index = {limb.name: number for number, limb in enumerate(morphology.limbs)}
    sizes = [1] * len(morphology.limbs)
    for number in reversed(range(1, len(sizes))):
        parent = morphology.limbs[number].parent
        assert parent is not None
        sizes[index[parent]] += sizes[number]
    return sizes
