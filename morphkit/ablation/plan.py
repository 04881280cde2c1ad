"""Which bodies go, whichever the file's format."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from morphkit.morphology import Morphology


@dataclass(frozen=True, slots=True)
class Plan:
    """The bodies (URDF: links) that a cut takes out.

    Attributes:
        prune: Bodies that go with all below them; none of them lies below another.
        splice: Bodies that go while those directly below them move up.
        gone: Every body that goes, in file order -> the removed limb, or removed fixed body, that it belongs to.
    """

    prune: tuple[str, ...]
    splice: tuple[str, ...]
    gone: dict[str, str]


def make_plan(
    morphology: Morphology, parents: Mapping[str, str | None], remove: Sequence[str], splice: Sequence[str]
) -> Plan:
    """Lay out a cut.

    Args:
        morphology: The robot.
        parents: Parent of every body, in file order; None at the top.
        remove: Limbs and fixed bodies that go with all below them.
        splice: Limbs and fixed bodies that go alone. A limb takes the bodies fixed to it along.
    """
    limb_of = {member: limb.name for limb in morphology.limbs for member in limb.members}
    members = {limb.name: limb.members for limb in morphology.limbs}
    wanted = set(remove)
    pruned: dict[str, str] = {}
    for body, parent in parents.items():  # what hangs on another comes after it
        if body in wanted:
            pruned[body] = body
        elif parent in pruned:
            pruned[body] = pruned[parent]
    spliced = {
        body: name for name in splice if name not in pruned for body in members.get(name, (name,)) if body not in pruned
    }
    labels: dict[str, str] = {}
    for body in parents:
        if body in pruned or body in spliced:
            limb = limb_of.get(body, body)
            went = limb in pruned or limb in spliced
            labels[body] = limb if went else (pruned.get(body) or spliced[body])
    tops = tuple(body for body in pruned if parents[body] not in pruned)
    return Plan(tops, tuple(body for body in parents if body in spliced), labels)
