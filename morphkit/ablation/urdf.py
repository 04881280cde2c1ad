"""Prune and splice in a URDF tree."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import Any

from morphkit.ablation.loss import Loss
from morphkit.ablation.plan import Plan
from morphkit.ablation.urdf_references import Removed, prune_references
from morphkit.formats.edit import detach, lift
from morphkit.formats.poses import Pose, identity, urdf_pose, write_urdf
from morphkit.formats.urdf_names import Given, take_back
from morphkit.readers.urdf import joints_with_motor
from morphkit.readers.urdf_held import held_joints, rest_pose


def link_parents(root: Any) -> dict[str, str | None]:
    """Parent of every link in depth-first file order; None at the top."""
    children: dict[str, list[str]] = {}
    below: set[str] = set()
    for joint in root.iterfind("joint"):
        parent, child = ends(joint)
        children.setdefault(parent, []).append(child)
        below.add(child)
    parents: dict[str, str | None] = {}
    tops = [str(link.get("name")) for link in root.iterfind("link") if link.get("name") not in below]
    pending: list[tuple[str, str | None]] = [(name, None) for name in reversed(tops)]
    while pending:
        name, parent_name = pending.pop()
        parents[name] = parent_name
        pending += [(child, name) for child in reversed(children.get(name, []))]
    return parents


def ends(joint: Any) -> tuple[str, str]:
    """Names of the links that a joint joins: parent, child."""
    return joint.find("parent").get("link", ""), joint.find("child").get("link", "")


def cut(root: Any, plan: Plan, given: Given) -> list[Loss]:
    """Edit the tree below the `<robot>` element in place.

    Args:
        root: The `<robot>` element, its links and joints named as the reader names them.
        plan: What goes.
        given: Those names, which are taken back.

    Returns:
        What went besides the links themselves.
    """
    removed: Removed = {}
    lost: list[Loss] = []
    names = joints_with_motor(root)
    driven = [joint for joint in root.iterchildren("joint") if joint.get("name") in names]
    joint_of = {ends(joint)[1]: joint for joint in root.iterfind("joint")}
    for link, limb in plan.gone.items():
        removed[("link", link)] = limb
        if limb != link:
            lost.append(Loss("link", link, limb, f"fixed to {limb}"))
        joint = joint_of[link]
        name = joint.get("name", "")
        removed[("joint", name)] = limb
        if joint.get("type") != "fixed":
            lost.append(Loss("joint", name, limb, f"part of {limb}"))
    moved = list(_splice(root, plan, joint_of, held_joints(root)))
    lost += _keep_materials(root, plan.gone)
    for element in [*root.iterfind("link"), *root.iterfind("joint")]:
        kind = str(element.tag)
        if (kind, element.get("name", "")) in removed and not any(element is joint for joint in moved):
            detach(element)
    take_back(given, root)
    lost += prune_references(root, _as_in_file(removed, given))
    return [*lost, *_gained_motors(root, driven)]


def _gained_motors(root: Any, driven: Collection[Any]) -> Iterator[Loss]:
    """Say which joints have a motor now and had none before; those that were `driven` had one."""
    names = joints_with_motor(root)
    stated = next(root.iterchildren("transmission"), None) is not None
    why = "a transmission names it" if stated else "without transmissions, each joint with an effort limit has one"
    for joint in root.iterchildren("joint"):
        name = joint.get("name", "")
        if name in names and not any(joint is other for other in driven):
            yield Loss("actuator", name, "", f"gained: joint {name} has a motor of its own now: {why}")


def _as_in_file(removed: Removed, given: Given) -> Removed:
    """`removed` by the names that the file has; what has none there, nothing refers to."""
    originals = {(origin.kind, origin.given): origin.original for _, origin in given}
    return {(kind, original): limb for (kind, name), limb in removed.items() if (original := originals[(kind, name)])}


def _keep_materials(root: Any, gone: Mapping[str, str]) -> Iterator[Loss]:
    """Make materials that links to be removed define for others the robot's own, where those links were.

    Links share materials by name. Unless the robot has one of that name, the first definition in the file counts: in
    urdfdom (`assignMaterial`) for every link, in MuJoCo's importer for links that only name it. For both, what is left
    looks the same after the cut as before.
    """
    settled = {material.get("name") for material in root.iterfind("material") if len(material)} | {None, ""}
    definition: dict[str, tuple[Any, Any]] = {}
    left: dict[str, Any] = {}
    for link in root.iterfind("link"):
        for material in link.iter("material"):
            name = material.get("name")
            if name in settled:
                continue
            if len(material):
                definition.setdefault(name, (link, material))
            if link.get("name") not in gone:
                left.setdefault(name, material)
    for name, (link, material) in definition.items():
        limb = gone.get(link.get("name", ""))
        if limb is not None and name in left and _parts(left[name]) != _parts(material):
            lift(material, link)
            yield Loss("material", name, limb, "defined in a link that went for others too; it is the robot's own now")


def _parts(material: Any) -> list[tuple[str, dict[str, str]]]:
    return [(part.tag, dict(part.attrib)) for part in material.iterchildren("*")]


def _splice(root: Any, plan: Plan, joint_of: dict[str, Any], held: dict[str, float]) -> Iterator[Any]:
    """Hang what hung on spliced links on the link above them; yield the joints that moved."""
    splice = set(plan.splice)
    for joint in root.iterfind("joint"):
        parent, child = ends(joint)
        if parent not in splice or child in plan.gone:
            continue
        between = identity()
        top = joint
        link = parent
        while link in splice:
            top = joint_of[link]
            between = rest_pose(top, held) @ between
            link = ends(top)[0]
        own = urdf_pose(joint.find("origin"))
        anchor = urdf_pose(top.find("origin")).position
        pose = Pose(anchor, (between @ own).rotation)
        origin = joint.find("origin")
        if origin is None:
            origin = joint.makeelement("origin")
            origin.tail = joint.text
            joint.insert(0, origin)
        write_urdf(origin, pose, keep_orientation=not between.turned)
        joint.find("parent").set("link", link)
        yield joint
