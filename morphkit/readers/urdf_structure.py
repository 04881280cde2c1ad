"""What must hold in a URDF: links and joints form a tree, numbers are numbers; every complaint names the line."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping
from typing import Any, Protocol

import numpy as np
from lxml import etree

from morphkit.errors import DescriptionError
from morphkit.formats.poses import numbers
from morphkit.formats.urdf_names import WORLD
from morphkit.utils.suggest import did_you_mean

Element = Any
"""An lxml element."""

JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar", "spherical")
WITH_AXIS = ("revolute", "continuous", "prismatic", "planar")
MAY_BE_INFINITE = ("limit",)
"""Elements in which an infinite number means something: no bound."""

SHORTEST_AXIS = 1e-9
"""Length under which an axis has no direction."""
_FEW = 20
NUMBERS = {
    "limit": {"lower": 1, "upper": 1, "effort": 1, "velocity": 1},
    "axis": {"xyz": 3},
    "origin": {"xyz": 3, "rpy": 3},
    "mass": {"value": 1},
    "inertia": dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), 1),
    "dynamics": {"damping": 1, "friction": 1},
    "mimic": {"multiplier": 1, "offset": 1},
}
"""How many numbers each attribute of an element holds."""

XACRO_DEFINITIONS = ("property", "arg", "macro", "include")
_XACRO = ("{http://www.ros.org/wiki/xacro}", "{http://ros.org/wiki/xacro}", "xacro:")


def is_xacro_element(element: etree._Element) -> bool:
    """Whether an element is meant for xacro."""
    return isinstance(element.tag, str) and element.tag.startswith(_XACRO)


def xacro_name(element: etree._Element) -> str:
    """Name of such an element without `xacro:`; of others, their tag."""
    return str(element.tag).rpartition("}")[2].removeprefix("xacro:")


class TreeReport(Protocol):
    """Is told what keeps links and joints from being trees."""

    def joint_type(self, name: str, joint: Element) -> None:
        """The joint has a type that URDF does not know."""

    def no_end(self, name: str, joint: Element, tag: str) -> None:
        """The joint names no link as its `parent` or `child`."""

    def unknown_end(self, name: str, end: Element, tag: str, link: str) -> None:
        """The link that the joint names as its `parent` or `child` does not exist."""

    def second_parent(self, name: str, joint: Element, child: str, other: str, other_joint: Element) -> None:
        """The joint's child is that of the joint `other` already."""

    def cycle(self, name: str, joint: Element, loop: str) -> None:
        """Links form a cycle, `a -> b -> a`, of which this is the last joint in the file."""


def join_links(links: Container[str], joints: Mapping[str, Element], report: TreeReport) -> dict[str, tuple[str, str]]:
    """Follow the joints from link to link.

    Args:
        links: Names of the links.
        joints: Joint elements by name, in file order.
        report: Is told what is wrong, and may raise.

    Returns:
        Joint name -> (parent link, child link), of joints whose ends exist. Those that give a link a second parent, and
        the last joint of each cycle, are left out: what is left are trees.
    """
    ends: dict[str, tuple[str, str]] = {}
    joint_to: dict[str, str] = {}
    for name, joint in joints.items():
        if joint.get("type") not in JOINT_TYPES:
            report.joint_type(name, joint)
        parent, child = (_end(name, joint, tag, links, report) for tag in ("parent", "child"))
        if parent is None or child is None:
            continue
        if child in joint_to:
            report.second_parent(name, joint, child, joint_to[child], joints[joint_to[child]])
            continue
        joint_to[child] = name
        ends[name] = (parent, child)
    for ring in _rings(ends, joint_to):
        order = list(ends)
        last = max((joint_to[link] for link in ring), key=order.index)
        loop = " -> ".join(reversed([*ring, ring[0]])) if len(ring) < _FEW else f"{len(ring)} links from {ring[0]!r}"
        report.cycle(last, joints[last], loop)
        del ends[last]
    return ends


def _end(name: str, joint: Element, tag: str, links: Container[str], report: TreeReport) -> str | None:
    element = joint.find(tag)
    link = element.get("link") if element is not None else None
    if element is None or not link:
        report.no_end(name, joint, tag)
        return None
    if link not in links:
        report.unknown_end(name, element, tag, link)
        return None
    return link


def _rings(ends: Mapping[str, tuple[str, str]], joint_to: Mapping[str, str]) -> list[list[str]]:
    """The cycles, each as its links from child to parent."""
    rings: list[list[str]] = []
    safe: set[str] = set()
    for start in joint_to:
        path: dict[str, None] = {}
        link: str | None = start
        while link is not None and link not in safe and link not in path:
            path[link] = None
            link = ends[joint_to[link]][0] if link in joint_to else None
        if link is not None and link in path:
            rings.append(list(path)[list(path).index(link) :])
        safe.update(path)
    return rings


class _Refusal:
    """Raises a DescriptionError for the first thing that is wrong."""

    def __init__(self, file: str, links: Iterable[str]) -> None:
        self._file, self._links = file, links

    def joint_type(self, name: str, joint: Element) -> None:
        kind = joint.get("type")
        self._refuse(
            joint,
            f"joint {name!r} has type {kind!r}, expected one of"
            f" {', '.join(JOINT_TYPES)}{did_you_mean(kind or '', JOINT_TYPES)}",
        )

    def no_end(self, name: str, joint: Element, tag: str) -> None:
        self._refuse(joint, f'joint {name!r} has no {tag} link; write <{tag} link="..."/>')

    def unknown_end(self, name: str, end: Element, tag: str, link: str) -> None:
        self._refuse(
            end,
            f"{tag} link {link!r} of joint {name!r} does not exist; add"
            f' <link name="{link}"/> or correct the name{did_you_mean(link, self._links)}',
        )

    def second_parent(self, name: str, joint: Element, child: str, other: str, other_joint: Element) -> None:
        self._refuse(
            joint,
            f"link {child!r} is the child of joint {name!r} and of joint"
            f" {other!r} (line {other_joint.sourceline}); a link has one parent",
        )

    def cycle(self, name: str, joint: Element, loop: str) -> None:
        self._refuse(
            joint, f"links form a cycle: {loop}; a URDF is a tree, remove joint {name!r} or another of the cycle"
        )

    def _refuse(self, element: Element, what: str) -> None:
        raise DescriptionError(f"{self._file}:{element.sourceline}: {what}")


def check_urdf(tree: etree._ElementTree, *, file: str) -> tuple[str, ...]:
    """Check links, joints and numbers, and return the names of the links without a parent, in file order.

    Links and joints all have names of their own; see `urdf_names.name_elements`.

    Raises:
        DescriptionError: xacro has not expanded a macro, a joint refers to a link that does not exist, a link has two
            parents, links form a cycle, a number is none, or a moving joint has an axis without direction.
    """
    root = tree.getroot()
    links = {link.get("name") or "": link for link in root.iterchildren("link")}
    joints = {joint.get("name") or "": joint for joint in root.iterchildren("joint")}
    for element in root:
        if is_xacro_element(element) and xacro_name(element) not in XACRO_DEFINITIONS:
            raise DescriptionError(
                f"{file}:{element.sourceline}: <xacro:{xacro_name(element)}> stands for elements that are missing; let "
                "the file's name end in .xacro, or expand it first: xacro robot.urdf.xacro > robot.urdf"
            )
    if not links:
        raise DescriptionError(f"{file}:{root.sourceline}: no <link> in <robot>; a robot needs at least one")
    if list(links) == [WORLD]:
        raise DescriptionError(
            f"{file}:{root.sourceline}: no <link> but {WORLD!r}, which is no part of a robot; a xacro macro may"
            f" stand for the rest: expand it first: xacro {file} > robot.urdf"
        )
    ends = join_links(links, joints, _Refusal(file, links))
    for element in [*joints.values(), *links.values()]:
        _check_numbers(element, file)
    _check_motion(joints, file)
    children = {child for _, child in ends.values()}
    return tuple(name for name in links if name not in children)


def _check_motion(joints: Mapping[str, Element], file: str) -> None:
    """Refuse mimics of joints that do not exist, and joints that move along no axis."""
    for name, joint in joints.items():
        for mimic in joint.iterchildren("mimic"):
            if mimic.get("joint") not in joints:
                raise DescriptionError(
                    f"{file}:{mimic.sourceline}: joint {name!r} mimics joint {mimic.get('joint')!r}, which does not"
                    f" exist{did_you_mean(mimic.get('joint') or '', joints)}"
                )
        for axis in joint.iterchildren("axis"):
            fault = without_direction(axis) if joint.get("type") in WITH_AXIS else ""
            if fault:
                raise DescriptionError(f"{file}:{axis.sourceline}: joint {name!r} has {fault}")


def without_direction(axis: Element) -> str:
    """What to say of an `<axis>` that has no `xyz`, or one of length zero; empty for others."""
    xyz = axis.get("xyz")
    if xyz is not None:
        return f"the axis {xyz}, which has no direction" if np.linalg.norm(numbers(xyz)) < SHORTEST_AXIS else ""
    other = f", but {', '.join(axis.keys())}" if axis.keys() else ""
    return f'an <axis> without xyz{other}; write <axis xyz="..."/>'


def _check_numbers(element: etree._Element, file: str) -> None:
    for part in element.iter(*NUMBERS):
        for attribute, count in NUMBERS[str(part.tag)].items():
            text = part.get(attribute)
            if text is None:
                continue
            try:
                found = numbers(text)
            except ValueError:
                found = np.zeros(0)
            infinite = np.isinf(found).any() and part.tag not in MAY_BE_INFINITE
            if len(found) != count or np.isnan(found).any() or infinite:
                expected = f"expected {'a number' if count == 1 else f'{count} numbers'}"
                if infinite:
                    expected = "which is not finite"
                raise DescriptionError(
                    f'{file}:{part.sourceline}: {attribute}="{text}" in <{part.tag}> of {element.tag}'
                    f" {element.get('name')!r}, {expected}"
                )
