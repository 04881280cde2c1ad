"""Joints of a URDF that cannot move: their limits are one number, or they mimic a joint that cannot move."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from morphkit.formats.poses import Pose, identity, numbers, urdf_pose, write_urdf
from morphkit.readers.urdf_repairs import Repair

_LIMITED = ("revolute", "prismatic")
_SCALAR = (*_LIMITED, "continuous")
_OF_MOTION = ("axis", "limit", "dynamics", "mimic", "safety_controller", "calibration")


def held_joints(root: Any) -> dict[str, float]:
    """Name of each joint that is held -> where, rad or m.

    Args:
        root: The `<robot>` element, its joints all of different names and its numbers numbers.
    """
    joints = {joint.get("name"): joint for joint in root.iterchildren("joint")}
    held = {name: value for name, joint in joints.items() if (value := _only_position(joint)) is not None}
    followers: dict[str | None, list[str]] = {}
    for name, joint in joints.items():
        mimic = joint.find("mimic")
        if mimic is not None and name not in held and joint.get("type") in _SCALAR:
            followers.setdefault(mimic.get("joint"), []).append(name)
    still = {name: 0.0 for name, joint in joints.items() if joint.get("type") == "fixed"}
    pending = list((still | held).items())
    while pending:
        leader, position = pending.pop()
        for name in followers.pop(leader, ()):
            mimic = joints[name].find("mimic")
            held[name] = float(mimic.get("multiplier") or 1) * position + float(mimic.get("offset") or 0)
            pending.append((name, held[name]))
    return {name: value for name, value in held.items() if _axis(joints[name]) is not None and math.isfinite(value)}


def rest_pose(joint: Any, held: dict[str, float]) -> Pose:
    """The pose of a joint's child in its parent where the joint is at 0, or where it is held."""
    pose = urdf_pose(joint.find("origin"))
    position, axis = held.get(joint.get("name")), _axis(joint)
    if not position or axis is None:
        return pose
    motion = identity()
    if joint.get("type") == "prismatic":
        motion = Pose(axis * position, motion.rotation)
    else:
        mujoco.mju_axisAngle2Quat(motion.rotation, axis, position)
    return pose @ motion


def hold_joints(root: Any) -> Iterator[Repair]:
    """Make the joints that are held fixed ones, at the place where they are held."""
    held = held_joints(root)
    for joint in root.iterchildren("joint"):
        name = joint.get("name")
        if name not in held:
            continue
        pose, unit = rest_pose(joint, held), "m" if joint.get("type") == "prismatic" else "rad"
        why = "its limits are equal" if _only_position(joint) is not None else "it mimics a joint that cannot move"
        origin = joint.find("origin")
        if origin is None:
            origin = joint.makeelement("origin")
            joint.append(origin)
        if held[name]:
            write_urdf(origin, pose, keep_orientation=False)
        for part in list(joint.iterchildren(*_OF_MOTION)):
            joint.remove(part)
        joint.set("type", "fixed")
        text = f"joint {name!r} is held at {held[name]:.6g} {unit}: {why}"
        yield Repair("limit-empty", joint, name, text)


def drop_idle_mimics(root: Any) -> Iterator[Repair]:
    """Take out mimics that say nothing: of the joint itself, of or by a joint that has no single position."""
    kinds = {joint.get("name"): joint.get("type") for joint in root.iterchildren("joint")}
    for joint in root.iterchildren("joint"):
        name = joint.get("name")
        for mimic in joint.findall("mimic"):
            leader = mimic.get("joint")
            if name == leader:
                text = f"joint {name!r} mimics itself, which says nothing"
                rule = "mimic-cycle"
            elif kinds[name] not in _SCALAR or kinds[leader] not in _SCALAR:
                text = f"joint {name!r} cannot follow {leader!r}: {kinds[name]} and {kinds[leader]}; its mimic goes"
                rule = "mimic-fixed"
            else:
                continue
            joint.remove(mimic)
            yield Repair(rule, joint, name, text)


def _only_position(joint: Any) -> float | None:
    """Where the joint's limits hold it; None where they do not, or state nothing."""
    limit = joint.find("limit")
    if joint.get("type") not in _LIMITED or limit is None:
        return None
    stated = [limit.get(key) for key in ("lower", "upper")]
    low, high = (float(text) if text is not None else 0.0 for text in stated)
    return low if low == high and stated != [None, None] else None


def _axis(joint: Any) -> np.ndarray | None:
    """The unit vector along which a joint moves; None where its axis has no direction."""
    element = joint.find("axis")
    axis = numbers(element.get("xyz", "")) if element is not None else np.array([1.0, 0.0, 0.0])
    length = float(np.linalg.norm(axis))
    return axis / length if length > 0 and np.isfinite(length) else None
