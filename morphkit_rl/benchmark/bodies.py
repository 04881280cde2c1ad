"""The bodies of a task in a split: loaded, checked, and with validation robots drawn from the training set."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from morphkit.description import Description
from morphkit.errors import ConfigError
from morphkit.readers import read
from morphkit.registry import load_all
from morphkit_rl.benchmark.cut_bodies import cut_bodies
from morphkit_rl.benchmark.definition import Benchmark

VALIDATION_SHARE = 0.25
"""Share of a group's training robots that validation holds out."""


@dataclass(frozen=True, slots=True)
class Bodies:
    """Robots of a task in a split; no two sets share one.

    Attributes:
        train: Training robots.
        validation: Robots held out of the training set, for choosing anything.
        test: Held-out robots.
        cut: Bodies cut out of training robots that train as well; no part of the published protocol.
    """

    train: tuple[Description, ...]
    validation: tuple[Description, ...]
    test: tuple[Description, ...]
    cut: tuple[Description, ...] = ()


def gather_bodies(benchmark: Benchmark, task: str, split: str, *, validate: bool = False, cuts: int = 0) -> Bodies:
    """Load the robots of a task in a split.

    Args:
        benchmark: Tasks and splits.
        task: Name of the task.
        split: Name of the split.
        validate: Hold out a quarter of each group's training robots (at least one, never all) for choosing anything.
            They are drawn by split and group alone, so that all tasks, methods and seeds hold out the same.
        cuts: Bodies cut out of each group's training robots, at most, that train as well; see `cut_bodies`.

    Raises:
        UnknownNameError: There is no such task, split or robot.
        ConfigError: A body is in the training and in the test set, two have one name, validation has nothing to draw
            from, or no other body can be cut out.
    """
    train: list[Description] = []
    validation: list[Description] = []
    test: list[Description] = []
    cut: list[Description] = []
    for group, sets in benchmark.groups(task, split).items():
        known = _load(sets.train)
        drawn = draw([each.name for each in known], f"{split}/{group}") if validate else frozenset()
        kept = [each for each in known if each.name not in drawn]
        held_out = [each for each in known if each.name in drawn]
        tested = _load(sets.test)
        cut += cut_bodies(kept, (*held_out, *tested), cuts)
        train, validation, test = train + kept, validation + held_out, test + tested
    if validate and not validation:
        raise ConfigError(f"task {task!r}, split {split!r}: too few training robots to hold one out for validation")
    if cuts and not cut:
        raise ConfigError(f"task {task!r}, split {split!r}: no other body can be cut out of the training robots")
    _check_disjoint((*train, *cut, *validation), test, f"task {task!r}, split {split!r}")
    return Bodies(tuple(train), tuple(validation), tuple(test), tuple(cut))


def draw(names: Sequence[str], key: str) -> frozenset[str]:
    """Draw the validation robots of a group: always the same for the same names and key; none of a single one."""
    if len(names) < 2:
        return frozenset()
    number = max(1, round(VALIDATION_SHARE * len(names)))
    rng = np.random.default_rng(zlib.crc32(key.encode()))
    return frozenset(rng.choice(sorted(names), number, replace=False).tolist())


@dataclass(frozen=True, slots=True)
class Member:
    """A body of the benchmark.

    Attributes:
        description: The body.
        group: Its group; the first where it is in several.
        limbs: Names of its limbs.
        splits: `train` or `test`, by the splits that have it.
    """

    description: Description
    group: str
    limbs: tuple[str, ...]
    splits: dict[str, str]


def members(benchmark: Benchmark) -> list[Member]:
    """Every body of every split, by group and number of limbs."""
    found: dict[tuple[str, str], Member] = {}
    loaded: dict[str, list[Description]] = {}
    for split, groups in benchmark.splits.items():
        for group, sets in groups.items():
            for role, targets in (("train", sets.train), ("test", sets.test)):
                for target in targets:
                    if target not in loaded:
                        loaded[target] = load_all(target)
                    for each in loaded[target]:
                        limbs = tuple(_limbs([each])) if (each.name, each.sha256) not in found else ()
                        member = found.setdefault((each.name, each.sha256), Member(each, group, limbs, {}))
                        member.splits[split] = role
    order = list(dict.fromkeys(member.group for member in found.values()))
    return sorted(found.values(), key=lambda each: (order.index(each.group), len(each.limbs), each.description.name))


def unseen_limbs(benchmark: Benchmark, split: str) -> dict[str, tuple[str, ...]]:
    """By group, the limbs of held-out robots that no training robot of the group has."""
    unseen = {}
    for group, sets in benchmark.splits[split].items():
        seen = set(_limbs(_load(sets.train)))
        unseen[group] = tuple(dict.fromkeys(limb for limb in _limbs(_load(sets.test)) if limb not in seen))
    return unseen


def _load(targets: Iterable[str]) -> list[Description]:
    return [description for target in targets for description in load_all(target)]


def _limbs(descriptions: Iterable[Description]) -> list[str]:
    return [limb.name for description in descriptions for limb in read(description).limbs]


def _check_disjoint(train: Sequence[Description], test: Sequence[Description], where: str) -> None:
    names = [each.name for each in (*train, *test)]
    for name in names:
        if names.count(name) > 1:
            raise ConfigError(f"{where}: two robots are called {name!r}; each needs a name of its own")
    trained = {each.sha256: each.name for each in train}
    for each in test:
        if each.sha256 in trained:
            raise ConfigError(
                f"{where}: {each.name!r} is held out, but trained on under the name {trained[each.sha256]!r}"
            )
