"""Patterns that pick limbs, and the types that the words of a family give them."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterator, Sequence

from morphkit.errors import UnknownNameError
from morphkit.morphology import Morphology
from morphkit.naming import vocabulary
from morphkit.naming.plain import plain_words
from morphkit.naming.sides import Names
from morphkit.utils.suggest import did_you_mean


def limb_type(type_words: Sequence[Sequence[str]], *names: str) -> str | None:
    """The type of what has `names`: the first word of the first group of which a word occurs in one of them.

    Case does not count. None where no word occurs.
    """
    folded = [name.casefold() for name in names]
    for group in type_words:
        if any(word.casefold() in name for word in group for name in folded):
            return group[0]
    return None


def match_limbs(morphology: Morphology, pattern: str) -> list[str]:
    """The limbs, and the links fixed to them, that `pattern` picks.

    Args:
        morphology: The robot.
        pattern: A name, as given by the reader, or what tokens call it; else a glob over names; else a limb type
            (`foot` picks `bfoot` and `ffoot`), which is a type word of the family or, besides those, a segment in a
            canonical name.

    Returns:
        Names in file order, at least one.

    Raises:
        UnknownNameError: Where nothing matches; the message lists the limbs and the nearest name.
    """
    names = [member for limb in morphology.limbs for member in limb.members or (limb.name,)]
    if pattern in names:
        return [pattern]
    labeled = [name for name, label in morphology.labels.items() if label == pattern]
    if labeled:
        return labeled
    picked = fnmatch.filter(names, pattern) or list(_of_type(morphology, pattern)) or _of_segment(names, pattern)
    if not picked:
        limbs = [limb.name for limb in morphology.limbs]
        fixed = [name for name in names if name not in limbs]
        words = [word for group in morphology.type_words for word in group]
        raise UnknownNameError(
            f"{morphology.file}: no limb of {morphology.name!r} is called {pattern!r}, nor does that match as a glob "
            f"or a limb type{did_you_mean(pattern, [*names, *words])}\n  limbs: {', '.join(limbs)}"
            + (f"\n  links fixed to them: {', '.join(fixed)}" if fixed else "")
            + (f"\n  limb types: {', '.join(words)}" if words else "")
        )
    return picked


def _of_type(morphology: Morphology, word: str) -> Iterator[str]:
    """Limbs of the type that `word` stands for, and links of that type that are fixed to limbs of another."""
    kind = next((group[0] for group in morphology.type_words if word in group), None)
    if kind is None:
        return
    for limb in morphology.limbs:
        if limb.type == kind:
            yield limb.name
            continue
        for member in limb.members[1:]:
            if limb_type(morphology.type_words, member) == kind:
                yield member


def _of_segment(names: Sequence[str], word: str) -> list[str]:
    segment = plain_words([word.lower()])
    if segment in vocabulary.DIRECTIONS or not segment.isalpha():
        return []
    known = Names(names)
    return [name for name in names if segment in plain_words(vocabulary.split(name), known).split()]
