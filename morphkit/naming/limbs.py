"""Names of limbs and joints in plain words, and labels for limbs whose names read alike."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from morphkit.morphology import Limb, Morphology
from morphkit.naming.plain import plain_words
from morphkit.naming.prefix import Prefixes
from morphkit.naming.sides import Names
from morphkit.naming.unique import TakenNames, fold, unique
from morphkit.naming.vocabulary import split


def canonical_limb_names(morphology: Morphology, given: Mapping[str, str]) -> dict[str, str]:
    """Name every limb in plain words: end (front, back), side (left, right), segment, such as `front left thigh`.

    Like limbs get like names whichever robot they are on, so that their text embeddings are shared. Codes such as `r`
    and `fl` count where the robot has the counterpart; see `naming.sides`.

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
    taken = TakenNames((*names.values(), *given.values()), key=fold)
    words = _Words(morphology)
    for raw in limbs:
        if raw not in names:
            names[raw] = words.name(raw, taken)
    return {raw: names[raw] for raw in limbs}


def renumbered_limbs(morphology: Morphology, given: Mapping[str, str]) -> set[str]:
    """Raw names of the limbs whose plain words, by the rules, are not those that they would have alone."""
    words = _Words(morphology)
    names = canonical_limb_names(morphology, given)
    return {raw for raw, name in names.items() if raw not in given and name != words.name(raw, TakenNames(key=fold))}


def canonical_joint_names(limb: Limb, limb_name: str) -> dict[str, str]:
    """Name the joints of a limb in plain words, without the words that `limb_name` says already.

    A limb `right thigh` with the joints `right_hip_x` and `right_hip_y` gives `hip x` and `hip y`.
    """
    said = set(fold(limb_name).split())
    whole = [plain_words(split(joint.name), said=said) for joint in limb.joints]
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


class _Words:
    """The limbs' names in plain words, one by one."""

    def __init__(self, morphology: Morphology) -> None:
        raw = [limb.name for limb in morphology.limbs]
        self._names = Names(name for limb in morphology.limbs for name in limb.members or (limb.name,))
        self._prefixes = Prefixes(raw, self._names)

    def name(self, raw: str, taken: TakenNames) -> str:
        """The first free name, taken then: without the prefix, with it, with the file's own words, numbered."""
        whole = split(raw)
        short, long = (plain_words(whole, self._names, start=each) for each in (self._prefixes.length(raw), 0))
        candidates = (short, long, " ".join(whole))
        return taken.give(next((name for name in candidates if name not in taken), candidates[0]), " ")
