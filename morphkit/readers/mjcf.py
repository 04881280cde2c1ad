"""MJCF files into `Morphology`, through MuJoCo's own parser, without compiling: meshes may be missing."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
from lxml import etree

from morphkit.description import Description
from morphkit.errors import DescriptionError
from morphkit.formats.document import document_of
from morphkit.formats.limits import check_mjcf
from morphkit.formats.mjcf_attach import prepare_parse
from morphkit.formats.mjcf_include import flattened
from morphkit.formats.mjcf_locations import Places
from morphkit.formats.mjcf_names import name_with_origins
from morphkit.formats.mjcf_schema import reads_file
from morphkit.morphology import Actuator, Base, Joint, JointKind, Limb, Morphology, Origin
from morphkit.naming.limbs import numbered_labels
from morphkit.readers.common import choose_root, type_of
from morphkit.readers.mjcf_actuators import Where, is_limited, joint_range, read_actuators
from morphkit.readers.mjcf_sensors import read_sensors

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
    spec, origins, where = _parse(description)
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
        kind = type_of(info, name, [joint.name for joint in joints])
        limbs.append(Limb(name=name, parent=parent, joints=joints, members=tuple(members[name]), type=kind))
    actuators, driven_by = read_actuators(spec, limb_of, where)
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
        actuators=actuators,
        sensors=read_sensors(spec, limb_of),
        labels=numbered_labels(parents, info.labels),
        origins=_of_inputs(origins, actuators, driven_by),
    )


def _of_inputs(
    origins: tuple[Origin, ...], actuators: Iterable[Actuator], elements: Iterable[str]
) -> tuple[Origin, ...]:
    """The origins, with one for each control input in the place of the actuators'."""
    others = [origin for origin in origins if origin.kind != "actuator"]
    own = {origin.given: origin for origin in origins if origin.kind == "actuator"}
    inputs = [replace(own[name], given=actuator.name) for actuator, name in zip(actuators, elements, strict=True)]
    return (*others, *inputs)


def _parse(description: Description) -> tuple[mujoco.MjSpec, tuple[Origin, ...], Where]:
    """Return the parsed model, everything named, where its names come from, and what says where an element is."""
    file = description.file
    document = document_of(description)
    tree = document.tree
    if document.format != "mjcf":
        raise DescriptionError(f"{file}:{document.root.sourceline}: a URDF file, expected MJCF")
    check_mjcf(document.root, file=file)
    places = Places(file, document.root)
    models: dict[str, bytes] = {}
    if any(each.tag != "flexcomp" or reads_file(each) for each in tree.iter("include", "model", "flexcomp")):
        tree = flattened(document, description.folder, file=file, packages=description.packages, read=places.own)
        check_mjcf(tree.getroot(), file=file)
        models = prepare_parse(tree, description, places)
        text = etree.tostring(tree.getroot(), encoding="unicode")
    else:
        text = document.text
    places.add(tree.getroot(), text, file, main=True)
    try:
        spec = mujoco.MjSpec.from_string(text, include=models)
    except Exception as error:
        place = places.of_message(str(error))
        said = re.sub(r",? line \d+", "", str(error)) if place != file else str(error)  # a line of the flattened text
        reason = " ".join(re.sub(r"(XML )?Error:", "", said).split())
        raise DescriptionError(f"{place}: MuJoCo does not accept this MJCF: {reason}") from None
    origins = name_with_origins(spec, places)
    stands = {(origin.kind, origin.given): origin.where for origin in origins}
    return spec, origins, lambda kind, name: stands.get((kind, name)) or file


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
