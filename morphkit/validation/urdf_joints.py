"""Checks of the joints of a URDF: axes, limits, mimics, and what drives them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from morphkit.formats.urdf_transmissions import driven_joints
from morphkit.readers.urdf_structure import SHORTEST_AXIS, WITH_AXIS, without_direction
from morphkit.validation.common import read_numbers, start_is_said, unknown
from morphkit.validation.document import CheckedDocument, elements
from morphkit.validation.urdf_tree import UrdfTree

_ONE, _THREE = range(1, 2), range(3, 4)
_NEEDS_LIMIT = ("revolute", "prismatic")
_MOVING = ("revolute", "continuous", "prismatic")
_TURNS = 6 * math.pi
_MOST_DEGREES = 1080.0
_UNIT_TOLERANCE = 1e-3
_RANGE_TOLERANCE = 0.02


def check_joints(doc: CheckedDocument, tree: UrdfTree, start: str | Mapping[str, float] = "") -> None:
    """Report what is wrong with joints by themselves, and those that nothing drives.

    Args:
        doc: The robot.
        tree: Its links and joints.
        start: What `robot.toml` says of the start pose.
    """
    limits = {name: _check_joint(doc, name, joint) for name, joint in tree.joints.items()}
    for name, found in limits.items():
        if (
            found is not None
            and found[0] < found[1]
            and not found[0] <= 0 <= found[1]
            and not start_is_said(name, start)
        ):
            what = f"joint {name!r} moves from {found[0]:g} to {found[1]:g}, without 0"
            doc.add("zero-outside", next(iter(elements(tree.joints[name], "limit"))), what, name=name)
    carried = {child for _, child in tree.ends.values()}
    for name, (parent, _) in tree.ends.items():
        if tree.joints[name].get("type") == "floating" and (parent in carried or parent != "world"):
            doc.add("floating-inside", tree.joints[name], f"floating joint {name!r} hangs on {parent!r}", name=name)
    _check_mimics(doc, tree, limits)
    _check_drives(doc, tree)


def _check_joint(doc: CheckedDocument, name: str, joint: Any) -> tuple[float, float] | None:
    """Check one joint and return its limits where it has proper ones."""
    owner, kind = f"joint {name!r}", joint.get("type")
    for element in elements(joint, "origin"):
        read_numbers(doc, element, "xyz", _THREE, owner=owner)
        read_numbers(doc, element, "rpy", _THREE, owner=owner)
    for element in elements(joint, "axis"):
        axis = read_numbers(doc, element, "xyz", _THREE, owner=owner)
        length = math.hypot(*axis) if axis is not None else 1.0
        if kind in WITH_AXIS and length < SHORTEST_AXIS:
            doc.add("axis-zero", element, f"{owner} has the axis {element.get('xyz')}", name=name)
        elif kind in WITH_AXIS and element.get("xyz") is None:
            doc.add("axis-missing", element, f"{owner} has {without_direction(element)}", name=name)
        elif kind in _MOVING and abs(length - 1) > _UNIT_TOLERANCE:
            doc.add("axis-length", element, f"{owner} has an axis of length {length:.4g}", name=name)
    for element in elements(joint, "dynamics"):
        for attribute in ("damping", "friction"):
            value = read_numbers(doc, element, attribute, _ONE, owner=owner)
            if value is not None and value[0] < 0:
                doc.add("dynamics-negative", element, f"{owner} has {attribute} {value[0]:g}", name=name)
    for element in elements(joint, "mimic"):
        for attribute in ("multiplier", "offset"):
            read_numbers(doc, element, attribute, _ONE, owner=owner)
    limit = next(iter(elements(joint, "limit")), None)
    if limit is None:
        if kind in _NEEDS_LIMIT:
            doc.add("limit-missing", joint, f"{kind} {owner} has no <limit>", name=name)
        return None
    return _check_limit(doc, name, str(kind), limit, mimics=bool(elements(joint, "mimic")))


def _check_limit(doc: CheckedDocument, name: str, kind: str, limit: Any, *, mimics: bool) -> tuple[float, float] | None:
    owner = f"joint {name!r}"
    values = {key: read_numbers(doc, limit, key, _ONE, owner=owner) for key in ("lower", "upper", "effort", "velocity")}
    if kind in _MOVING:
        for attribute in ("effort", "velocity"):
            value = values[attribute]
            if limit.get(attribute) is None:
                doc.add(f"{attribute}-missing", limit, f"{owner} has no {attribute} limit", name=name)
            elif value is not None and value[0] <= 0 and not mimics:
                doc.add(f"{attribute}-zero", limit, f"{owner} has {attribute} limit {value[0]:g}", name=name)
    if kind not in _NEEDS_LIMIT:
        return None
    if limit.get("lower") is None and limit.get("upper") is None:
        doc.add("limit-empty", limit, f"{kind} {owner} has neither lower nor upper: it moves freely", name=name)
        return None
    if any(limit.get(key) is not None and values[key] is None for key in ("lower", "upper")):
        return None  # no number, which is reported
    low, high = ((values[key] or [0.0])[0] for key in ("lower", "upper"))
    if low > high:
        doc.add("limit-inverted", limit, f"{owner} has lower {low:g} above upper {high:g}", name=name)
        return None
    if low == high:
        doc.add("limit-empty", limit, f"{owner} has lower and upper {low:g}: it is held there", name=name)
        return low, high
    largest = max(abs(low), abs(high))
    if kind == "revolute" and _TURNS < largest <= _MOST_DEGREES:
        doc.add("limit-degrees", limit, f"{owner} turns from {low:g} to {high:g} rad", name=name)
    return low, high


def _check_mimics(doc: CheckedDocument, tree: UrdfTree, limits: dict[str, tuple[float, float] | None]) -> None:
    target_of: dict[str, str] = {}
    for name, joint in tree.joints.items():
        for mimic in elements(joint, "mimic"):
            target = mimic.get("joint") or ""
            if target not in tree.joints:
                continue
            target_of[name] = target
            if "fixed" in (joint.get("type"), tree.joints[target].get("type")):
                doc.add("mimic-fixed", mimic, f"joint {name!r} mimics {target!r}, and one of them is fixed", name=name)
            elif any(found is not None and found[0] == found[1] for found in (limits[name], limits[target])):
                doc.add("mimic-fixed", mimic, f"joint {name!r} mimics {target!r}, and one of them is held", name=name)
            elif any(each.get("type") not in _MOVING for each in (joint, tree.joints[target])):
                doc.add("mimic-fixed", mimic, f"joint {name!r} cannot follow {target!r}: their types differ", name=name)
            elif (own := limits[name]) is not None and (leader := limits[target]) is not None:
                _check_mimic_range(doc, name, mimic, own, leader)
    safe: set[str] = set()
    for start in target_of:
        path: dict[str, None] = {}
        joint_name: str | None = start
        while joint_name in target_of and joint_name not in safe and joint_name not in path:
            path[joint_name] = None
            joint_name = target_of[joint_name]
        if joint_name in path:
            ring = list(path)[list(path).index(str(joint_name)) :]
            doc.add("mimic-cycle", tree.joints[ring[0]], " mimics ".join([*ring, ring[0]]), name=ring[0])
        safe.update(path)


def _check_mimic_range(
    doc: CheckedDocument, name: str, mimic: Any, own: tuple[float, float], leader: tuple[float, float]
) -> None:
    try:
        factor, offset = float(mimic.get("multiplier") or 1.0), float(mimic.get("offset") or 0.0)
    except ValueError:
        return  # reported with the other numbers
    low, high = sorted(factor * value + offset for value in leader)
    slack = _RANGE_TOLERANCE * (own[1] - own[0])
    if low < own[0] - slack or high > own[1] + slack:
        what = f"joint {name!r} is driven from {low:.4g} to {high:.4g}, beyond its limits {own[0]:g} to {own[1]:g}"
        doc.add("mimic-range", mimic, what, name=name)


def _check_drives(doc: CheckedDocument, tree: UrdfTree) -> None:
    """Report transmissions that drive nothing, and moving joints without one where the file has transmissions."""
    driven: set[str] = set()
    blocks = elements(doc.root, "transmission")
    for block in blocks:
        label = f"transmission {block.get('name')!r}"
        names = driven_joints(block)
        if not names:
            doc.add("transmission-idle", block, f"{label} names no joint", name=block.get("name") or "")
        for element, joint in names:
            driven.add(joint)
            if joint not in tree.joints:
                what = f"{label} drives {unknown(doc, 'joint', joint, tree.joints)}"
                doc.add("reference-ignored", element, what, name=block.get("name") or "")
            elif tree.joints[joint].get("type") == "fixed":
                doc.add("transmission-idle", element, f"{label} drives fixed joint {joint!r}", name=joint)
    driven |= {
        each.get("name") or "" for control in elements(doc.root, "ros2_control") for each in control.iter("joint")
    }
    if not blocks:
        return  # then joints with an effort limit are driven, and the others are reported by their limit
    for name, joint in tree.joints.items():
        if joint.get("type") in _MOVING and name not in driven and not elements(joint, "mimic"):
            what = f"joint {name!r} has no transmission, and mimics no other"
            doc.add("joint-unactuated", joint, what, name=name)
