"""The order in which messages are passed in trees."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from morphkit_rl.models.smp_tree import make_tree


def test_levels_of_a_tree_written_by_hand() -> None:
    tree = make_tree((-1, 0, 1, 0, -1), children=2)
    assert tree.order.tolist() == [0, 4, 1, 3, 2]
    assert tree.place.tolist() == [0, 2, 4, 3, 1]
    roots, middle, leaf = tree.levels
    assert roots.children.tolist() == [[0, 1], [2, 2]]
    assert roots.senders.tolist() == [0]
    assert middle.piece.tolist() == [0, 1]
    assert middle.children.tolist() == [[0, 1], [1, 1]]
    assert leaf.piece.tolist() == [0]
    assert leaf.senders.tolist() == []


@settings(deadline=None, derandomize=True, max_examples=60)
@given(st.lists(st.integers(0, 100), min_size=1, max_size=12), st.integers(0, 3))
def test_every_limb_is_heard_by_its_parent_alone(choices: list[int], spare: int) -> None:
    parents = tuple(choice % (limb + 1) - 1 for limb, choice in enumerate(choices))
    children = max(parents.count(limb) for limb in range(len(parents))) + spare
    tree = make_tree(parents, children)
    order = tree.order.tolist()
    assert [order[place] for place in tree.place.tolist()] == list(range(len(parents)))
    for level, deeper in zip(tree.levels, (*tree.levels[1:], None), strict=True):
        limbs = order[level.limbs]
        below = order[deeper.limbs] if deeper else []
        for limb, slots in zip(limbs, level.children.tolist(), strict=True):
            own = [child for child, parent in enumerate(parents) if parent == limb]
            assert [below[slot] for slot in slots if slot < len(below)] == own
        if deeper:
            senders = [limbs[sender] for sender in level.senders.tolist()]
            for limb, piece in zip(below, deeper.piece.tolist(), strict=True):
                parent = senders[piece // children]
                assert (parent, parents[:limb].count(parent)) == (parents[limb], piece % children)
