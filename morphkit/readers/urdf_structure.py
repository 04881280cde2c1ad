"""What must hold in a URDF before anything else looks at it; every complaint names the line."""

from __future__ import annotations

import math

from lxml import etree

from morphkit.errors import DescriptionError
from morphkit.utils.suggest import did_you_mean

JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar", "spherical")
_NUMBERS = {
    "limit": {"lower": 1, "upper": 1, "effort": 1, "velocity": 1},
    "axis": {"xyz": 3},
    "origin": {"xyz": 3, "rpy": 3},
    "mass": {"value": 1},
    "inertia": dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), 1),
    "dynamics": {"damping": 1, "friction": 1},
    "mimic": {"multiplier": 1, "offset": 1},
}

XACRO_DEFINITIONS = ("property", "arg", "macro", "include")
_XACRO = ("{http://www.ros.org/wiki/xacro}", "{http://ros.org/wiki/xacro}", "xacro:")


def is_xacro(element: etree._Element) -> bool:
    """Whether an element is meant for xacro."""
    return isinstance(element.tag, str) and element.tag.startswith(_XACRO)


def xacro_name(element: etree._Element) -> str:
    """Name of such an element without `xacro:`; of others, their tag."""
    return str(element.tag).rpartition("}")[2].removeprefix("xacro:")


def check_urdf(tree: etree._ElementTree, *, file: str) -> tuple[str, ...]:
    """Check links, joints and numbers, and return the names of the links without a parent, in file order.

    Links and joints all have names of their own; see `urdf_names.name_elements`.

    Raises:
        DescriptionError: xacro has not expanded a macro, a joint refers to a link that does not exist, a link has two
            parents, links form a cycle, or a number is none.
    """
    root = tree.getroot()
    links = {link.get("name") or "": link for link in root.iterchildren("link")}
    joints = {joint.get("name") or "": joint for joint in root.iterchildren("joint")}
    for element in root:
        if is_xacro(element) and xacro_name(element) not in XACRO_DEFINITIONS:
            raise DescriptionError(
                f"{file}:{element.sourceline}: <xacro:{xacro_name(element)}> stands for elements that are missing; let "
                "the file's name end in .xacro, or expand it first: xacro robot.urdf.xacro > robot.urdf"
            )
    if not links:
        raise DescriptionError(f"{file}:{root.sourceline}: no <link> in <robot>; a robot needs at least one")
    parent_of: dict[str, str] = {}
    joint_of: dict[str, etree._Element] = {}
    for name, joint in joints.items():
        kind = joint.get("type")
        if kind not in JOINT_TYPES:
            raise DescriptionError(
                f"{file}:{joint.sourceline}: joint {name!r} has type {kind!r}, expected one of"
                f" {', '.join(JOINT_TYPES)}{did_you_mean(kind or '', JOINT_TYPES)}"
            )
        parent = _end(joint, "parent", links, file)
        child = _end(joint, "child", links, file)
        if child in parent_of:
            raise DescriptionError(
                f"{file}:{joint.sourceline}: link {child!r} is the child of joint {name!r} and of joint"
                f" {joint_of[child].get('name')!r} (line {joint_of[child].sourceline}); a link has one parent"
            )
        parent_of[child] = parent
        joint_of[child] = joint
        _check_numbers(joint, file)
    for link in links.values():
        _check_numbers(link, file)
    _refuse_cycles(parent_of, joint_of, file)
    for name, joint in joints.items():
        for mimic in joint.iterchildren("mimic"):
            if mimic.get("joint") not in joints:
                raise DescriptionError(
                    f"{file}:{mimic.sourceline}: joint {name!r} mimics joint {mimic.get('joint')!r}, which does not"
                    f" exist{did_you_mean(mimic.get('joint') or '', joints)}"
                )
    for transmission in root.iterchildren("transmission"):
        for element in transmission.iterchildren("joint"):
            if element.get("name") not in joints:
                raise DescriptionError(
                    f"{file}:{element.sourceline}: transmission {transmission.get('name')!r} drives joint"
                    f" {element.get('name')!r}, which does not exist{did_you_mean(element.get('name') or '', joints)}"
                )
    return tuple(name for name in links if name not in parent_of)


def _end(joint: etree._Element, tag: str, links: dict[str, etree._Element], file: str) -> str:
    element = joint.find(tag)
    name = joint.get("name")
    link = element.get("link") if element is not None else None
    if element is None or not link:
        raise DescriptionError(
            f'{file}:{joint.sourceline}: joint {name!r} has no {tag} link; write <{tag} link="..."/>'
        )
    if link not in links:
        raise DescriptionError(
            f"{file}:{element.sourceline}: {tag} link {link!r} of joint {name!r} does not exist; add"
            f' <link name="{link}"/> or correct the name{did_you_mean(link, links)}'
        )
    return link


def _refuse_cycles(parent_of: dict[str, str], joint_of: dict[str, etree._Element], file: str) -> None:
    safe: set[str] = set()
    for start in parent_of:
        path: dict[str, None] = {}
        link: str | None = start
        while link is not None and link not in safe:
            if link in path:
                ring = list(path)
                ring = ring[ring.index(link) :]
                in_ring = set(ring)
                joint = [joint for child, joint in joint_of.items() if child in in_ring][-1]
                loop = " -> ".join(reversed([*ring, link])) if len(ring) < 20 else f"{len(ring)} links from {link!r}"
                raise DescriptionError(
                    f"{file}:{joint.sourceline}: links form a cycle: {loop}; a URDF is a tree, remove joint"
                    f" {joint.get('name')!r} or another of the cycle"
                )
            path[link] = None
            link = parent_of.get(link)
        safe.update(path)


def _check_numbers(element: etree._Element, file: str) -> None:
    for part in element.iter(*_NUMBERS):
        for attribute, count in _NUMBERS[str(part.tag)].items():
            text = part.get(attribute)
            if text is None:
                continue
            try:
                numbers = [float(word) for word in text.split()]
            except ValueError:
                numbers = []
            if len(numbers) != count or any(math.isnan(number) for number in numbers):
                expected = "a number" if count == 1 else f"{count} numbers"
                raise DescriptionError(
                    f'{file}:{part.sourceline}: {attribute}="{text}" in <{part.tag}> of {element.tag}'
                    f" {element.get('name')!r}, expected {expected}"
                )
