from __future__ import annotations

from itertools import islice

import pytest

from morphkit.description import Description
from morphkit.errors import AblationError
from morphkit.families.enumeration import removals, sub_morphologies
from morphkit.morphology import Limb, Morphology
from morphkit.readers import read
from morphkit.registry import load


def make(parents: list[int | None]) -> Morphology:
    """A morphology whose limb i hangs on limb `parents[i]`."""
    limbs = tuple(
        Limb(f"limb{index}", None if parent is None else f"limb{parent}", (), (f"limb{index}",))
        for index, parent in enumerate(parents)
    )
    return Morphology("robot", "robot.xml", "mjcf", "", "fixed", None, None, (), limbs, ())


def left(morphology: Morphology, removed: tuple[str, ...]) -> set[str]:
    gone = {limb.name for name in removed for limb in morphology.subtree(name)}
    return {limb.name for limb in morphology.limbs} - gone


def test_cheetah_has_fourteen_in_order_of_limbs_removed():
    names = [variant.description.name for variant in sub_morphologies(load("cheetah"))]
    assert names == [
        "cheetah-no-bfoot",
        "cheetah-no-ffoot",
        "cheetah-no-bshin",
        "cheetah-no-bfoot-ffoot",
        "cheetah-no-fshin",
        "cheetah-no-bthigh",
        "cheetah-no-bshin-ffoot",
        "cheetah-no-bfoot-fshin",
        "cheetah-no-fthigh",
        "cheetah-no-bthigh-ffoot",
        "cheetah-no-bshin-fshin",
        "cheetah-no-bfoot-fthigh",
        "cheetah-no-bthigh-fshin",
        "cheetah-no-bshin-fthigh",
    ]


@pytest.mark.parametrize(
    "parents", [[None], [None, 0], [None, 0, 1, 1, 0, 4], [None, 0, 0, 0, 0], [None, 0, 1, 2, 2, 1, 0, 6, 7]]
)
def test_every_connected_part_with_the_root_comes_once(parents):
    morphology = make(parents)
    names = [limb.name for limb in morphology.limbs]
    wanted = set()
    for bits in range(1 << len(names)):
        part = {name for index, name in enumerate(names) if bits >> index & 1}
        closed = all(limb.parent in part for limb in morphology.limbs[1:] if limb.name in part)
        if closed and names[0] in part and 1 < len(part) < len(names):
            wanted.add(frozenset(part))
    found = [frozenset(left(morphology, removed)) for removed in removals(morphology)]
    assert len(found) == len(set(found))
    assert set(found) == wanted
    assert [len(part) for part in found] == sorted((len(part) for part in found), reverse=True)


def test_bounds_and_limit():
    cheetah = load("cheetah")
    sizes = [len(variant.limbs) for variant in sub_morphologies(cheetah, min_limbs=3, max_limbs=4)]
    assert sizes == [4, 4, 4, 4, 3, 3, 3]
    assert len(list(sub_morphologies(cheetah, limit=3))) == 3
    assert list(sub_morphologies(cheetah, limit=0)) == []
    assert len(list(sub_morphologies(cheetah, min_limbs=1))) == 14  # the bare root is never one of them


@pytest.mark.parametrize("bounds", [{"min_limbs": 0}, {"min_limbs": 4, "max_limbs": 3}, {"limit": -1}])
def test_bounds_that_make_no_sense(bounds):
    with pytest.raises(AblationError, match="expected 1 <= min_limbs <= max_limbs"):
        sub_morphologies(load("cheetah"), **bounds)


def test_a_large_robot_is_enumerated_lazily():
    star = make([None] + [0] * 60)
    assert len(list(islice(removals(star), 100))) == 100
    # The smallest parts come last of 2 ** 60; asked for alone they come at once.
    assert len(list(removals(star, max_limbs=2))) == 60
    chain = make([None, *range(1999)])
    assert len(list(removals(chain))) == 1998


def test_fixed_links_go_with_their_limbs_in_families():
    quadruped = load("quadruped")
    variant = next(sub_morphologies(quadruped))
    assert variant.removed == ("FL_calf",)
    assert b"FL_foot" not in variant.description.source
    assert isinstance(variant.description, Description)
    assert [limb.name for limb in read(variant.description).limbs] == list(variant.limbs)
