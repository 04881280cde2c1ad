"""The left and right of a robot: which limb is the mirror image of which."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np

from morphkit.errors import AblationError
from morphkit.morphology import Morphology
from morphkit.naming import vocabulary
from morphkit.naming.plain import plain_words
from morphkit.naming.sides import Names

_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
_SWAP = {"l": "r", "r": "l", "L": "R", "R": "L"}
_SIDE = re.compile("left|right", re.IGNORECASE)
_LETTER = re.compile(r"(?<![^\W_])[lrLR](?![^\W\d_])|(?<=[a-z])[LR](?![^\W\d_])")
_OTHER = {"left": "right", "right": "left"}
_TOLERANCE = 0.05
_AXES = (1, 0, 2)
"""Normals of the mirror plane in the order of preference: y is left and right in URDF and mostly in MJCF."""


def counterparts(morphology: Morphology, positions: Mapping[str, np.ndarray], *, strict: bool = True) -> dict[str, str]:
    """The mirror image of every limb and fixed body that has one.

    The names propose (`left_foot` and `right_foot`, `FL_hip` and `FR_hip`, `lfemur` and `rfemur`, `leg` and
    `left_leg`), the tree and the rest pose decide: both must hang on counterparts by joints of the same kinds, and lie
    at mirrored places, within 5 % of the robot's size. The mirror is the plane of the root's axes that fits the
    proposals best. Where the names propose nothing, the one body at the mirrored place is taken, unless both names say
    the same side, or one another finger or end than the other. A body in the plane is its own image.

    Args:
        morphology: The robot.
        positions: Body name -> origin in the root's frame, (3,), m; bodies may be missing, then names decide alone.
        strict: Whether the rest pose has to be mirrored. If not, the names decide between bodies on counterparts, as
            with two like arms of which one is mounted turned, and between those on one body without a counterpart, as
            with the fingers of a gripper at the end of a single arm.

    Returns:
        Name -> name of its image; an involution.
    """
    parents, shapes = _tree(morphology)
    places = _Places(parents)
    proposed = _proposed(parents)
    mirror = _Mirror(positions, [(name, others[0]) for name, others in proposed.items() if others])
    image: dict[str, str] = {}
    for name, parent in parents.items():
        if parent is None:
            image[name] = name
        if name in image or parent is None:
            continue
        hanging_on = image.get(parent, None if strict else parent)
        beside = [
            other
            for other, above in parents.items()
            if other != name and other not in image and hanging_on == above and shapes[other] == shapes[name]
        ]
        fitting = [other for other in proposed[name] if other in beside and mirror.maps(name, other)]
        if not strict and not fitting:
            fitting = [other for other in proposed[name] if other in beside]
        centered = mirror.knows(name) or not places.side(name)
        if not fitting and not proposed[name] and image.get(parent) == parent and centered and mirror.maps(name, name):
            fitting = [name]
        unsaid = mirror.knows(name) or (image.get(parent) != parent and not places.side(name))
        if not fitting and parent in image and unsaid:
            at_place = [other for other in beside if mirror.maps(name, other) and places.may_mirror(name, other)]
            fitting = at_place if len(at_place) == 1 else []
        if fitting:
            image[name], image[fitting[0]] = fitting[0], name
    return image


def with_counterparts(names: Sequence[str], image: Mapping[str, str], morphology: Morphology) -> tuple[str, ...]:
    """`names` and their images, each once.

    Raises:
        AblationError: A name says left or right, but nothing is its counterpart.
    """
    places = _Places(_tree(morphology)[0])
    for name in names:
        if name not in image and places.side(name):
            tried = ", ".join(dict.fromkeys(swapped(name))) or "nothing"
            raise AblationError(
                f"{morphology.file}: {name!r} has no counterpart on the other side: looked for {tried} on the"
                " counterpart of its parent, at the mirrored place; leave out --mirror, and name all limbs to cut"
            )
    return tuple(dict.fromkeys(part for name in names for part in (name, image.get(name, name))))


def other_side(text: str) -> str:
    """`text` with left for right and right for left, be it words or letters of their own; itself where it says none."""
    places = next((found for pattern in (_SIDE, _LETTER) if (found := list(pattern.finditer(text)))), [])
    return _swap(text, places)


def swapped(name: str) -> Iterator[str]:
    """Names that `name` could have on the other side, the likeliest first."""
    for pattern in (_SIDE, _LETTER):
        found = list(pattern.finditer(name))
        for part in (found, *([each] for each in found if len(found) > 1)):
            if part:
                yield _swap(name, part)
    for word in _WORD.finditer(name):
        for place in sorted({word.start(), word.start() + 1, word.end() - 1} & set(range(word.start(), word.end()))):
            if name[place] in _SWAP:
                yield name[:place] + _SWAP[name[place]] + name[place + 1 :]
    if _SIDE.search(name):
        yield re.sub(r"^[_ -]|[_ -]$", "", re.sub(r"([_ -])[_ -]", r"\1", _SIDE.sub("", name)))


def _swap(name: str, places: Sequence[re.Match[str]]) -> str:
    """`name` with left for right, and right for left, at some of its places."""
    for found in reversed(places):
        word = found[0]
        other = _SWAP[word] if word in _SWAP else _like(word, _OTHER[word.lower()])
        name = name[: found.start()] + other + name[found.end() :]
    return name


def _proposed(names: Iterable[str]) -> dict[str, list[str]]:
    """For every name those among `names` that may be its counterpart; each is proposed both ways."""
    found: dict[str, list[str]] = {name: [] for name in names}
    for name in found:
        for other in swapped(name):
            if other in found and other != name:
                for one, two in ((name, other), (other, name)):
                    found[one] += [two] if two not in found[one] else []
    return found


def _like(model: str, word: str) -> str:
    """`word` in the case of `model`."""
    return word.upper() if model.isupper() else word.capitalize() if model[0].isupper() else word


def _tree(morphology: Morphology) -> tuple[dict[str, str | None], dict[str, tuple[str, ...]]]:
    """Parent of every limb and fixed body, and the kinds of its joints."""
    parents: dict[str, str | None] = {}
    shapes: dict[str, tuple[str, ...]] = {}
    for limb in morphology.limbs:
        parents[limb.name] = limb.parent
        shapes[limb.name] = tuple(joint.kind for joint in limb.joints)
        for member in limb.members[1:]:
            parents[member] = limb.name
            shapes[member] = ("fixed",)
    return parents, shapes


class _Mirror:
    """The plane that maps the left half of a robot on its right half; without positions, anything maps on anything."""

    def __init__(self, positions: Mapping[str, np.ndarray], pairs: Sequence[tuple[str, str]]) -> None:
        self._positions = positions
        places = np.array(list(positions.values())) if positions else np.zeros((1, 3))
        self._tolerance = _TOLERANCE * float(np.ptp(places, axis=0).max()) + 1e-6
        known = [(positions[one], positions[other]) for one, other in pairs if one in positions and other in positions]
        errors = {}
        for axis in _AXES:
            offset = float(np.median([(one[axis] + other[axis]) / 2 for one, other in known])) if known else 0.0
            misses = [np.abs(_reflect(one, axis, offset) - other).max() for one, other in known]
            errors[axis] = float(np.median(misses)) if misses else 0.0, offset
        # The first of the axes that fit: a chain of limbs in the plane fits any.
        best = min(error for error, _ in errors.values())
        self._axis = next(axis for axis in _AXES if errors[axis][0] <= best + self._tolerance / 10)
        self._offset = errors[self._axis][1]

    def knows(self, name: str) -> bool:
        return name in self._positions

    def maps(self, one: str, other: str) -> bool:
        if one not in self._positions or other not in self._positions:
            return True
        miss = _reflect(self._positions[one], self._axis, self._offset) - self._positions[other]
        return bool(np.abs(miss).max() <= self._tolerance)


class _Places:
    """What the names of a robot's bodies say about where they are."""

    def __init__(self, names: Iterable[str]) -> None:
        names = list(names)
        known = Names(names)
        self._words = {name: plain_words(vocabulary.split(name), known).split() for name in names}

    def side(self, name: str) -> str | None:
        """`left`, `right` or None."""
        return next((word for word in self._words[name][:2] if word in vocabulary.SIDES), None)

    def may_mirror(self, one: str, other: str) -> bool:
        """Whether the names allow that two bodies are images of each other."""
        if self.side(one) is not None and self.side(one) == self.side(other):
            return False
        return all(
            first is None or second is None or first == second
            for first, second in ((self._end(one), self._end(other)), (self._finger(one), self._finger(other)))
        )

    def _end(self, name: str) -> str | None:
        return next((word for word in self._words[name][:2] if word in vocabulary.ENDS), None)

    def _finger(self, name: str) -> str | None:
        words = self._words[name]
        found = (word for word, next_word in pairwise(words) if next_word == "finger" and word in vocabulary.FINGERS)
        return "thumb" if "thumb" in words else next(found, None)


def _reflect(place: np.ndarray, axis: int, offset: float) -> np.ndarray:
    mirrored = place.copy()
    mirrored[axis] = 2 * offset - place[axis]
    return mirrored
