"""Bodies with the limbs of another one in other sizes: shorter by up to 30 %, thicker or thinner by up to 40 %."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
from lxml import etree

from morphkit.description import Description
from morphkit.formats.document import document_of

SHORTEST, THICKEST = 0.7, 1.4


def resized(body: Description, seed: int) -> Description:
    """An MJCF body of capsules, spheres and the like whose limbs have other lengths and radii, and so other masses.

    The root keeps its length, so that it starts where it did. Motors, joints and names stay.
    """
    rng = np.random.default_rng([seed, *body.name.encode()])
    tree = copy.deepcopy(document_of(body).tree)
    (root,) = tree.getroot().find("worldbody").findall("body")
    for limb in root.iter("body"):
        length = 1.0 if limb is root else rng.uniform(SHORTEST, 1)
        radius = float(np.exp(rng.uniform(-1, 1) * np.log(THICKEST)))
        for geom in limb.findall("geom"):
            _scale(geom, "fromto", length)
            _scale(geom, "pos", length)
            _scale(geom, "size", radius, *([] if geom.get("fromto") else [length, length]))
        for child in limb.findall("body"):
            _scale(child, "pos", length)
    return Description(
        name=f"{body.name}-size-{seed}",
        file=body.file,
        format=body.format,
        source=etree.tostring(tree),
        folder=body.folder,
        info=replace(body.info, expert_return=None),
    )


def _scale(element: etree._Element, attribute: str, *factors: float) -> None:
    """Multiply the numbers of an attribute, the last factor for all that remain."""
    numbers = element.get(attribute, "").split()
    if numbers:
        each = [*factors, *[factors[-1]] * len(numbers)]
        element.set(attribute, " ".join(f"{float(n) * f:.6g}" for n, f in zip(numbers, each, strict=False)))
