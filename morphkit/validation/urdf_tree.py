"""Checks of a URDF: names, the tree that joints make of links, and what refers to either."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from morphkit.formats.urdf_names import WORLD, joint_calls
from morphkit.naming.unique import give_names
from morphkit.readers.urdf_structure import JOINT_TYPES, XACRO_DEFINITIONS, is_xacro_element, join_links, xacro_name
from morphkit.utils.suggest import did_you_mean
from morphkit.validation.common import index_names, read_numbers, shorten, unknown
from morphkit.validation.document import CheckedDocument, elements

_OWN = ("robot", "link", "joint", "mesh", "origin", "parent", "child", "mass", "inertia", "limit")
_FEW = 8


@dataclass
class UrdfTree:
    """Links and joints by name, and the joints whose ends exist.

    Attributes:
        links: Link elements by name.
        joints: Joint elements by name.
        ends: Joint name -> (parent link, child link), where both exist and no other joint has the child.
    """

    links: dict[str, Any]
    joints: dict[str, Any]
    ends: dict[str, tuple[str, str]]

    def children(self) -> set[str]:
        """The links that have a parent."""
        return {child for _, child in self.ends.values()}

    def groups(self) -> Iterator[tuple[str | None, list[str]]]:
        """Yield the rigid groups of links: name of the moving joint that carries the group, or None, and the links."""
        below: dict[str, list[str]] = {}
        for joint, (parent, _) in self.ends.items():
            below.setdefault(parent, []).append(joint)
        children = self.children()
        pending: list[tuple[str | None, str]] = [(None, link) for link in reversed(self.links) if link not in children]
        while pending:
            carrier, first = pending.pop()
            group, stack = [], [first]
            while stack:
                link = stack.pop()
                group.append(link)
                for joint in below.get(link, ()):
                    child = self.ends[joint][1]
                    if self.joints[joint].get("type") == "fixed":
                        stack.append(child)
                    else:
                        pending.append((joint, child))
            yield carrier, group


def read_tree(doc: CheckedDocument) -> UrdfTree:
    """Return links and joints, and report what keeps them from being one tree."""
    root = doc.root
    links = index_names(doc, elements(root, "link"), "link", required=True)
    # Transmissions and ros2_control have joint elements too; only the children of <robot> are joints.
    found = elements(root, "joint")
    index_names(doc, found, "joint", required=True)
    # Joints without a name of their own are looked at all the same, called as the readers call them.
    joints = dict(zip(give_names([joint.get("name") for joint in found], joint_calls(found)), found, strict=True))
    if not links:
        doc.add("robot-empty", root, "no <link> in <robot>")
    report = _TreeFindings(doc, links)
    tree = UrdfTree(links, joints, join_links(links, joints, report))
    roots = [link for link in links if link not in report.children and link not in tree.children()]
    on_world = [child for parent, child in tree.ends.values() if parent == WORLD and WORLD in roots]
    roots = [top for root in roots for top in (on_world if root == WORLD and on_world else [root])]
    if len(roots) > 1 and report.complete:  # a broken joint is reported already, and is why its child has no parent
        listed = ", ".join(roots[:_FEW]) + (", ..." if len(roots) > _FEW else "")
        what = "hang on the world or on nothing" if on_world else "have no parent"
        doc.add("roots-several", links[roots[1]], f"{len(roots)} links {what}: {listed}", name=roots[1])
    return tree


class _TreeFindings:
    """Reports what is wrong.

    Attributes:
        complete: Whether both ends of all joints exist.
        children: Links that a joint left out of the tree has as its child.
    """

    def __init__(self, doc: CheckedDocument, links: dict[str, Any]) -> None:
        self._doc, self._links = doc, links
        self.complete = True
        self.children: set[str] = set()

    def joint_type(self, name: str, joint: Any) -> None:
        kind = joint.get("type")
        hint = did_you_mean(kind or "", JOINT_TYPES)
        self._doc.add("joint-type", joint, f"joint {name!r} has type {kind!r}{hint}", name=name)

    def no_end(self, name: str, joint: Any, tag: str) -> None:
        self.complete = False
        fix = f'Write <{tag} link="..."/>.'
        self._doc.add("reference-unknown", joint, f"joint {name!r} has no {tag} link", name=name, fix=fix)

    def unknown_end(self, name: str, end: Any, tag: str, link: str) -> None:
        self.complete = False
        what = f"joint {name!r} has as {tag} {unknown(self._doc, 'link', link, self._links)}"
        self._doc.add("reference-unknown", end, what, name=name)

    def second_parent(self, name: str, joint: Any, child: str, other: str, other_joint: Any) -> None:
        what = f"link {child!r} is the child of joint {name!r} and of joint {other!r} (line {other_joint.sourceline})"
        self._doc.add("parents-several", joint, what, name=child)

    def cycle(self, name: str, joint: Any, loop: str) -> None:
        self.children.add(joint.find("child").get("link"))
        self._doc.add("cycle", joint, f"links form a cycle: {loop}", name=name)


def check_references(doc: CheckedDocument, tree: UrdfTree) -> None:
    """Report references to links, joints and materials that do not exist."""
    root = doc.root
    for name, joint in tree.joints.items():
        for mimic in elements(joint, "mimic"):
            target = mimic.get("joint") or ""
            if target not in tree.joints:
                doc.add(
                    "reference-unknown",
                    mimic,
                    f"joint {name!r} mimics {unknown(doc, 'joint', target, tree.joints)}",
                    name=name,
                )
    _check_materials(doc)
    for block in elements(root, "gazebo"):
        target = block.get("reference")
        if target is not None and target not in tree.links and target not in tree.joints:
            known = [*tree.links, *tree.joints]
            doc.add("reference-ignored", block, f"<gazebo> refers to {unknown(doc, 'link or joint', target, known)}")
    for sensor in elements(root, "sensor"):
        for parent in elements(sensor, "parent"):
            target = parent.get("link") or parent.get("joint") or ""
            if target not in tree.links and target not in tree.joints:
                what = f"sensor {sensor.get('name')!r} sits on {unknown(doc, 'link', target, tree.links)}"
                doc.add("reference-unknown", parent, what, name=sensor.get("name") or "")
    for control in elements(root, "ros2_control"):
        for element in elements(control, "joint"):
            target = element.get("name") or ""
            if target not in tree.joints:
                what = f"<ros2_control> drives {unknown(doc, 'joint', target, tree.joints)}"
                doc.add("reference-unknown", element, what, name=target)


def _check_materials(doc: CheckedDocument) -> None:
    top = elements(doc.root, "material")
    index_names(doc, top, "material", required=False)
    inline = [material for link in elements(doc.root, "link") for material in link.iter("material")]
    defined = {each.get("name") for each in [*top, *inline] if len(elements(each))}
    used = {each.get("name") for each in inline}
    for color in (color for material in [*top, *inline] for color in elements(material, "color")):
        owner = f"material {color.getparent().get('name')!r}"
        if color.get("rgba") is None:
            doc.add("number-invalid", color, f"<color> of {owner} has no rgba")
        read_numbers(doc, color, "rgba", range(4, 5), owner=owner)
    for material in inline:
        name = material.get("name")
        if name and name not in defined:
            link = next(each.get("name") for each in material.iterancestors("link"))
            known = [each for each in defined if each]
            what = f"a visual of link {link!r} has {unknown(doc, 'material', name, known)}"
            doc.add("material-undefined", material, what, name=name)
    for material in top:
        if material.get("name") not in used:
            what = f"nothing uses material {material.get('name')!r}"
            doc.add("asset-unused", material, what, name=material.get("name") or "")


def check_xacro(doc: CheckedDocument) -> None:
    """Report what xacro should have expanded."""
    for element in doc.root.iter():
        if not isinstance(element.tag, str):
            continue
        if is_xacro_element(element):
            name = xacro_name(element)
            if any(xacro_name(above) == "macro" for above in element.iterancestors()):
                continue  # part of a definition
            if name in XACRO_DEFINITIONS:
                doc.add("xacro-leftover", element, f"<xacro:{name}> is left over")
            else:
                doc.add("xacro-unexpanded", element, f"<xacro:{name}> stands for elements that are missing")
        elif not any(is_xacro_element(above) for above in element.iterancestors()):
            for key, value in element.attrib.items():
                if "${" in value or ("$(" in value and "$(find" not in value and element.tag in _OWN):
                    doc.add("xacro-unexpanded", element, f'{key}="{shorten(value)}" in <{element.tag}>')
