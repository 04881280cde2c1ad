"""Names of robots and makers in front of limb names, which tell no limb from another."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Sequence

from morphkit.naming.plain import is_known
from morphkit.naming.sides import Context, Names, code, finger
from morphkit.naming.vocabulary import ENDS, FILLERS, SIDES, split

_MODEL = re.compile(r"([A-Za-z]+)(\d+[A-Za-z0-9]*)[^A-Za-z0-9]+(?=.*[A-Za-z]{2})")
"""The name of a model, such as `fr3` or `j2s6s200`, and the sign between it and a limb's name."""


class Prefixes:
    """How many words in front of each limb's name say only whose limb it is.

    These are the words that open the name of every limb but perhaps the root's, as long as they say nothing of a body;
    and the name of a model, such as `fr3`, where it opens several names or stands in front of a side or of `link`.

    Args:
        limbs: Names of the limbs, the root first.
        names: The same and all others that a counterpart may have.
    """

    def __init__(self, limbs: Sequence[str], names: Names) -> None:
        self._names = names
        self._shared = self._shared_words([split(name) for name in limbs[1:] or limbs])
        found = [match for match in map(_MODEL.match, limbs) if match]
        self._models = Counter(match[1].lower() + match[2].lower() for match in found)
        self._series: dict[str, set[str]] = defaultdict(set)
        for match in found:
            self._series[match[1].lower()].add(match[2].lower())

    def length(self, name: str) -> int:
        """Number of words in front of a limb's name, as `split` gives them, that say whose limb it is."""
        words, shared = split(name), self._shared
        if shared and words[: len(shared)] == shared and len(words) > len(shared):
            return len(shared)
        match = _MODEL.match(name)
        if match is None or is_known(match[1].lower()) or len(self._series[match[1].lower()]) > 1:
            return 0
        rest = split(name[match.end() :])
        several = self._models[match[1].lower() + match[2].lower()] > 1
        alone = rest[0] in FILLERS or rest[0] in SIDES or "/" in match[0]
        return len(words) - len(rest) if several or alone else 0

    def _shared_words(self, split_names: list[list[str]]) -> list[str]:
        shared: list[str] = []
        if len(split_names) < 2:
            return shared
        for place, column in enumerate(zip(*split_names, strict=False)):
            rests = [words[place + 1 :] for words in split_names]
            if len(set(column)) > 1 or not all(any(map(_says_more, rest)) for rest in rests):
                break
            if is_known(column[0]) or any(self._is_code(words, place) for words in split_names):
                break
            if all(rest[0].isdigit() for rest in rests) and len({rest[0] for rest in rests}) > 1:
                break  # the word is numbered: it says which of several limbs this is
            shared.append(column[0])
        return shared

    def _is_code(self, words: list[str], place: int) -> bool:
        context = Context(words, self._names, start=place)
        return code(context, place) is not None or finger(context, place) is not None


def _says_more(word: str) -> bool:
    """Whether a limb could be called so: by more than a side, an end or a letter."""
    return word.isalpha() and len(word) > 1 and word not in SIDES and word not in ENDS
