"""The limbs of several robots by depth: which limb receives whose message, level by level."""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import torch
from torch import Tensor

from morphkit_rl.models.layout import Layout


@dataclass(frozen=True)
class Level:
    """The limbs of one depth.

    Attributes:
        limbs: Their place in the order by depth.
        children: (limbs, children) place of each child among the limbs one deeper; their number where there is none.
        senders: (parents,) those that have children, by place among the limbs of this depth.
        piece: (limbs,) which piece of the parents' messages each hears: place among the parents' level's `senders`
            times `children`, plus the number of earlier siblings.
    """

    limbs: slice
    children: Tensor
    senders: Tensor
    piece: Tensor


@dataclass(frozen=True)
class Tree:
    """Limbs by depth.

    Attributes:
        order: (limbs,) limb at each place of the order by depth.
        place: (limbs,) place of each limb in that order.
        levels: Roots first.
    """

    order: Tensor
    place: Tensor
    levels: tuple[Level, ...]


_TREES: WeakKeyDictionary[Layout, dict[int, Tree]] = WeakKeyDictionary()


def tree(layout: Layout, children: int) -> Tree:
    """Limbs of `layout` by depth, each with places for `children` children; made once a layout."""
    known = _TREES.setdefault(layout, {})
    if children not in known:
        known[children] = make_tree(layout.parents, children, layout.relation.device)
    return known[children]


def make_tree(parents: tuple[int, ...], children: int, device: torch.device | str = "cpu") -> Tree:
    """Sort limbs by depth.

    Args:
        parents: Place of each limb's parent, -1 for roots, in any order.
        children: Places for children a limb.
        device: Where the tensors live.
    """
    depths = [_depth(parents, limb) for limb in range(len(parents))]
    by_depth = [[limb for limb, d in enumerate(depths) if d == depth] for depth in range(max(depths) + 1)]
    order = [limb for limbs in by_depth for limb in limbs]
    below: list[list[int]] = [[child for child, p in enumerate(parents) if p == limb] for limb in range(len(parents))]

    def tensor(values: object) -> Tensor:
        return torch.tensor(values, dtype=torch.long, device=device)

    levels, start, heard_senders = [], 0, list[int]()
    for depth, limbs in enumerate(by_depth):
        deeper = by_depth[depth + 1] if depth + 1 < len(by_depth) else []
        slots = [[*map(deeper.index, below[limb]), *[len(deeper)] * (children - len(below[limb]))] for limb in limbs]
        pieces = [
            heard_senders.index(parents[limb]) * children + below[parents[limb]].index(limb) for limb in limbs if depth
        ]
        senders = [limb for limb in limbs if below[limb]]
        levels.append(
            Level(
                limbs=slice(start, start + len(limbs)),
                children=tensor(slots),
                senders=tensor([limbs.index(limb) for limb in senders]),
                piece=tensor(pieces),
            )
        )
        start, heard_senders = start + len(limbs), senders
    place = [order.index(limb) for limb in range(len(parents))]
    return Tree(tensor(order), tensor(place), tuple(levels))


def _depth(parents: tuple[int, ...], limb: int) -> int:
    depth = 0
    while parents[limb] >= 0:
        limb, depth = parents[limb], depth + 1
    return depth
