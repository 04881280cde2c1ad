"""Prune and splice in an MJCF tree."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from morphkit.ablation.loss import Loss
from morphkit.ablation.mjcf_cameras import cameras, renumber
from morphkit.ablation.mjcf_derived import changed
from morphkit.ablation.mjcf_keyframes import KeyframeLayout
from morphkit.ablation.mjcf_references import Bones, Removed, collect, prune_references
from morphkit.ablation.plan import Plan
from morphkit.errors import AblationError
from morphkit.formats.edit import detach, lift
from morphkit.formats.mjcf_defaults import Defaults, inherited_class
from morphkit.formats.poses import Angles, Pose, identity, numbers, text, write_mjcf

_NO_BONES: Bones = MappingProxyType({})


def body_elements(root: Any) -> list[Any]:
    """All `<body>` elements in the order in which MuJoCo numbers them."""
    return [body for world in root.iterfind("worldbody") for body in world.iter("body")]


def body_parents(bodies: Mapping[str, Any]) -> dict[str, str | None]:
    """Parent of every body in file order; None at the top."""
    names = {id(element): name for name, element in bodies.items()}
    return {
        name: next((names.get(id(above)) for above in element.iterancestors("body")), None)
        for name, element in bodies.items()
    }


def cut(
    root: Any, bodies: Mapping[str, Any], plan: Plan, layout: KeyframeLayout, bones: Bones = _NO_BONES
) -> list[Loss]:
    """Edit the tree below the `<mujoco>` element in place.

    Args:
        root: The root element, includes flattened.
        bodies: Element of each body, by name, in file order.
        plan: What goes.
        layout: That of the file's keyframes.
        bones: The bodies that a skin's file names, by the skin's reference to it.

    Returns:
        What went besides the bodies themselves.
    """
    numbers = layout.number(root)
    before = cameras(root)
    held = list(root.iter()) if numbers else []  # keeps the proxies alive, so that id() identifies an element
    removed: Removed = {}
    lost: list[Loss] = []
    for name, limb in plan.gone.items():
        if limb != name:
            lost.append(Loss("body", name, limb, f"fixed to {limb}"))
        lost += collect(bodies[name], name, limb, removed)
    _splice(root, [bodies[name] for name in plan.splice])
    for name in plan.prune:
        detach(bodies[name])
    lost += prune_references(root, removed, bones)
    lost += renumber(root, before)
    left = {id(element) for element in root.iter()}
    lost += layout.cut(root, [numbers[id(element)] for element in held if id(element) not in left])
    return [*lost, *changed(root)] if plan.gone else lost


def _splice(root: Any, group: list[Any]) -> None:
    """Take `group` out of the tree, bodies first that are higher up; what hangs on them moves up."""
    angles = read_angles(root)
    defaults = Defaults(root)
    inside = {id(body) for body in group}
    for top in group:
        if any(id(ancestor) in inside for ancestor in top.iterancestors("body")):
            continue
        pose = angles.pose(top)
        anchor = pose.apply(first_anchor(top, angles, defaults))
        for child in _children(top, inside):
            _move_up(child, top, angles, defaults, anchor)
        detach(top)


def _children(body: Any, inside: set[int]) -> list[Any]:
    """The nearest bodies below `body` that are not `inside`."""
    found = []
    for child in body:
        if child.tag == "body" and id(child) not in inside:
            found.append(child)
        elif child.tag in ("body", "frame"):
            found += _children(child, inside)
    return found


def _move_up(child: Any, top: Any, angles: Angles, defaults: Defaults, anchor: np.ndarray) -> None:
    """Put `child` in the place of `top`, turned as it is, its joint's anchor at `anchor` in the frame around `top`."""
    between = identity()
    for ancestor in child.iterancestors():
        _refuse_scale(ancestor)
        between = angles.pose(ancestor) @ between
        if ancestor is top:
            break
    own_anchor = first_anchor(child, angles, defaults)
    inherited = inherited_class(child)
    pose = between @ angles.pose(child)
    pose = Pose(anchor - pose.rotate(own_anchor), pose.rotation)
    lift(child, top)
    if child.get("childclass") is None and inherited is not None and inherited_class(child) != inherited:
        child.set("childclass", inherited)
    write_mjcf(child, pose, keep_orientation=not between.turned)


def first_anchor(body: Any, angles: Angles, defaults: Defaults) -> np.ndarray:
    """Where the first joint of `body` is anchored, in its frame; its origin where it has none."""
    joint, around = next(_joints(body, angles), (None, identity()))
    return np.zeros(3) if joint is None else around.apply(numbers(defaults.get(joint, "pos", "0 0 0")))


def _joints(body: Any, angles: Angles) -> Iterator[tuple[Any, Pose]]:
    """The joints of `body` in MuJoCo's order, each with the pose of the frames around it in the body's frame."""
    for child in body.iterchildren("joint", "frame"):
        if child.tag == "joint":
            yield child, identity()
            continue
        for joint, around in _joints(child, angles):
            _refuse_scale(child)
            yield joint, angles.pose(child) @ around


def _refuse_scale(element: Any) -> None:
    if element.tag == "frame" and (element.get("scale") is not None or element.get("massscale") is not None):
        raise AblationError(
            f"line {element.sourceline}: a <frame> with a scale stands between a limb to splice and what hangs on it,"
            " which would lose that scale; remove the limb instead, or write the scaled sizes out"
        )


def read_angles(root: Any) -> Angles:
    """How the file writes angles; several `<compiler>` sections count as one."""
    radian, sequence = False, "xyz"
    for compiler in root.iterfind("compiler"):
        radian = compiler.get("angle", "radian" if radian else "degree") == "radian"
        sequence = compiler.get("eulerseq", sequence)
    return Angles(radian, sequence)


def set_height(root: Any, body: Any, height_m: float) -> None:
    """Put the root `body` at `height_m` above the world's origin.

    Its vertical slide reads the new height where its `ref` read the old one; the slides' `pos` keep their place in the
    world, while hinges move with the body.
    """
    angles = read_angles(root)
    defaults = Defaults(root)
    around = identity()
    for ancestor in body.iterancestors("frame"):
        around = angles.pose(ancestor) @ around
    local = angles.pose(body)
    world = around @ local
    shift = np.array([0.0, 0.0, height_m - world.position[2]])
    position = local.position + around.unrotate(shift)
    if not around.turned:
        position[2] = height_m - around.position[2]
    body.set("pos", text(position))
    for joint, inside in _joints(body, angles):
        if defaults.get(joint, "type", "hinge") != "slide":
            continue
        if joint.get("pos") is not None:
            joint.set("pos", text(numbers(joint.get("pos")) - (world @ inside).unrotate(shift)))
        axis = (world @ inside).rotate(numbers(defaults.get(joint, "axis", "0 0 1")))
        vertical = abs(axis[2]) > 0.999 * float(np.linalg.norm(axis))
        if vertical and float(defaults.get(joint, "ref", "0")) != 0:
            joint.set("ref", text(np.array([height_m])))
