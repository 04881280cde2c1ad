"""What a cut is asked for: patterns become exact limbs, their counterparts included, and the name of the variant."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from morphkit.ablation.symmetry import with_counterparts
from morphkit.errors import AblationError
from morphkit.morphology import Morphology
from morphkit.naming.patterns import match_limbs

UNSAFE = re.compile(r"[^A-Za-z0-9_.+-]+")
"""What has no place in the name of a variant or of its file."""


@dataclass(frozen=True, slots=True)
class Wish:
    """What a cut was asked for: exact names of limbs and fixed bodies."""

    remove: tuple[str, ...]
    splice: tuple[str, ...]
    keep: tuple[str, ...]


def select(morphology: Morphology, patterns: Iterable[str], *, root: bool = False) -> tuple[str, ...]:
    """The limbs and fixed bodies that any of `patterns` matches, in the order asked for, each once.

    Args:
        morphology: The robot.
        patterns: Names, globs or limb types.
        root: Whether the root may be one of them.

    Raises:
        UnknownNameError: A pattern matches nothing; the message lists the limbs and the nearest name.
        AblationError: A pattern matches the root, and may not.
    """
    names: dict[str, None] = {}
    for pattern in patterns:
        for name in match_limbs(morphology, pattern):
            if name == morphology.root.name and not root:
                cuttable = ", ".join(limb.name for limb in morphology.limbs[1:]) or "none"
                raise AblationError(
                    f"{morphology.file}: {pattern!r} matches {name!r}, the root of {morphology.name!r}, which cannot be"
                    f" removed; limbs that can: {cuttable}"
                )
            names[name] = None
    return tuple(names)


def choose(
    morphology: Morphology,
    *,
    remove: Sequence[str] = (),
    splice: Sequence[str] = (),
    keep: Sequence[str] = (),
    image: Mapping[str, str] | None = None,
) -> Wish:
    """What patterns mean.

    Args:
        morphology: The robot.
        remove: What goes with all below it.
        splice: What goes alone.
        keep: What stays, with what connects it to the root, while all else goes.
        image: The counterparts that all this holds for too; None for none.

    Raises:
        UnknownNameError: A pattern matches nothing.
        AblationError: The wishes contradict each other, or a limb has no counterpart.
    """
    file = morphology.file
    chosen = {}
    for verb, patterns in (("removed", remove), ("spliced", splice), ("kept", keep)):
        names = select(morphology, patterns, root=verb == "kept")
        chosen[verb] = names if image is None else with_counterparts(names, image, morphology)
    for one, other in (("removed", "spliced"), ("kept", "removed"), ("kept", "spliced")):
        both = sorted(set(chosen[one]) & set(chosen[other]))
        if both:
            raise AblationError(f"{file}: {', '.join(both)} cannot be both {one} and {other}")
    removed, needed = chosen["removed"], _needed(morphology, chosen["kept"])
    blocking = [limb for limb in removed if limb in needed]
    if blocking:
        raise AblationError(
            f"{file}: {', '.join(blocking)} cannot be removed, because limbs to keep hang on it; --splice takes it out"
            " from between"
        )
    if keep:
        others = [limb.name for limb in morphology.limbs if limb.name not in needed and limb.parent in needed]
        removed = tuple(dict.fromkeys([*removed, *others]))
    return Wish(removed, chosen["spliced"], chosen["kept"])


def variant_name(source: str, asked: Sequence[str]) -> str:
    """Name of a variant: `cheetah-no-ffoot-bfoot`; the source's own where nothing is asked for."""
    return source if not asked else "-".join([source, "no", *(UNSAFE.sub("_", word) for word in asked)])


def wish_name(
    morphology: Morphology,
    *,
    remove: Sequence[str] = (),
    splice: Sequence[str] = (),
    keep: Sequence[str] = (),
    image: Mapping[str, str] | None = None,
) -> str:
    """Name of the variant that `choose` is asked for: `cheetah-no-foot`, `cheetah-only-fshin`."""
    kept, cut = (
        [part for word in _words(patterns, morphology) for part in (word, *_other(word, image))]
        for patterns in (keep, [*remove, *splice])
    )
    source = "-".join([morphology.name, "only", *(UNSAFE.sub("_", word) for word in kept)]) if kept else morphology.name
    return variant_name(source, list(dict.fromkeys(cut)))


def _other(word: str, image: Mapping[str, str] | None) -> list[str]:
    other = word if image is None else image.get(word, word)
    return [] if other == word else [other]


def _words(patterns: Sequence[str], morphology: Morphology) -> list[str]:
    """What a variant is named after: the words asked for; for globs the topmost limbs that they matched."""
    words: dict[str, None] = {}
    for pattern in patterns:
        if UNSAFE.search(pattern) is None:
            words[pattern] = None
            continue
        matched = select(morphology, [pattern], root=True)
        below = _below(morphology, set(matched))
        words |= dict.fromkeys(name for name in matched if name not in below)
    return list(words)


def _below(morphology: Morphology, tops: set[str]) -> set[str]:
    """Limbs and fixed bodies that hang on one of the limbs `tops`; limbs come after those that they hang on."""
    below: set[str] = set()
    for limb in morphology.limbs:
        if limb.parent in tops or limb.parent in below:
            below.add(limb.name)
        if limb.name in tops or limb.name in below:
            below.update(limb.members[1:])
    return below


def _needed(morphology: Morphology, kept: Sequence[str]) -> set[str]:
    """Kept limbs and all limbs above them; fixed bodies stay with their limbs."""
    limb_of = {member: limb.name for limb in morphology.limbs for member in limb.members}
    parents = {limb.name: limb.parent for limb in morphology.limbs}
    needed: set[str] = set()
    for name in kept:
        current: str | None = limb_of[name]
        while current is not None and current not in needed:
            needed.add(current)
            current = parents[current]
    return needed
