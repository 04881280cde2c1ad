"""What refers to a removed link or joint in a URDF file, and goes with it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from morphkit.ablation.loss import Loss
from morphkit.formats.edit import detach
from morphkit.formats.urdf_transmissions import driven_joints

Removed = dict[tuple[str, str], str]
"""(`link` or `joint`, name) of everything removed -> the limb that it belonged to."""

_BOTH = ("link", "joint")
_KEPT = ("link", "joint", "material")
_OWN_PARTS = (
    "inertial", "visual", "collision", "parent", "child", "origin", "axis", "limit", "dynamics", "mimic",
    "safety_controller", "calibration", "color", "texture",
)  # fmt: skip
_ROLE = re.compile(r"(joint|link|body|frame|parent|child|reference)(s|_?names?)?\d*$")
_LABELS = ("name", "type", "class", "filename", "plugin", "version", "id")
_PROSE = ("description", "comment", "comments", "note", "notes", "author", "license", "documentation")
_VALUES = ("value", "values")
_SEPARATOR = re.compile(r"\s*,\s*|\s+")
_WORDS = re.compile(r"""[\s,;:|=()\[\]{}"']+""")
"""What separates names in lists and scopes of other programs: `["hip", "knee"]`, `robot::hip`."""


def prune_references(root: Any, removed: Removed) -> Iterator[Loss]:
    """Take out transmissions, mimics, Gazebo and ros2_control blocks and collision pairs of what was removed.

    In elements that nothing is known of, an attribute or text that is the name of what went is a reference, alone or in
    a list by commas or spaces; so is the name of an element that is called after joints or links. A reference goes, and
    what is about nothing without it. Where it cannot be told, the name stays, and a loss of kind `mention` says so.
    """
    references = _References(root, removed)
    for element in list(root):
        if not isinstance(element.tag, str):
            continue
        if element.tag in _KEPT:
            yield from references.mimic(element)
            for part in _added(element):
                yield from references.prune(part)
        elif element.tag == "transmission":
            yield from references.transmission(element)
        elif element.tag == "gazebo":
            yield from references.gazebo(element)
        elif element.tag == "ros2_control":
            yield from references.ros2_control(element)
        else:
            yield from references.prune(element)
    yield from references.mentions(root)


@dataclass(frozen=True, slots=True)
class _Hit:
    """A reference: the name, the limb that it belonged to, and the attribute that holds it; empty for the text."""

    name: str
    limb: str
    key: str


class _References:
    def __init__(self, root: Any, removed: Removed) -> None:
        self._removed = removed
        self._alive = {(str(e.tag), e.get("name", "")) for e in root if e.tag in ("link", "joint")}
        self._names = {name for _, name in (*removed, *self._alive)}

    def mimic(self, joint: Any) -> Iterator[Loss]:
        mimic = joint.find("mimic")
        if mimic is None:
            return
        limb = self._limb(mimic.get("joint"), "joint")
        if limb is not None:
            detach(mimic)
            reason = f"it followed joint {mimic.get('joint')}, and now moves on its own"
            yield Loss("mimic", joint.get("name", ""), limb, reason)

    def transmission(self, transmission: Any) -> Iterator[Loss]:
        """One of several joints goes alone, with the actuator that stands at its place."""
        joints, name = driven_joints(transmission), transmission.get("name", "")
        actuators = list(transmission.iterchildren("actuator"))
        left = [joint for _, joint in joints if ("joint", joint) in self._alive]
        for place, (element, joint) in enumerate(joints):
            limb = self._limb(joint, "joint")
            if limb is None:
                continue
            if not left:
                detach(transmission)
                yield Loss("transmission", name, limb, f"refers to joint {joint}")
                return
            detach(element)
            yield Loss("transmission", f"{name} {element.tag}", limb, f"refers to joint {joint}")
            if len(actuators) == len(joints):
                detach(actuators[place])
                reason = f"stood at the place of joint {joint} in transmission {name}"
                yield Loss("actuator", actuators[place].get("name", ""), limb, reason)
        yield from self._parts(transmission, "transmission", name)

    def gazebo(self, gazebo: Any) -> Iterator[Loss]:
        name = gazebo.get("reference")
        limb = self._limb(name, *_BOTH)
        if limb is not None:
            detach(gazebo)
            yield Loss("gazebo", name, limb, f"refers to {name}")
            return
        for block in list(gazebo.iterchildren("*")):
            yield from self._block(block, "gazebo")

    def ros2_control(self, system: Any) -> Iterator[Loss]:
        for block in list(system.iterchildren("*")):
            limb = self._limb(block.get("name"), "joint") if block.tag == "joint" else None
            if limb is not None:
                detach(block)
                yield Loss("ros2_control", block.get("name"), limb, f"refers to joint {block.get('name')}")
            elif block.tag == "joint":
                yield from self._mimic_parameters(block)
            else:
                yield from self._block(block, "ros2_control")

    def prune(self, element: Any) -> Iterator[Loss]:
        """Take out what refers to what went: the element itself, parts of it, or names in its lists."""
        tag = _tag(element)
        if tag.lower() in _PROSE:
            return
        hit = self._hit(element)
        if hit is not None:
            detach(element)
            yield Loss(tag, self._label(element, hit), hit.limb, f"refers to {hit.name}")
            return
        yield from self._shorten(element)
        if element.getparent() is None:
            return
        for child in list(element.iterchildren("*")):
            own = self._hit(child)
            lost = list(self.prune(child))
            if lost and child.getparent() is None and _is_about(element, child, own):
                # `<sensor><parent link=.../></sensor>`: without it the element means nothing.
                detach(element)
                yield Loss(tag, element.get("name") or lost[0].name, lost[0].limb, lost[0].reason)
                return
            yield from lost

    def mentions(self, root: Any) -> Iterator[Loss]:
        """Name what still has the name of something that went, in a place where it may mean something else."""
        tops = list(root.iterchildren("*"))
        for part in [part for top in tops for part in (_added(top) if top.tag in _KEPT else [top])]:
            for element in part.iter("*"):
                words = [(key, value) for key, value in element.attrib.items()] + [("", element.text or "")]
                for key, value in words:
                    for name in dict.fromkeys([value.strip(), *_SEPARATOR.split(value.strip()), *_WORDS.split(value)]):
                        limb = self._limb(name, *_BOTH)
                        if limb is not None:
                            where = f"its attribute {key}" if key else "its text"
                            what = element.get("name") or _tag(element)
                            yield Loss("mention", what, limb, f"{name} is still mentioned: <{_tag(element)}>, {where}")

    def _limb(self, name: str | None, *kinds: str) -> str | None:
        """The limb that the removed thing `name` belonged to; None where a link or joint of that name is left."""
        if not name or any((kind, name) in self._alive for kind in kinds):
            return None
        return next((self._removed[(kind, name)] for kind in kinds if (kind, name) in self._removed), None)

    def _hit(self, element: Any) -> _Hit | None:
        """The first attribute, or text, that is the name of what went."""
        for key, value in self._values(element):
            name = value.strip()
            limb = self._limb(name, *_kinds(element, key))
            if limb is not None:
                return _Hit(name, limb, key)
        return None

    def _values(self, element: Any) -> Iterator[tuple[str, str]]:
        """Attributes that may refer, and the text of an element without parts, under an empty key."""
        for key, value in element.attrib.items():
            if key not in _LABELS or (key == "name" and _ROLE.search(_tag(element).lower())):
                yield key, value
        if len(element) == 0 and element.text:
            yield "", element.text

    def _shorten(self, element: Any) -> Iterator[Loss]:
        """Take names out of lists."""
        for key, value in list(self._values(element)):
            words = [word for word in _SEPARATOR.split(value.strip()) if word]
            limbs = {word: limb for word in words if (limb := self._limb(word, *_kinds(element, key))) is not None}
            if not limbs or ("," not in value and not set(words) <= self._names):
                continue
            separator = (_SEPARATOR.search(value.strip()) or [" "])[0]
            left = separator.join(word for word in words if word not in limbs)
            if not left:
                detach(element)
            elif key:
                element.set(key, left)
            else:
                start, end = re.match(r"\s*", value)[0], re.search(r"\s*$", value)[0]  # type: ignore[index]
                element.text = start + left + end
            for word, limb in limbs.items():
                yield Loss(_tag(element), element.get("name") or f"{_tag(element)} of {word}", limb, f"lists {word}")
            if not left:
                return

    def _block(self, block: Any, kind: str) -> Iterator[Loss]:
        """Prune a block of a known kind; what is lost is told as lost by that kind."""
        label = block.get("name") or _tag(block)
        lost = list(self.prune(block))
        if block.getparent() is None and lost:
            yield Loss(kind, label, lost[0].limb, lost[0].reason)
            return
        for loss in lost:
            yield Loss(kind, f"{label} {loss.kind}" if loss.kind != _tag(block) else label, loss.limb, loss.reason)

    def _parts(self, element: Any, kind: str, label: str) -> Iterator[Loss]:
        for part in list(element.iterchildren("*")):
            for loss in self.prune(part):
                yield Loss(kind, f"{label} {loss.kind}", loss.limb, loss.reason)

    def _label(self, element: Any, hit: _Hit) -> str:
        own = element.get("name") if hit.key != "name" else None
        return own or f"{_tag(element)} of {hit.name}"

    def _mimic_parameters(self, joint: Any) -> Iterator[Loss]:
        parameters = {parameter.get("name"): parameter for parameter in joint.iterfind("param")}
        mimic = parameters.get("mimic")
        limb = self._limb((mimic.text or "").strip(), "joint") if mimic is not None else None
        if mimic is None or limb is None:
            return
        for name in ("mimic", "multiplier"):
            if name in parameters:
                detach(parameters[name])
        reason = f"it followed joint {(mimic.text or '').strip()}, and now moves on its own"
        yield Loss("mimic", joint.get("name", ""), limb, reason)


def _added(element: Any) -> list[Any]:
    """The parts of a link, joint or material that are none of URDF's own."""
    return [part for part in element.iterchildren("*") if part.tag not in _OWN_PARTS]


def _tag(element: Any) -> str:
    return str(element.tag).rpartition("}")[2]


def _kinds(element: Any, key: str) -> tuple[str, ...]:
    """Whether an attribute or text names a link or a joint, as far as its name says; both where it does not."""
    said = (_tag(element) if key in ("", "name", *_VALUES) else key).lower()
    if "joint" in said:
        return ("joint",)
    if any(word in said for word in ("link", "body", "frame")):
        return ("link",)
    return _BOTH


def _is_about(element: Any, child: Any, own: _Hit | None) -> bool:
    """Whether an element means nothing without a child that went.

    The child says which joint, link or value it is about and is the last one that does; or it was all that there was,
    and meant nothing without a part that went. A parameter with a name, `<param name="tip">`, is one of several.
    """
    if own is None:
        return next(element.iterchildren("*"), None) is None
    if own.key == "" and child.get("name"):
        return len(element) == 0
    says = _ROLE.search(_tag(child).lower()) or own.key in ("", *_VALUES)
    return bool(says) and element.find(str(child.tag)) is None
