"""What refers to a removed link or joint in a URDF file, and goes with it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from morphkit.ablation.loss import Loss
from morphkit.formats.edit import detach

Removed = dict[tuple[str, str], str]
"""(`link` or `joint`, name) of everything removed -> the limb that it belonged to."""

_LINK_ATTRIBUTES = (
    "link", "link1", "link2", "parent_link", "child_link", "base_link", "tip_link", "body", "body1", "body2", "frame",
)  # fmt: skip
_JOINT_ATTRIBUTES = ("joint", "joint1", "joint2")
_EITHER_ATTRIBUTES = ("reference", "parent", "child")
_ROLES = (*_LINK_ATTRIBUTES, *_JOINT_ATTRIBUTES, *_EITHER_ATTRIBUTES)


def prune_references(root: Any, removed: Removed) -> Iterator[Loss]:
    """Take out transmissions, mimics, Gazebo and ros2_control blocks and collision pairs of what was removed.

    Elements that nothing is known of go where an attribute such as `link`, `joint1` or `reference` names what went; all
    others stay.
    """
    references = _References(root, removed)
    for element in list(root):
        if element.tag == "link" or not isinstance(element.tag, str):
            continue
        if element.tag == "joint":
            yield from references.joint(element)
        elif element.tag == "transmission":
            yield from references.transmission(element)
        elif element.tag == "gazebo":
            yield from references.gazebo(element)
        elif element.tag == "ros2_control":
            yield from references.ros2_control(element)
        else:
            yield from references.unknown(element)


class _References:
    def __init__(self, root: Any, removed: Removed) -> None:
        self._removed = removed
        self._alive = {(str(e.tag), e.get("name", "")) for e in root if e.tag in ("link", "joint")}

    def _limb(self, name: str | None, *kinds: str) -> str | None:
        """The limb that the removed thing `name` belonged to; None where a link or joint of that name is left."""
        if name is None or any((kind, name) in self._alive for kind in kinds):
            return None
        return next((self._removed[(kind, name)] for kind in kinds if (kind, name) in self._removed), None)

    def joint(self, joint: Any) -> Iterator[Loss]:
        mimic = joint.find("mimic")
        if mimic is None:
            return
        limb = self._limb(mimic.get("joint"), "joint")
        if limb is not None:
            detach(mimic)
            reason = f"it followed joint {mimic.get('joint')}, and now moves on its own"
            yield Loss("mimic", joint.get("name", ""), limb, reason)

    def transmission(self, transmission: Any) -> Iterator[Loss]:
        for joint in transmission.iter("joint"):
            name = joint.get("name") or (joint.text or "").strip()
            limb = self._limb(name, "joint")
            if limb is not None:
                detach(transmission)
                yield Loss("transmission", transmission.get("name", ""), limb, f"refers to joint {name}")
                return

    def gazebo(self, gazebo: Any) -> Iterator[Loss]:
        name = gazebo.get("reference")
        limb = self._limb(name, "link", "joint")
        if limb is not None:
            detach(gazebo)
            yield Loss("gazebo", name, limb, f"refers to {name}")
        elif name is None:
            for block in list(gazebo):
                if isinstance(block.tag, str):
                    yield from self._named_in_text(block, "gazebo", block.get("name") or str(block.tag))

    def ros2_control(self, system: Any) -> Iterator[Loss]:
        for block in list(system):
            if not isinstance(block.tag, str):
                continue
            names = [block.get("name")] if block.tag == "joint" else [j.get("name") for j in block.iter("joint")]
            hit = next((name for name in names if self._limb(name, "joint") is not None), None)
            if hit is not None:
                detach(block)
                limb = self._limb(hit, "joint") or ""
                yield Loss("ros2_control", block.get("name") or hit, limb, f"refers to joint {hit}")
            elif block.tag == "joint":
                yield from self._mimic_parameters(block)
            else:
                yield from self._named_in_text(block, "ros2_control", block.get("name") or str(block.tag))

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

    def _named_in_text(self, block: Any, kind: str, name: str) -> Iterator[Loss]:
        """A name inside a plugin's parameters: one of a list goes alone, else the plugin has lost what it works on."""
        for leaf in [leaf for leaf in block.iter() if isinstance(leaf.tag, str) and len(leaf) == 0]:
            text = (leaf.text or "").strip()
            limb = self._limb(text, "link", "joint") if text else None
            if limb is None:
                continue
            if leaf is block or sum(other.tag == leaf.tag for other in leaf.getparent()) == 1:
                detach(block)
                yield Loss(kind, name, limb, f"refers to {text}")
                return
            detach(leaf)
            yield Loss(kind, f"{name} {leaf.tag}", limb, f"refers to {text}")

    def unknown(self, element: Any) -> Iterator[Loss]:
        """Any other element: it goes where one of its attributes names what went, else its parts are looked at."""
        for attributes, kinds in (
            (_LINK_ATTRIBUTES, ("link",)),
            (_JOINT_ATTRIBUTES, ("joint",)),
            (_EITHER_ATTRIBUTES, ("link", "joint")),
        ):
            for attribute in attributes:
                name = element.get(attribute)
                limb = self._limb(name, *kinds)
                if limb is not None:
                    tag = str(element.tag)
                    detach(element)
                    yield Loss(tag, element.get("name") or f"{tag} of {name}", limb, f"refers to {name}")
                    return
        for child in list(element):
            if not isinstance(child.tag, str):
                continue
            lost = list(self.unknown(child))
            if lost and child.getparent() is None and child.tag in _ROLES:
                # `<sensor><parent link=.../></sensor>`: without it the element means nothing.
                detach(element)
                tag = str(element.tag)
                yield Loss(tag, element.get("name") or lost[0].name, lost[0].limb, lost[0].reason)
                return
            yield from lost
