"""What changed between two robots, whichever format each has."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

from morphkit.comparison.matching import moved, pair_limbs, pair_rest
from morphkit.comparison.properties import Facts, Table, Value, gather_facts, unit_of
from morphkit.description import Description
from morphkit.naming.limbs import canonical_limb_names

SCHEMA_VERSION = 1

Subject = Literal[
    "robot", "limb", "joint", "actuator", "sensor token", "actuator token",
    "body", "site", "camera", "tendon", "equality", "sensor", "geom", "contact pair", "contact exclusion",
]  # fmt: skip
Kind = Literal["removed", "added", "renamed", "changed", "reordered"]


@dataclass(frozen=True, slots=True)
class Change:
    """One difference.

    Attributes:
        subject: What it is about.
        kind: What happened to it on the way from the first robot to the second.
        name: Its name in the first robot; in the second where it was added; empty for the robot as a whole.
        new_name: Its name in the second robot; None where it was removed.
        limb: The limb that it belongs to, as the first robot calls it (the second, where it was added); None where it
            belongs to no single limb.
        fact: What changed, such as `range`; None where the whole thing did.
        before: Value in the first robot.
        after: Value in the second.
        unit: Unit of both, empty where they have none.
    """

    subject: Subject
    kind: Kind
    name: str
    new_name: str | None
    limb: str | None
    fact: str | None = None
    before: Value = None
    after: Value = None
    unit: str = ""


@dataclass(frozen=True)
class Comparison:
    """Two robots and what changed from the first to the second.

    Attributes:
        first: Facts of the first robot.
        second: Facts of the second robot.
        limbs: Limbs of the first robot -> the same limbs of the second.
        changes: Every difference; empty where the robots are equal in everything compared.
    """

    first: Facts
    second: Facts
    limbs: Mapping[str, str]
    changes: tuple[Change, ...]

    @property
    def equal(self) -> bool:
        """Whether nothing changed."""
        return not self.changes

    def to_dict(self) -> dict[str, Any]:
        """The comparison as plain data, for JSON."""
        return {
            "schema_version": SCHEMA_VERSION,
            "equal": self.equal,
            "first": _summary(self.first),
            "second": _summary(self.second),
            "changes": [asdict(change) for change in self.changes],
        }


def compare(first: Description, second: Description, *, tolerance: float = 1e-6) -> Comparison:
    """Compare two robots by what they are: limbs, joints, actuators, masses and tokens.

    Of two MJCFs also by every array of their compiled models, name by name; see `comparison.arrays`. Meshes, shapes
    that touch nothing, looks, comments and the order of elements that have no tokens do not count.

    Args:
        first: A robot.
        second: Another; one may be a URDF and the other an MJCF. What only one format has words for is left out.
        tolerance: Numbers are equal that differ by at most this share, or by a thousandth of it in SI units.

    Raises:
        DescriptionError: A file cannot be read or compiled.
    """
    a, b = gather_facts(first), gather_facts(second)
    words = canonical_limb_names(a.morphology, first.info.canonical)
    words |= canonical_limb_names(b.morphology, second.info.canonical)
    limbs = pair_limbs(a.morphology, b.morphology, words)
    joints = pair_rest(_places(a.joints, "kind", limbs), _places(b.joints, "kind"))
    actuators = pair_rest(_places(a.actuators, "joint", limbs, joints), _places(b.actuators, "joint"))
    sensors = pair_rest(_places(a.sensor_tokens, "scalar", limbs), _places(b.sensor_tokens, "scalar"))
    controls = pair_rest(_places(a.actuator_tokens, "joint", limbs, joints), _places(b.actuator_tokens, "joint"))
    differ = _Differ(limbs, joints, tolerance)
    changes = [
        *differ.table("robot", a.robot, b.robot, {"": ""}),
        *differ.table("limb", a.limbs, b.limbs, limbs),
        *differ.table("joint", a.joints, b.joints, joints),
        *differ.table("actuator", a.actuators, b.actuators, actuators),
        *differ.table("sensor token", a.sensor_tokens, b.sensor_tokens, sensors),
        *differ.table("actuator token", a.actuator_tokens, b.actuator_tokens, controls),
        *_elements(differ, a, b, {**limbs, **joints, **actuators}),
    ]
    return Comparison(a, b, limbs, tuple(changes))


def _elements(differ: _Differ, a: Facts, b: Facts, names: Mapping[str, str]) -> Iterator[Change]:
    """What changed in bodies, sites and the rest of an MJCF; `names` leads from names of the first to the second's.

    That a body or sensor came or went is said by limbs and tokens; that a geom did is a matter of shapes.
    """

    def renamed(value: Value) -> Value:
        if isinstance(value, tuple):
            return tuple(names.get(each, each) if isinstance(each, str) else each for each in value)  # type: ignore[return-value]
        return names.get(value, value) if isinstance(value, str) else value

    for kind in (kind for kind in a.elements if kind in b.elements):
        first, second = a.elements[kind], b.elements[kind]
        # What has no name is called after what it refers to.
        called = {name: " ".join(names.get(word, word) for word in name.split(" ")) for name in first}
        pairs = {name: new for name in first if (new := names.get(name, called[name])) in second}
        if kind in ("body", "sensor", "geom"):
            first = {name: first[name] for name in pairs}
            second = {name: second[name] for name in pairs.values()}
        told = {
            name: {fact: value if fact == "limb" else renamed(value) for fact, value in row.items()}
            for name, row in first.items()
        }
        yield from (c for c in differ.table(kind, told, second, pairs) if c.kind not in ("renamed", "reordered"))  # type: ignore[arg-type]


def _places(
    table: Table, fact: str, limbs: Mapping[str, str] | None = None, values: Mapping[str, str] | None = None
) -> dict[str, tuple[Value, Value] | None]:
    """Name -> its limb and a fact; None for what hangs on a limb without counterpart, or drives nothing by name.

    Args:
        table: Rows with a limb.
        fact: The fact that tells apart what is on one limb.
        limbs: For the first robot: what the second calls its limbs.
        values: What the second calls the values of `fact`, where they are names.
    """
    places: dict[str, tuple[Value, Value] | None] = {}
    for name, facts in table.items():
        limb, value = facts["limb"], facts[fact]
        if limb is not None and limbs is not None:
            limb = limbs.get(str(limb))
        if value is not None and values is not None:
            value = values.get(str(value))
        places[name] = None if limb is None or value is None else (limb, value)
    return places


class _Differ:
    """Compares tables of facts, given which limbs and joints are the same."""

    def __init__(self, limbs: Mapping[str, str], joints: Mapping[str, str], tolerance: float) -> None:
        self.names = {"parent": limbs, "limb": limbs, "joint": joints, "follows": joints}
        self.tolerance = tolerance

    def table(self, subject: Subject, first: Table, second: Table, pairs: Mapping[str, str]) -> Iterator[Change]:
        """What changed from one table to the other; `pairs` says which rows are the same."""
        for name, facts in first.items():
            limb = _limb(subject, name, facts)
            if name not in pairs:
                yield Change(subject, "removed", name, None, limb)
                continue
            other = pairs[name]
            if other != name:
                yield Change(subject, "renamed", name, other, limb)
            yield from self._facts(subject, name, other, facts, second[other])
        for name in moved(pairs, list(second)):
            yield Change(subject, "reordered", name, pairs[name], _limb(subject, name, first[name]))
        kept = set(pairs.values())
        for name, facts in second.items():
            if name not in kept:
                yield Change(subject, "added", name, name, _limb(subject, name, facts))

    def _facts(
        self, subject: Subject, name: str, other: str, before: Mapping[str, Value], after: Mapping[str, Value]
    ) -> Iterator[Change]:
        same_parent = self._same("parent", before.get("parent"), after.get("parent"))
        for fact in before:
            if fact not in after or (fact in ("position", "orientation") and not same_parent):
                continue
            if not self._same(fact, before[fact], after[fact]):
                unit = unit_of(fact, before)
                unit = unit if unit == unit_of(fact, after) else ""
                limb = _limb(subject, name, before)
                yield Change(subject, "changed", name, other, limb, fact, before[fact], after[fact], unit)

    def _same(self, fact: str, before: Value, after: Value) -> bool:
        if fact in self.names and isinstance(before, str):
            return before in self.names[fact] and self.names[fact][before] == after
        if isinstance(before, tuple) and isinstance(after, tuple):
            return len(before) == len(after) and all(
                self._equal(one, other) for one, other in zip(before, after, strict=True)
            )
        return self._equal(before, after)

    def _equal(self, one: Any, other: Any) -> bool:
        if isinstance(one, float) and isinstance(other, float):
            return math.isclose(one, other, rel_tol=self.tolerance, abs_tol=1e-3 * self.tolerance)
        return bool(one == other)


def _limb(subject: Subject, name: str, facts: Mapping[str, Value]) -> str | None:
    if subject == "limb":
        return name
    limb = facts.get("limb")
    return None if limb is None else str(limb)


def _summary(facts: Facts) -> dict[str, Any]:
    robot = facts.morphology
    return {
        "name": robot.name,
        "file": robot.file,
        "format": robot.format,
        "sha256": robot.sha256,
        **counts(facts),
        "notes": list(facts.notes),
    }


def counts(facts: Facts) -> dict[str, float | None]:
    """How much of everything a robot has, without the joints of its base; its mass in kg."""
    return {
        "limbs": len(facts.limbs),
        "joints": len(facts.morphology.joints),
        "actuators": len(facts.actuators),
        "mass": facts.mass,
        "sensor_tokens": len(facts.sensor_tokens),
        "actuator_tokens": len(facts.actuator_tokens),
    }
