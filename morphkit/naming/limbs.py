"""Names of limbs: their types, their names in plain words, and the patterns that pick them."""

from __future__ import annotations

import difflib
import fnmatch
import unicodedata
from collections.abc import Iterable, Iterator, Mapping, Sequence

from morphkit.errors import UnknownNameError
from morphkit.morphology import Limb, Morphology
from morphkit.naming import vocabulary

_UNREAD = ("Mn", "Cc", "Cf")
_UNREADABLE = ("So", "Sk", "Sm", "Sc", "Co", "Cn", "Cs")
_SYMBOL = "\ufffd"


def limb_type(name: str, type_words: Sequence[Sequence[str]]) -> str | None:
    """The first type word that occurs in `name`, group by group; None where none does."""
    return next((word for group in type_words for word in group if word.lower() in name.lower()), None)


def canonical_limb_names(morphology: Morphology, given: Mapping[str, str]) -> dict[str, str]:
    """Name every limb in plain words: end (front, back), side (left, right), segment, such as `front left thigh`.

    Like limbs get like names whichever robot they are on, so that their text embeddings are shared.

    Args:
        morphology: The robot.
        given: Raw limb name -> plain words, which go before the rules (`RobotInfo.canonical`). A variant is given its
            source's whole table, so that cutting one limb never renames another.

    Returns:
        Raw limb name -> plain words in limb order, unique within the robot.
    """
    limbs = {limb.name: None for limb in morphology.limbs}
    rows = [raw for raw in given if raw in limbs]
    names = dict(zip(rows, unique((given[raw] for raw in rows), " "), strict=True))
    taken = _Taken((*names.values(), *given.values()))
    prefix = _shared_prefix(morphology)
    for raw in limbs:
        if raw not in names:
            names[raw] = _plain_name(raw, prefix, taken)
    return {raw: names[raw] for raw in limbs}


def renumbered_limbs(morphology: Morphology, given: Mapping[str, str]) -> set[str]:
    """Raw names of the limbs whose plain words, by the rules, are not those that they would have alone."""
    prefix = _shared_prefix(morphology)
    names = canonical_limb_names(morphology, given)
    return {raw for raw, name in names.items() if raw not in given and name != _plain_name(raw, prefix, _Taken())}


def canonical_joint_names(limb: Limb, limb_name: str) -> dict[str, str]:
    """Name the joints of a limb in plain words, without the words that `limb_name` says already.

    A limb `right thigh` with the joints `right_hip_x` and `right_hip_y` gives `hip x` and `hip y`.
    """
    said = set(fold(limb_name).split())
    whole = [vocabulary.plain(vocabulary.split(joint.name)) for joint in limb.joints]
    short = [" ".join(word for word in words.split() if word not in said) for words in whole]
    distinct = all(short) and len(set(short)) == len(short)
    return dict(zip((joint.name for joint in limb.joints), unique(short if distinct else whole, " "), strict=True))


def numbered_labels(limbs: Iterable[str], given: Mapping[str, str]) -> dict[str, str]:
    """Tell limbs apart whose names read alike to a text encoder, such as `foot` and `Foot`.

    Args:
        limbs: Names of the limbs in limb order.
        given: Limb name -> label, of another robot that this one was cut from: cutting one limb never renames another.

    Returns:
        Limb name -> label, such as `Foot_2`, of the limbs whose label is not their name.
    """
    limbs = list(limbs)
    labels = {name: given[name] for name in limbs if name in given}
    read = {fold(label) for label in labels.values()}
    alike = []
    for name in limbs:  # the first of those that read alike keeps its name
        if name not in labels and fold(name) not in read:
            labels[name] = name
            read.add(fold(name))
        elif name not in labels:
            alike.append(name)
    labels |= zip(alike, unique(alike, taken=labels.values()), strict=True)
    return {name: labels[name] for name in limbs if labels[name] != name}


def match_limbs(morphology: Morphology, pattern: str) -> list[str]:
    """The limbs, and the links fixed to them, that `pattern` picks.

    Args:
        morphology: The robot.
        pattern: A name, as given by the reader, or what tokens call it; else a glob over names; else a limb type
            (`foot` picks `bfoot` and `ffoot`), which is a type word of the family or, beside those, a segment in a
            canonical name.

    Returns:
        Names in file order, at least one.

    Raises:
        UnknownNameError: Where nothing matches; the message lists the limbs and the nearest name.
    """
    names = [member for limb in morphology.limbs for member in limb.members or (limb.name,)]
    if pattern in names:
        return [pattern]
    labelled = [name for name, label in morphology.labels.items() if label == pattern]
    if labelled:
        return labelled
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


def did_you_mean(name: str, names: Iterable[str]) -> str:
    """`; did you mean ...?` with the nearest of `names`, or nothing where none is near."""
    folded = {known.lower(): known for known in names}
    near = difflib.get_close_matches(name.lower(), folded, n=1)
    return f"; did you mean {folded[near[0]]!r}?" if near else ""


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


def unique(names: Iterable[str], separator: str = "_", taken: Iterable[str] = ()) -> list[str]:
    """Number the names that read like an earlier one (or one of `taken`): `foot`, `foot_2`, `foot_3`."""
    seen = _Taken(taken)
    return [seen.give(name, separator) for name in names]


class _Taken:
    """Names that are not free, by how they read."""

    def __init__(self, names: Iterable[str] = ()) -> None:
        self._seen = {fold(name) for name in names}
        self._counts: dict[str, int] = {}  # where to go on counting, so that many equal names take no quadratic time

    def __contains__(self, name: str) -> bool:
        return fold(name) in self._seen

    def give(self, name: str, separator: str) -> str:
        """`name`, numbered where it is taken; it then is."""
        candidate, count = name, self._counts.get(name, 1)
        while candidate in self:
            count += 1
            candidate = f"{name}{separator}{count}"
        self._counts[name] = count
        self._seen.add(fold(candidate))
        return candidate


def _plain_name(raw: str, prefix: Sequence[str], taken: _Taken) -> str:
    """The first free name in plain words, taken then: without the prefix, with it, without synonyms, numbered."""
    words = vocabulary.split(raw)
    short = words[len(prefix) :] if words[: len(prefix)] == prefix and len(words) > len(prefix) else words
    candidates = (vocabulary.plain(short), vocabulary.plain(words), " ".join(words))
    return taken.give(next((name for name in candidates if name not in taken), candidates[0]), " ")


def _shared_prefix(morphology: Morphology) -> list[str]:
    """Words such as `panda` that open every limb's name but perhaps the root's, and so tell no limb from another."""
    split = [vocabulary.split(limb.name) for limb in morphology.limbs[1:]]
    shared: list[str] = []
    if len(split) < 2:
        return shared
    for column in zip(*split, strict=False):
        rests = [words[len(shared) + 1 :] for words in split]
        if len(set(column)) > 1 or vocabulary.is_known(column[0]) or not all(any(map(str.isalpha, r)) for r in rests):
            break
        shared.append(column[0])
    return shared


def _of_type(morphology: Morphology, word: str) -> Iterator[str]:
    """Limbs of the type group that holds `word`, and links fixed to limbs whose own names say that type."""
    group = next((group for group in morphology.type_words if word in group), ())
    for limb in morphology.limbs:
        if limb.type in group and limb.type is not None:
            yield limb.name
        for member in limb.members[1:]:
            if limb_type(member, morphology.type_words) in group:
                yield member


def _of_segment(names: Sequence[str], word: str) -> list[str]:
    segment = vocabulary.plain([word.lower()])
    if segment in vocabulary.DIRECTIONS or not segment.isalpha():
        return []
    return [name for name in names if segment in vocabulary.plain(vocabulary.split(name)).split()]
