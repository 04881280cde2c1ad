"""Names that no two elements share, by their letters or by how a text encoder reads them."""

from __future__ import annotations

import unicodedata
from collections.abc import Callable, Iterable, Sequence

_UNREAD = ("Mn", "Cc", "Cf")
_UNREADABLE = ("So", "Sk", "Sm", "Sc", "Co", "Cn", "Cs")
_SYMBOL = "\ufffd"


def fold(name: str) -> str:
    """What an uncased text encoder tells apart of a name.

    As BERT's tokenizer reads it: in one case, without accents and control characters, punctuation as words of its own.
    Symbols such as emoji, of which no vocabulary has many, all read alike.
    """
    if name.isascii() and name.replace("_", "").isalnum():
        return " ".join(name.replace("_", " ").split()).casefold()
    words = []
    for character in unicodedata.normalize("NFD", name.replace("_", " ").casefold()):
        kind = unicodedata.category(character)
        if character.isspace():
            words.append(" ")
        elif kind[0] == "P" or (character.isascii() and kind[0] == "S"):
            words.append(f" {character} ")
        elif kind in _UNREADABLE:
            words.append(f" {_SYMBOL} ")
        elif kind not in _UNREAD:
            words.append(character)
    return " ".join("".join(words).split())


class TakenNames:
    """Names given out so far; one that is taken gets a number: `foot`, `foot_2`, `foot_3`.

    Args:
        names: Names that are taken from the start.
        key: What of a name counts; by default all of it. With `fold`, names that read alike count as one.
    """

    def __init__(self, names: Iterable[str] = (), *, key: Callable[[str], str] = str) -> None:
        self._key = key
        self._seen = {key(name) for name in names}
        self._counts: dict[str, int] = {}  # where to go on counting, so that many equal names take no quadratic time

    def __contains__(self, name: str) -> bool:
        return self._key(name) in self._seen

    def give(self, name: str, separator: str = "_") -> str:
        """Return `name`, or the first of `name_2`, `name_3`, ... that is free, and take it."""
        candidate, count = name, self._counts.get(name, 1)
        while candidate in self:
            count += 1
            candidate = f"{name}{separator}{count}"
        self._counts[name] = count
        self._seen.add(self._key(candidate))
        return candidate


def unique(names: Iterable[str], separator: str = "_", taken: Iterable[str] = ()) -> list[str]:
    """Number the names that read like an earlier one (or one of `taken`): `foot`, `foot_2`, `foot_3`."""
    seen = TakenNames(taken, key=fold)
    return [seen.give(name, separator) for name in names]


def give_names(originals: Sequence[str | None], calls: Sequence[str]) -> list[str]:
    """A name of its own for each of several elements: its original one, else what `calls` says.

    A number is added where that is taken. Of elements that share a name the first keeps it; no given name takes one
    that is in the file.
    """
    names = TakenNames(original for original in originals if original)
    kept: set[str] = set()
    found = []
    for original, call in zip(originals, calls, strict=True):
        found.append(original if original and original not in kept else names.give(original or call))
        kept.add(original or "")
    return found
