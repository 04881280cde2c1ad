"""Where the bodies of a robot are at rest, as its file says, without compiling it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from morphkit.ablation.mjcf import read_angles
from morphkit.ablation.urdf import ends
from morphkit.formats.poses import identity
from morphkit.readers.urdf_held import held_joints, rest_pose

Positions = Mapping[str, np.ndarray]
"""Body or link name -> its origin in the root's frame at rest, shape (3,), m."""


def mjcf_positions(root: Any, bodies: Mapping[str, Any], base: str) -> Positions:
    """Positions of all bodies below `base`, itself included.

    Args:
        root: The `<mujoco>` element.
        bodies: Element of each body, by name.
        base: Name of the root body.
    """
    angles = read_angles(root)
    found = {}
    for name, element in bodies.items():
        pose = identity()
        for part in [element, *element.iterancestors("body", "frame")]:
            if part is bodies[base]:
                found[name] = pose.position
                break
            pose = angles.pose(part) @ pose
    return found


def urdf_positions(root: Any, base: str) -> Positions:
    """Positions of all links below `base`, itself included; `root` is the `<robot>` element."""
    held = held_joints(root)
    below: dict[str, list[tuple[str, Any]]] = {}
    for joint in root.iterfind("joint"):
        parent, child = ends(joint)
        below.setdefault(parent, []).append((child, joint))
    poses = {base: identity()}
    pending = [base]
    while pending:
        link = pending.pop()
        for child, joint in below.get(link, ()):
            poses[child] = poses[link] @ rest_pose(joint, held)
            pending.append(child)
    return {name: pose.position for name, pose in poses.items()}
