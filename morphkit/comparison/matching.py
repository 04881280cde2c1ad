"""Which parts of one robot are which of another: by name, and where names differ, by structure."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence

from morphkit.morphology import Limb, Morphology


def pair_limbs(first: Morphology, second: Morphology, words: Mapping[str, str] = {}) -> dict[str, str]:
    """Limbs of `first` -> the same limbs of `second`, in the order of `first`.

    Limbs of one name are the same. Of the others, two are the same whose joints have the same names; else two that
    have one name in plain words; else two that hang on the same limb with joints of the same kinds and ranges and with
    subtrees of the same shape. Each of these counts only where it picks a single pair.

    Args:
        first: A robot.
        second: Another.
        words: Names of limbs of both in plain words, such as `back thigh` for `bthigh`.
    """
    there = {limb.name for limb in second.limbs}
    pairs = {limb.name: limb.name for limb in first.limbs if limb.name in there}
    pairs |= _unique_pairs(first, second, pairs, lambda _, limb: tuple(joint.name for joint in limb.joints) or None)
    pairs |= _unique_pairs(first, second, pairs, lambda _, limb: words.get(limb.name))
    shapes = _shapes(first), _shapes(second)
    if first.root.name not in pairs and second.root.name not in pairs.values():
        below = [{limb.name for limb in robot.children(robot.root.name)} for robot in (first, second)]
        same_children = any(pairs.get(name) in below[1] for name in below[0])
        if same_children or shapes[0][first.root.name] == shapes[1][second.root.name]:
            pairs[first.root.name] = second.root.name
    while True:
        seen = dict(pairs)

        def key(robot: Morphology, limb: Limb, seen: dict[str, str] = seen) -> Hashable:
            parent = limb.parent if robot is second else seen.get(limb.parent or "")
            return None if parent is None else (parent, shapes[robot is second][limb.name])

        found = _unique_pairs(first, second, pairs, key)
        if not found:
            return {limb.name: pairs[limb.name] for limb in first.limbs if limb.name in pairs}
        pairs |= found


def pair_rest(
    first: Mapping[str, Hashable], second: Mapping[str, Hashable], pairs: Mapping[str, str] = {}
) -> dict[str, str]:
    """Names of `first` -> names of `second`: those of one name, then those of one value, n-th to n-th.

    Args:
        first: Name -> what it is, in terms of the second robot; None for what has no counterpart.
        second: Name -> what it is.
        pairs: Pairs that are known already.
    """
    result = dict(pairs)
    result |= {name: name for name in first if name in second and name not in result}
    taken = set(result.values())
    free: dict[Hashable, list[str]] = {}
    for name, what in second.items():
        if name not in taken:
            free.setdefault(what, []).append(name)
    for name, what in first.items():
        if name not in result and what is not None and free.get(what):
            result[name] = free[what].pop(0)
    return {name: result[name] for name in first if name in result}


def moved(pairs: Mapping[str, str], order: Sequence[str]) -> tuple[str, ...]:
    """Which of the paired names are elsewhere in the second robot's order: the fewest that explain it.

    Args:
        pairs: Name in the first robot -> name in the second, in the first one's order.
        order: Names in the second robot's order.
    """
    place = {name: index for index, name in enumerate(order)}
    names = list(pairs)
    targets = [place[pairs[name]] for name in names]
    # Longest increasing run of places: what is in it has stayed.
    ends: list[int] = []
    last: list[int] = []
    before: list[int | None] = []
    for index, target in enumerate(targets):
        length = bisect_left(ends, target)
        before.append(last[length - 1] if length else None)
        ends[length : length + 1] = [target]
        last[length : length + 1] = [index]
    stayed: set[int] = set()
    at: int | None = last[-1] if last else None
    while at is not None:
        stayed.add(at)
        at = before[at]
    return tuple(name for index, name in enumerate(names) if index not in stayed)


def _unique_pairs(
    first: Morphology,
    second: Morphology,
    pairs: Mapping[str, str],
    key: Callable[[Morphology, Limb], Hashable],
) -> dict[str, str]:
    taken = set(pairs.values())
    left = _by_unique_key(first, (limb for limb in first.limbs if limb.name not in pairs), key)
    right = _by_unique_key(second, (limb for limb in second.limbs if limb.name not in taken), key)
    return {name: right[value] for value, name in left.items() if value in right}


def _by_unique_key(
    robot: Morphology, limbs: Iterable[Limb], key: Callable[[Morphology, Limb], Hashable]
) -> dict[Hashable, str]:
    keyed = [(key(robot, limb), limb.name) for limb in limbs]
    counts = Counter(value for value, _ in keyed)
    return {value: name for value, name in keyed if value is not None and counts[value] == 1}


def _shapes(robot: Morphology) -> dict[str, Hashable]:
    """Limb -> the kinds and ranges of its joints and the shapes of what hangs on it."""
    shapes: dict[str, Hashable] = {}
    below: dict[str | None, list[Hashable]] = {}
    for limb in reversed(robot.limbs):
        joints = tuple((joint.kind, joint.limited, round(joint.low, 6), round(joint.high, 6)) for joint in limb.joints)
        shapes[limb.name] = (joints, tuple(sorted(below.get(limb.name, ()), key=repr)))
        below.setdefault(limb.parent, []).append(shapes[limb.name])
    return shapes
