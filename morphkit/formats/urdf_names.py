"""Names for the links and joints of a URDF that have none, or share one that nothing refers to."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

from lxml import etree

from morphkit.errors import DescriptionError
from morphkit.formats.urdf_transmissions import driven_joints
from morphkit.morphology import Origin
from morphkit.naming.unique import TakenNames, give_names

Given = list[tuple[etree._Element, Origin]]

WORLD = "world"
_INNER_WORLD = "world_link"
_REFERENCES = {"joint/parent": "link", "joint/child": "link", "sensor/parent": "link", "gazebo": "reference"}


def name_elements(root: etree._Element, *, file: str) -> Given:
    """Give every link and joint below `<robot>` a name of its own, in place.

    A link without a name is called `link`, a joint without one `<child>_joint`; a number is added where a name is
    taken, and to the second and later elements of one name. A link called `world` that is no root is called
    `world_link`, wherever links are named: the other name is that of what robots stand on.

    Args:
        root: The root element.
        file: What the file is called in messages.

    Returns:
        Every link and joint, and where its name comes from; see `take_back`.

    Raises:
        DescriptionError: Something refers to a name that several links or joints have.
    """
    links, joints = list(root.iterchildren("link")), list(root.iterchildren("joint"))
    ends = {id(joint): [_attribute(joint, tag, "link") for tag in ("parent", "child")] for joint in joints}
    _refuse_shared(links, "link", ((joint, name) for joint in joints for name in ends[id(joint)]), file)
    _refuse_shared(joints, "joint", _joint_references(root, joints), file)
    given = [*_give(links, ["link"] * len(links), file), *_give(joints, joint_calls(joints), file)]
    if any(child == WORLD for _, child in ends.values()):
        given = [*_rename_inner_world(root, given)]
    return given


def joint_calls(joints: list[etree._Element]) -> list[str]:
    """What each joint is called that has no name, before a number is added where that is taken."""
    children = [_attribute(joint, "child", "link") for joint in joints]
    return [f"{child}_joint" if child else "joint" for child in children]


def _rename_inner_world(root: etree._Element, given: Given) -> Iterator[tuple[etree._Element, Origin]]:
    name = TakenNames(origin.given for _, origin in given if origin.kind == "link").give(_INNER_WORLD)
    for element, origin in given:
        if origin.kind == "link" and origin.given == WORLD:
            element.set("name", name)
            origin = replace(origin, given=name)
        yield element, origin
    _refer(root, WORLD, name)


def _refer(root: etree._Element, old: str, new: str) -> None:
    """Let what refers to the link `old` refer to `new`."""
    for path, key in _REFERENCES.items():
        for element in root.iterfind(path):
            if element.get(key) == old:
                element.set(key, new)


def take_back(given: Given, root: etree._Element) -> None:
    """Call elements below `root` again what the file calls them."""
    for element, origin in given:
        if origin.original == WORLD and origin.given.startswith(_INNER_WORLD):
            _refer(root, origin.given, WORLD)
        if origin.original is None:
            element.attrib.pop("name", "")
        elif origin.original != origin.given:
            element.set("name", origin.original)


def _give(elements: list[etree._Element], calls: list[str], file: str) -> Iterator[tuple[etree._Element, Origin]]:
    originals = [element.get("name") for element in elements]
    names = give_names(originals, calls)
    for element, original, name in zip(elements, originals, names, strict=True):
        if name != original:
            element.set("name", name)
        yield element, Origin(name, str(element.tag), original, f"{file}:{element.sourceline}")


def _joint_references(root: etree._Element, joints: list[etree._Element]) -> Iterator[tuple[etree._Element, str]]:
    for joint in joints:
        for mimic in joint.iterchildren("mimic"):
            yield mimic, mimic.get("joint") or ""
    for transmission in root.iterchildren("transmission"):
        yield from driven_joints(transmission)


def _refuse_shared(
    elements: list[etree._Element], what: str, references: Iterator[tuple[etree._Element, str]], file: str
) -> None:
    counts = Counter(element.get("name") for element in elements)
    if max(counts.values(), default=0) < 2:
        return
    for user, name in references:
        if name and counts[name] > 1:
            first, second = [element.sourceline for element in elements if element.get("name") == name][:2]
            raise DescriptionError(
                f"{file}:{second}: two {what}s are called {name!r} (the first in line {first}), and <{user.tag}> in"
                f" line {user.sourceline} refers to one of them; rename one"
            )


def _attribute(joint: etree._Element, tag: str, key: str) -> str:
    element = joint.find(tag)
    return (element.get(key) or "") if element is not None else ""
