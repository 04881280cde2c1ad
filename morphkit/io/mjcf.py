"""MJCF files into `Morphology`, through MuJoCo's own parser, without compiling: meshes may be missing."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np
from lxml import etree

from morphkit.description import Description
from morphkit.errors import DescriptionError
from morphkit.io import xml
from morphkit.io.actuators import Where, is_limited, joint_range, read_actuators
from morphkit.io.attached import locate_models
from morphkit.io.common import Names, choose_root, limb_type
from morphkit.io.limits import check_mjcf
from morphkit.io.resolve import flatten_includes
from morphkit.io.sensors import read_sensors
from morphkit.morphology import Base, Joint, JointKind, Limb, Morphology

_KINDS: dict[Any, JointKind] = {
    mujoco.mjtJoint.mjJNT_HINGE: "hinge",
    mujoco.mjtJoint.mjJNT_SLIDE: "slide",
    mujoco.mjtJoint.mjJNT_BALL: "ball",
    mujoco.mjtJoint.mjJNT_FREE: "free",
}


def read_mjcf(description: Description) -> Morphology:
    """Read an MJCF description.

    A body without joints belongs to the limb that carries it. The joints of the root body say how it is attached: a
    free joint, or two slides and a hinge across them, are its base. A root with other joints, such as an arm whose
    first link turns on the world, has base `fixed`: they too are no part of the root limb, whose pose tokens show
    their state, but the actuators that drive them name them.

    Raises:
        DescriptionError: Not MJCF, a name used twice, no body, or several top-level bodies and no `description.root`.
        AssetError: An included file is missing.
        UnknownNameError: `description.root` is no top-level body.
    """
    file, info = description.file, description.info
    spec, where = _parse(description)
    tops = spec.worldbody.bodies
    if not tops:
        raise DescriptionError(f"{file}: no <body> in <worldbody>; a robot needs at least one")
    root_name = choose_root([body.name for body in tops], description.root, file=file, element="body")
    root = next(body for body in tops if body.name == root_name)
    limb_of, joints_of = _limbs(root)
    members: dict[str, list[str]] = {}
    parents: dict[str, str | None] = {}
    for body in subtree(root):
        limb = limb_of[body.name]
        members.setdefault(limb, []).append(body.name)
        if limb == body.name:
            parents[limb] = None if body is root else limb_of[body.parent.name]
    limbs = []
    for name, parent in parents.items():
        joints = () if parent is None else tuple(_joint(spec, joint) for joint in joints_of[name])
        kind = limb_type(info, name, [joint.name for joint in joints])
        limbs.append(Limb(name=name, parent=parent, joints=joints, members=tuple(members[name]), type=kind))
    return Morphology(
        name=description.name,
        file=file,
        format="mjcf",
        sha256=description.sha256,
        base=info.base or _base(joints_of[root.name]),
        family=info.family,
        task=info.task,
        type_words=info.type_words,
        limbs=tuple(limbs),
        actuators=read_actuators(spec, limb_of, where),
        sensors=read_sensors(spec, limb_of),
    )


def _parse(description: Description) -> tuple[mujoco.MjSpec, Where]:
    """Return the parsed model, everything named, and what turns an element's `info` into `file:line`."""
    file = description.file
    tree = xml.parse(description.source, file=file)
    if xml.root_format(tree, file=file) != "mjcf":
        raise DescriptionError(f"{file}:{tree.getroot().sourceline}: a URDF file, expected MJCF")
    check_mjcf(tree.getroot(), file=file)
    edited = next(tree.iter("include", "model"), None) is not None  # then MuJoCo's line numbers are not the file's
    if edited:
        flatten_includes(tree, description.folder, file=file, packages=description.packages)
        check_mjcf(tree.getroot(), file=file)
        locate_models(tree, description)
        text = etree.tostring(tree.getroot(), encoding="unicode")
    else:
        text = xml.decode(description.source, tree)

    def where(info: str) -> str:
        line = re.search(r"line (\d+)", info or "")
        return f"{file}:{line[1]}" if line and not edited else file

    try:
        spec = mujoco.MjSpec.from_string(text)
    except Exception as error:
        reason = " ".join(re.sub(r"(XML )?Error:", "", str(error)).split())
        raise DescriptionError(f"{where(str(error))}: MuJoCo does not accept this MJCF: {reason}") from None
    name_elements(spec)
    return spec, where


def name_elements(spec: mujoco.MjSpec) -> None:
    """Give every unnamed body, joint and actuator of `spec` its deterministic name, in place.

    A body is called `body_<id>` by its id in the compiled model, a joint `<body>_joint`, an actuator after what it
    drives; a number is added where the name is taken.
    """
    names = Names(body.name for body in spec.bodies)
    for number, body in enumerate(spec.bodies):
        if not body.name:
            body.name = names.give(f"body_{number}")
    names = Names(joint.name for joint in spec.joints)
    for joint in spec.joints:
        if not joint.name:
            joint.name = names.give(f"{joint.parent.name}_joint")
    names = Names(actuator.name for actuator in spec.actuators)
    for actuator in spec.actuators:
        if not actuator.name:
            actuator.name = names.give(actuator.target or "actuator")


def subtree(root: Any) -> Iterator[Any]:
    """Yield an MjSpec body and all bodies below it, depth first in file order."""
    pending = [root]
    while pending:
        body = pending.pop()
        yield body
        pending.extend(reversed(body.bodies))


def _limbs(root: Any) -> tuple[dict[str, str], dict[str, list[Any]]]:
    limb_of: dict[str, str] = {}
    joints_of: dict[str, list[Any]] = {}
    for body in subtree(root):
        joints = list(body.joints)
        joints_of[body.name] = joints
        limb_of[body.name] = body.name if joints or body is root else limb_of[body.parent.name]
    return limb_of, joints_of


def _joint(spec: mujoco.MjSpec, joint: Any) -> Joint:
    kind = _KINDS[joint.type]
    low, high = joint_range(joint)
    limited = is_limited(spec, joint.limited, low, high) and kind != "free"
    return Joint(joint.name, kind, limited, low if limited else 0.0, high if limited else 0.0)


def _base(joints: list[Any]) -> Base:
    kinds = sorted(_KINDS[joint.type] for joint in joints)
    if kinds == ["free"] or kinds in (["ball", "slide", "slide", "slide"], ["hinge"] * 3 + ["slide"] * 3):
        return "free"
    if kinds == ["hinge", "slide", "slide"]:
        hinge = next(joint for joint in joints if _KINDS[joint.type] == "hinge")
        slides = [joint for joint in joints if joint is not hinge]
        if all(abs(float(np.dot(hinge.axis, slide.axis))) < 1e-6 for slide in slides):
            return "planar"
    return "fixed"
