"""URDF files into `Morphology`: lxml checks the source and names lines, yourdfpy says what it means."""

from __future__ import annotations

import copy
import io
import math
from collections.abc import Iterable, Iterator
from typing import Any

from lxml import etree

from morphkit.description import Description
from morphkit.errors import DescriptionError
from morphkit.formats.document import document_of
from morphkit.formats.limits import check_count
from morphkit.formats.urdf_names import WORLD, name_elements
from morphkit.formats.urdf_transmissions import driven_joints
from morphkit.morphology import Actuator, Base, Joint, JointKind, Limb, Morphology, Origin
from morphkit.naming.limbs import numbered_labels
from morphkit.naming.unique import give_names
from morphkit.readers.common import choose_root, type_of
from morphkit.readers.urdf_normalize import normalize
from morphkit.readers.urdf_sensors import read_sensors

_KINDS: dict[str, JointKind] = {"revolute": "hinge", "continuous": "hinge", "prismatic": "slide", "spherical": "ball"}
_BASES: dict[str, Base] = {"floating": "free", "planar": "planar"}
_JOINT_PARTS = ("parent", "child", "origin", "axis", "limit", "mimic")
_UNITS: dict[JointKind, str] = {"hinge": "N*m", "slide": "N", "ball": "N*m", "free": "1"}


def read_urdf(description: Description) -> Morphology:
    """Read a URDF description.

    What the file means is settled first, see `normalize`. A link on a fixed joint belongs to the limb that carries it,
    and so does one on a joint that is held. A root link called `world` is the world, as in MuJoCo: its child is the
    root, and the joint between them says how it is attached (`fixed`, `floating` or `planar`). A planar joint further
    down becomes the three joints `_TX`, `_TY` and `_RZ` that MuJoCo makes of it.

    Actuators come from the transmissions of joints that exist; without any, each joint with an effort limit that
    mimics no other has one.

    Raises:
        DescriptionError: Not a URDF, a link or joint that is missing or in a cycle, a reference to one of several of
            one name, several roots and no `description.root`; the message says in which line.
        UnknownNameError: `description.root` is no root link.
    """
    file, info = description.file, description.info
    document = document_of(description)
    tree = document.copy()
    if document.format != "urdf":
        raise DescriptionError(f"{file}:{tree.getroot().sourceline}: an MJCF file, expected URDF")
    check_count(tree.getroot(), "link", file=file)
    normal = normalize(tree, file=file)
    given, roots = [origin for _, origin in normal.given], normal.roots
    robot = _robot(tree, file)
    below: dict[str, list[Any]] = {}
    for joint in robot.joints:
        below.setdefault(joint.parent, []).append(joint)
    root, attachment = _root(roots, below, description, given)
    limbs, limb_of, limb_joints = _limbs(root, below, description)
    base: Base = "fixed"
    if attachment is not None and attachment.type in _BASES:
        base = _BASES[attachment.type]
    elif attachment is not None and attachment.type != "fixed":
        limb_joints[attachment.name] = (root, _joints(attachment, file)[0])
    actuators, driving = _actuators(tree, robot, limb_joints, file)
    sensors, sensing = read_sensors(tree, limb_of, file=file)
    return Morphology(
        name=description.name,
        file=file,
        format="urdf",
        sha256=description.sha256,
        base=info.base or base,
        family=info.family,
        task=info.task,
        type_words=info.type_words,
        limbs=limbs,
        actuators=actuators,
        sensors=sensors,
        labels=numbered_labels([limb.name for limb in limbs], info.labels),
        origins=(*given, *driving, *sensing),
    )


def drive_limits(description: Description) -> dict[str, tuple[float | None, float | None]]:
    """Effort limit, N*m (N), and velocity limit, rad/s (m/s), of each joint of a URDF; None where it states none.

    Raises:
        DescriptionError: The file is not XML, or something in it refers to a name that several joints have.
    """
    root = document_of(description).copy().getroot()
    name_elements(root, file=description.file)
    limits = {joint.get("name", ""): joint.find("limit") for joint in root.iterchildren("joint")}
    return {name: (_stated(limit, "effort"), _stated(limit, "velocity")) for name, limit in limits.items()}


def _stated(limit: etree._Element | None, key: str) -> float | None:
    text = limit.get(key) if limit is not None else None
    return None if text is None else float(text)


def _robot(tree: etree._ElementTree, file: str) -> Any:
    """Links and joints as yourdfpy understands them; what links look like and weigh is left out."""
    import yourdfpy

    skeleton = etree.Element("robot", name="robot")
    for link in tree.getroot().iterchildren("link"):
        etree.SubElement(skeleton, "link", name=link.get("name") or "")
    for joint in tree.getroot().iterchildren("joint"):
        bare = etree.SubElement(skeleton, "joint", name=joint.get("name") or "", type=joint.get("type") or "")
        bare.extend(copy.deepcopy(part) for part in joint.iterchildren(*_JOINT_PARTS))
    try:
        return yourdfpy.URDF.load(
            io.BytesIO(etree.tostring(skeleton)), load_meshes=False, build_scene_graph=False
        ).robot
    except Exception as error:
        raise DescriptionError(f"{file}: cannot be read as URDF: {error}") from error


def _root(
    roots: tuple[str, ...], below: dict[str, list[Any]], description: Description, given: Iterable[Origin]
) -> tuple[str, Any | None]:
    """Return the root limb's link and the joint that attaches it to a `world` link, if any."""
    joint_to = {joint.child: joint for joint in below.get(WORLD, ())} if WORLD in roots else {}
    tops = [name for root in roots for name in (joint_to if root == WORLD and joint_to else (root,))]
    strays = [each for each in given if each.kind == "link" and each.given != each.original and each.given in tops]
    root = choose_root(
        tops,
        description.root,
        file=(strays[0].where if strays else None) or description.file,
        element="link",
        notes=[
            f"{each.given} is {f'another link called {each.original!r}' if each.original else 'a link without a name'},"
            f" at {each.where}; no joint refers to it"
            for each in strays
        ],
    )
    return root, joint_to.get(root)


def _limbs(
    root: str, below: dict[str, list[Any]], description: Description
) -> tuple[tuple[Limb, ...], dict[str, str], dict[str, tuple[str, Joint]]]:
    """Return the limbs, link name -> limb name, and joint name in the file -> (limb name, joint)."""
    file, info = description.file, description.info
    limb_of = {root: root}
    members: dict[str, list[str]] = {root: [root]}
    parents: dict[str, str | None] = {root: None}
    joints: dict[str, tuple[Joint, ...]] = {root: ()}
    in_file: dict[str, tuple[str, Joint]] = {}
    pending = list(reversed(below.get(root, ())))
    while pending:
        joint = pending.pop()
        carrier, link = limb_of[joint.parent], joint.child
        if joint.type == "fixed":
            limb_of[link] = carrier
            members[carrier].append(link)
        else:
            moving = _joints(joint, file)
            limb_of[link], members[link], parents[link], joints[link] = link, [link], carrier, moving
            if len(moving) == 1:
                in_file[joint.name] = (link, moving[0])
        pending.extend(reversed(below.get(link, ())))
    limbs = tuple(
        Limb(
            name=name,
            parent=parent,
            joints=joints[name],
            members=tuple(members[name]),
            type=type_of(info, name, [joint.name for joint in joints[name]]),
        )
        for name, parent in parents.items()
    )
    return limbs, limb_of, in_file


def _joints(joint: Any, file: str) -> tuple[Joint, ...]:
    if joint.type == "floating":
        raise DescriptionError(
            f"{file}: floating joint {joint.name!r} hangs on link {joint.parent!r}; only the root can float. Call the"
            " link that it hangs on 'world', or make the joint another type"
        )
    limit = joint.limit
    low = float(limit.lower or 0.0) if limit is not None else 0.0
    high = float(limit.upper or 0.0) if limit is not None else 0.0
    limited = joint.type != "continuous" and low < high
    low, high = (low, high) if limited else (0.0, 0.0)
    if joint.type == "planar":
        return (
            Joint(f"{joint.name}_TX", "slide", limited, low, high),
            Joint(f"{joint.name}_TY", "slide", False, 0.0, 0.0),
            Joint(f"{joint.name}_RZ", "hinge", False, 0.0, 0.0),
        )
    return (Joint(joint.name, _KINDS[joint.type], limited, low, high),)


def _actuators(
    tree: etree._ElementTree, robot: Any, limb_joints: dict[str, tuple[str, Joint]], file: str
) -> tuple[tuple[Actuator, ...], list[Origin]]:
    """Return the actuators, and where they come from: nowhere, where the file has joints with an effort limit only."""
    described = {joint.name: joint for joint in robot.joints}
    transmissions = [row for row in _transmissions(tree) if row[1] in described]
    if not transmissions:
        transmissions = [(joint.name, joint.name, None) for joint in robot.joints if _effort(joint) > 0]
    driven = [row for row in transmissions if row[1] in limb_joints and described[row[1]].mimic is None]
    names = give_names([name for name, _, _ in driven], [joint for _, joint, _ in driven])
    found: list[Actuator] = []
    origins: list[Origin] = []
    for given, (name, joint_name, line) in zip(names, driven, strict=True):
        limb, joint = limb_joints[joint_name]
        effort = _effort(described[joint_name]) or math.inf
        found.append(Actuator(given, limb, joint_name, -effort, effort, _UNITS[joint.kind]))
        if line is not None:
            origins.append(Origin(given, "actuator", name, f"{file}:{line}"))
    return tuple(found), origins


def joints_with_motor(root: Any) -> set[str]:
    """Names of the joints below a `<robot>` element that have a motor, by the rule of `read_urdf`."""
    moving = {
        joint.get("name", ""): joint
        for joint in root.iterchildren("joint")
        if joint.get("type") in _KINDS and joint.find("mimic") is None
    }
    there = {joint.get("name", "") for joint in root.iterchildren("joint")}
    stated = {name for _, name, _ in _transmissions(root.getroottree())} & there
    if stated:
        return stated & set(moving)
    efforts = {name: _stated(joint.find("limit"), "effort") for name, joint in moving.items()}
    return {name for name, effort in efforts.items() if effort is not None and effort > 0}


def _effort(joint: Any) -> float:
    """The joint's effort limit in N*m or N; 0 where it has none."""
    return max(float(joint.limit.effort or 0.0), 0.0) if joint.limit is not None else 0.0


def _transmissions(tree: etree._ElementTree) -> Iterator[tuple[str | None, str, str | None]]:
    """Yield actuator name, joint name and line of each transmission; the n-th actuator drives the n-th joint."""
    for block in tree.getroot().iterchildren("transmission"):
        actuators = list(block.iterchildren("actuator"))
        for position, (_, joint) in enumerate(driven_joints(block)):
            actuator = actuators[position] if position < len(actuators) else block
            name = actuator.get("name") if actuator is not block else None
            yield name or None, joint, str(actuator.sourceline)
