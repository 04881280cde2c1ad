"""Scale what couples the limbs of an MJCF: tendons and equalities."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from morphkit.ablation.limb_scale import SAME
from morphkit.formats.poses import text
from morphkit.scaling.attributes import multiply, multiply_values, read
from morphkit.scaling.mjcf_limbs import Limbs


def has_spatial(root: Any) -> bool:
    """Whether there are tendons whose length only a compiled model tells."""
    return root.find("tendon/spatial") is not None


def tendon_factors(limbs: Limbs, before: Sequence[float] = (), after: Sequence[float] = ()) -> dict[str, float]:
    """Factor of the length of each tendon: that of its measured length, or of the joints that it adds up.

    Args:
        limbs: The bodies.
        before: Lengths of all tendons in the zero pose before the bodies were scaled; empty where they are as before.
        after: The same afterwards.
    """
    factors = {}
    for number, (name, tendon) in enumerate(_tendons(limbs.root)):
        if tendon.tag == "spatial":
            factors[name] = after[number] / before[number] if before and before[number] > 0 else 1.0
        else:
            factors[name] = _mean(limbs.travel.get(each.get("joint", ""), 1.0) for each in tendon.iterfind("joint"))
    return factors


def tendon_gain(limbs: Limbs, name: str) -> float:
    """Factor of the forces of a tendon: the geometric mean of those of the limbs that it runs along."""
    return next((_gain(limbs, tendon) for known, tendon in _tendons(limbs.root) if known == name), 1.0)


def scale_tendons(limbs: Limbs, factors: Mapping[str, float]) -> None:
    """Scale the lengths and force limits that tendons have of their own."""
    for (name, tendon), parsed in zip(_tendons(limbs.root), limbs.parsed.tendons, strict=True):
        multiply_values(tendon, "range", factors[name], parsed.range)
        multiply_values(tendon, "actuatorfrcrange", _gain(limbs, tendon), parsed.actfrcrange)
        if parsed.springlength[0] >= 0:
            multiply_values(tendon, "springlength", factors[name], parsed.springlength)


def scale_equalities(limbs: Limbs, tendons: Mapping[str, float]) -> None:
    """Scale the places at which bodies are joined, and the couplings of joints and tendons."""
    for equality in limbs.root.iterfind("equality/*"):
        first, second = (limbs.named.get(("body", equality.get(key, "")), SAME) for key in ("body1", "body2"))
        if equality.tag == "connect":
            multiply(equality, "anchor", first.length)
        elif equality.tag == "weld":
            multiply(equality, "anchor", second.length)
            multiply(equality, "relpose", (first.length,) * 3)
        elif equality.tag in ("joint", "tendon"):
            known = limbs.travel if equality.tag == "joint" else tendons
            factors = [known.get(equality.get(f"{equality.tag}{end}", ""), 1.0) for end in (1, 2)]
            _scale_polynomial(equality, *factors)


def _scale_polynomial(equality: Any, follower: float, leader: float) -> None:
    """y = a0 + a1 x + ...: with y and x in new units, each coefficient has a factor of its own."""
    if follower == leader == 1:
        return
    values = read(equality, "polycoef", equality.get("polycoef") or "0 1 0 0 0")
    equality.set("polycoef", text(values * follower / leader ** np.arange(len(values))))


def _tendons(root: Any) -> list[tuple[str, Any]]:
    """Name and element of every tendon, in the order of the file."""
    found = enumerate(root.iterfind("tendon/*"))
    return [(tendon.get("name") or f"unnamed {number}", tendon) for number, tendon in found]


def _gain(limbs: Limbs, tendon: Any) -> float:
    parts = ((part.tag, part.get(part.tag, "")) for part in tendon.iterchildren("site", "geom", "joint"))
    return _mean(limbs.named[part].gain for part in parts if part in limbs.named)


def _mean(factors: Iterable[float]) -> float:
    """Geometric mean; 1 of nothing."""
    known = list(factors)
    if len(set(known)) <= 1:
        return known[0] if known else 1.0
    return math.prod(known) ** (1 / len(known))
