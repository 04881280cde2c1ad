"""What a URDF means: one rule, which everything that reads one follows, MuJoCo's importer included.

An edited copy of the tree is handed on, in which nothing is left that readers understand differently. The rule: what is
there twice counts once, the first time; what is not stated in full counts as not stated; what says nothing goes; a
joint that has one position only is fixed there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from lxml import etree

from morphkit.formats.urdf_names import WORLD, Given, name_elements
from morphkit.readers.urdf_held import drop_idle_mimics, hold_joints
from morphkit.readers.urdf_repairs import Repair
from morphkit.readers.urdf_structure import WITH_AXIS, check_urdf
from morphkit.utils.suggest import did_you_mean

MOMENTS = ("ixx", "iyy", "izz")
PRODUCTS = ("ixy", "ixz", "iyz")
_WITHOUT_AXIS = ("fixed", "floating", "spherical")
_LIMITED = ("revolute", "prismatic", "planar")
_FAR = "1e9"  # rad or m
_ONCE = {
    "link": ("inertial",),
    "inertial": ("origin", "mass", "inertia"),
    "visual": ("origin", "geometry", "material"),
    "collision": ("origin", "geometry", "material"),
    "material": ("color", "texture"),
    "joint": (
        "parent", "child", "origin", "axis", "limit", "dynamics", "mimic", "safety_controller", "calibration",
    ),
}  # fmt: skip
_ATTRIBUTES = {
    "origin": ("xyz", "rpy"),
    "axis": ("xyz",),
    "limit": ("lower", "upper", "effort", "velocity"),
    "dynamics": ("damping", "friction"),
    "mimic": ("joint", "multiplier", "offset"),
    "mass": ("value",),
    "inertia": (*MOMENTS, *PRODUCTS),
    "mesh": ("filename", "scale"),
    "box": ("size",),
    "sphere": ("radius",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
}


@dataclass(frozen=True)
class Normalized:
    """A tree after `normalize`.

    Attributes:
        given: Every link and joint, and where its name comes from.
        roots: Names of the links without a parent, in file order.
        repairs: What was changed.
    """

    given: Given
    roots: tuple[str, ...]
    repairs: tuple[Repair, ...]


def normalize(tree: etree._ElementTree, *, file: str) -> Normalized:
    """Edit a URDF in place, so that it says what it means and nothing else; every link and joint gets its own name.

    Raises:
        DescriptionError: As `name_elements` and `check_urdf`.
    """
    root = tree.getroot()
    etree.strip_tags(tree, etree.ProcessingInstruction)  # which MuJoCo's parser refuses
    given = name_elements(root, file=file)
    repairs = [*_renamed_world(given), *drop_repeated(root)]
    roots = check_urdf(tree, file=file)
    repairs += [*settle_parts(root), *hold_joints(root), *drop_idle_mimics(root)]
    return Normalized(given, roots, tuple(repairs))


def _renamed_world(given: Given) -> Iterator[Repair]:
    for element, origin in given:
        if origin.kind == "link" and origin.original == WORLD != origin.given:
            yield Repair("world-inside", element, WORLD, f"link 'world' is no root: it is called {origin.given!r}")


def drop_repeated(root: Any) -> Iterator[Repair]:
    """Take out what URDF has once and the file has again, in place; any tree will do."""
    for owner in root.iterchildren("link", "joint", "material"):
        parts = [owner]
        if owner.tag == "link":
            parts += list(owner.iter("inertial", "visual", "collision", "material", "geometry"))
        for part in parts:
            if part.getroottree().getroot() is root:
                yield from _drop_repeated(part, owner)


def _drop_repeated(part: Any, owner: Any) -> Iterator[Repair]:
    seen: set[str] = set()
    for child in [child for child in part if isinstance(child.tag, str)]:
        tag = "geometry" if part.tag == "geometry" else child.tag
        if part.tag != "geometry" and tag not in _ONCE.get(part.tag, ()):
            continue
        if tag in seen:
            what = "shape" if part.tag == "geometry" else f"<{tag}>"
            where = f"{_of(owner)}" if part is owner else f"a <{part.tag}> of {_of(owner)}"
            text = f"{where} has a second {what}; the first counts"
            part.remove(child)
            yield Repair("element-repeated", child, owner.get("name") or "", text)
        seen.add(tag)


def settle_parts(root: Any) -> Iterator[Repair]:
    """Complete inertials and take out axes and masses without a meaning, in place; any tree will do."""
    yield from misspelled(root)
    children = {child.get("link") for child in root.iterfind("joint/child")}
    for link in root.iterchildren("link"):
        for inertial in link.iterfind("inertial"):
            if link.get("name") == WORLD and WORLD not in children:
                link.remove(inertial)
                yield Repair("world-mass", inertial, WORLD, "link 'world' is the world: its <inertial> counts as none")
            else:
                yield from _settle_inertial(link, inertial)
    for joint in root.iterchildren("joint"):
        for limit in joint.iterfind("limit"):
            yield from _settle_limit(joint, limit)
        if joint.get("type") in _WITHOUT_AXIS:
            for axis in joint.findall("axis"):
                joint.remove(axis)


def _settle_inertial(link: Any, inertial: Any) -> Iterator[Repair]:
    owner, name = _of(link), link.get("name") or ""
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    if mass is None or mass.get("value") is None:
        link.remove(inertial)
        yield Repair("inertial-incomplete", inertial, name, f"{owner} states no mass; its <inertial> counts as none")
        return
    if _is_zero(mass.get("value")):
        link.remove(inertial)
        stated = inertia is not None and not all(_is_zero(inertia.get(key, "0")) for key in (*MOMENTS, *PRODUCTS))
        if stated:
            yield Repair("inertia-massless", inertia, name, f"{owner} has mass 0; its inertia counts as none")
        return
    if inertia is None:
        inertia = inertial.makeelement("inertia", dict.fromkeys((*MOMENTS, *PRODUCTS), "0"))
        inertial.append(inertia)
        yield Repair("inertial-incomplete", inertial, name, f"{owner} has a mass and no inertia, which counts as zero")
        return
    lacking = [key for key in (*MOMENTS, *PRODUCTS) if inertia.get(key) is None]
    if not lacking:
        return
    if any(key in MOMENTS for key in lacking):
        text = f"the inertia of {owner} lacks {', '.join(lacking)}; all of it counts as zero"
        lacking = [*MOMENTS, *PRODUCTS]
    else:
        text = f"the inertia of {owner} lacks {', '.join(lacking)}, which count{'s' * (len(lacking) == 1)} as zero"
    for key in lacking:
        inertia.set(key, "0")
    yield Repair("inertial-incomplete", inertia, name, text)


def _settle_limit(joint: Any, limit: Any) -> Iterator[Repair]:
    """Write infinite numbers as MuJoCo reads them; a joint is bounded on both sides or none, a ball joint on none."""
    bounds = [key for key in ("lower", "upper") if limit.get(key) is not None]
    if joint.get("type") == "spherical" and bounds:
        for key in bounds:
            del limit.attrib[key]
        text = f"{' and '.join(bounds)} of spherical {_of(joint)} count for nothing: it has no single position"
        yield Repair("limit-ignored", limit, joint.get("name") or "", text)
    infinite = [key for key in _ATTRIBUTES["limit"] if _is_infinite(limit.get(key))]
    sides = [key for key in infinite if key in ("lower", "upper")]
    for key in infinite:
        sign = "-" * limit.get(key).strip().startswith("-")
        if key not in sides:
            limit.set(key, f"{sign}inf")
        elif len(sides) == 2:
            del limit.attrib[key]
        else:
            limit.set(key, f"{sign}{_FAR}")
    if sides:
        text = f"{' and '.join(sides)} of {_of(joint)} {'are' if len(sides) > 1 else 'is'} infinite: no bound"
        yield Repair("number-infinite", limit, joint.get("name") or "", text)
    if joint.get("type") in _LIMITED:
        yield from _settle_bounds(joint, limit)


def _settle_bounds(joint: Any, limit: Any) -> Iterator[Repair]:
    """A bound that is not stated beside the other is 0, as URDF has it; bounds in the wrong order are none."""
    name, stated = joint.get("name") or "", [key for key in ("lower", "upper") if limit.get(key) is not None]
    if len(stated) == 1:
        other = "upper" if stated == ["lower"] else "lower"
        limit.set(other, "0")
        yield Repair("limit-partial", limit, name, f"{_of(joint)} states no {other}, which counts as 0")
    low, high = (_number(limit.get(key)) for key in ("lower", "upper"))
    if low is not None and high is not None and low > high:
        for key in ("lower", "upper"):
            del limit.attrib[key]
        yield Repair("limit-inverted", limit, name, f"{_of(joint)} has lower {low:g} above upper {high:g}: no bound")


def misspelled(root: Any) -> Iterator[Repair]:
    """Name attributes that look like one that is missing there; any tree will do."""
    for owner in root.iterchildren("link", "joint"):
        for part in owner.iter(*_ATTRIBUTES):
            if part.tag == "axis" and part.get("xyz") is None and owner.get("type") in WITH_AXIS:
                continue  # that is refused
            known = _ATTRIBUTES[part.tag]
            absent = [key for key in known if part.get(key) is None]
            for key in part.attrib:
                if key not in known and any(_resembles(key, other) for other in absent):
                    hint = did_you_mean(key, absent)
                    text = f"<{part.tag}> of {_of(owner)} has the attribute {key!r}, which counts for nothing{hint}"
                    yield Repair("attribute-unknown", part, owner.get("name") or "", text)


def _resembles(key: str, other: str) -> bool:
    """Whether one may be meant for the other: the same letters, another case, or a few letters' difference."""
    return sorted(key.lower()) == sorted(other) or bool(did_you_mean(key.lower(), [other]))


def _of(owner: Any) -> str:
    return f"{owner.tag} {owner.get('name')!r}"


def _is_infinite(text: str | None) -> bool:
    return math.isinf(_number(text) or 0.0)


def _is_zero(text: str) -> bool:
    return _number(text) == 0


def _number(text: str | None) -> float | None:
    try:
        return None if text is None else float(text)
    except ValueError:
        return None
