"""The left and right of a robot: which limb is the mirror image of which."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from morphkit.errors import AblationError
from morphkit.morphology import Morphology
from morphkit.naming import vocabulary

_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
_SWAP = {"l": "r", "r": "l", "L": "R", "R": "L"}
_SIDE = re.compile("left|right", re.IGNORECASE)
_OTHER = {"left": "right", "right": "left"}
_TOLERANCE = 0.05
_AXES = (1, 0, 2)
"""Normals of the mirror plane in the order of preference: y is left and right in URDF and mostly in MJCF."""


def is_sided(name: str) -> bool:
    """Whether a name says left or right."""
    return bool({"left", "right"} & set(vocabulary.plain_words(vocabulary.split(name)).split()))


def counterparts(morphology: Morphology, positions: Mapping[str, np.ndarray], *, strict: bool = True) -> dict[str, str]:
    """The mirror image of every limb and fixed body that has one.

    The names propose (`left_foot` and `right_foot`, `FL_hip` and `FR_hip`, `lfemur` and `rfemur`, `leg` and
    `left_leg`), the tree and the rest pose decide: both must hang on counterparts by joints of the same kinds, and lie
    at mirrored places, within 5 % of the robot's size. The mirror is the plane of the root's axes that fits the
    proposals best. Where the names propose nothing, the one body at the mirrored place is taken. A body in the plane
    is its own image.

    Args:
        morphology: The robot.
        positions: Body name -> origin in the root's frame, (3,), m; bodies may be missing, then names decide alone.
        strict: Whether the rest pose has to be mirrored. If not, bodies that the names propose may also lie equally far
            from those that they hang on, as with two like arms of which one is mounted turned.

    Returns:
        Name -> name of its image; an involution.
    """
    parents, shapes = _tree(morphology)
    proposed = _proposed(parents)
    mirror = _Mirror(positions, [(name, others[0]) for name, others in proposed.items() if others])
    image: dict[str, str] = {}
    for name, parent in parents.items():
        if parent is None:
            image[name] = name
        if name in image or parent is None:
            continue
        beside = [
            other
            for other, above in parents.items()
            if other != name and other not in image and image.get(parent) == above and shapes[other] == shapes[name]
        ]
        fitting = [other for other in proposed[name] if other in beside and mirror.maps(name, other)]
        if not strict and not fitting:
            fitting = [other for other in proposed[name] if other in beside and _alike(name, other, parents, positions)]
        centered = mirror.knows(name) or not is_sided(name)
        if not fitting and not proposed[name] and image.get(parent) == parent and centered and mirror.maps(name, name):
            fitting = [name]
        if not fitting and (mirror.knows(name) or (image.get(parent) != parent and not is_sided(name))):
            at_place = [other for other in beside if mirror.maps(name, other)]
            fitting = at_place if len(at_place) == 1 else []
        if fitting:
            image[name], image[fitting[0]] = fitting[0], name
    return image


def with_counterparts(names: Sequence[str], image: Mapping[str, str], file: str) -> tuple[str, ...]:
    """`names` and their images, each once.

    Raises:
        AblationError: A name says left or right, but nothing is its counterpart.
    """
    for name in names:
        if name not in image and is_sided(name):
            tried = ", ".join(dict.fromkeys(swapped(name))) or "nothing"
            raise AblationError(
                f"{file}: {name!r} has no counterpart on the other side: looked for {tried} on the counterpart of its"
                " parent, at the mirrored place; leave out --mirror, and name all limbs that are to go"
            )
    return tuple(dict.fromkeys(part for name in names for part in (name, image.get(name, name))))


def swapped(name: str) -> Iterator[str]:
    """Names that `name` could have on the other side, the likeliest first."""
    whole = _SIDE.sub(lambda match: _like(match[0], _OTHER[match[0].lower()]), name)
    if whole != name:
        yield whole
    for word in _WORD.finditer(name):
        for place in sorted({word.start(), word.start() + 1, word.end() - 1} & set(range(word.start(), word.end()))):
            if name[place] in _SWAP:
                yield name[:place] + _SWAP[name[place]] + name[place + 1 :]
    if whole != name:
        yield re.sub(r"^[_ -]|[_ -]$", "", re.sub(r"([_ -])[_ -]", r"\1", _SIDE.sub("", name)))


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


def _alike(one: str, other: str, parents: Mapping[str, str | None], positions: Mapping[str, np.ndarray]) -> bool:
    """Whether two bodies lie equally far, within 5 %, from those that they hang on."""
    above, below = parents[one], parents[other]
    if above is None or below is None or not {one, other, above, below} <= set(positions):
        return False
    near = float(np.linalg.norm(positions[one] - positions[above]))
    far = float(np.linalg.norm(positions[other] - positions[below]))
    return bool(abs(near - far) <= _TOLERANCE * max(near, far) + 1e-6)


def _reflect(place: np.ndarray, axis: int, offset: float) -> np.ndarray:
    mirrored = place.copy()
    mirrored[axis] = 2 * offset - place[axis]
    return mirrored
