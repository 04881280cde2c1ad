"""What refers to a removed limb in an MJCF file, and goes with it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from morphkit.ablation.loss import Loss
from morphkit.formats.edit import detach, detach_emptied
from morphkit.formats.mjcf_schema import references

Removed = dict[tuple[str, str], str]
"""(kind, name) of everything removed -> the limb that it belonged or referred to."""
Bones = Mapping[str, Sequence[str]]
"""`file` attribute of a skin -> the bodies that the file names."""

_SECTIONS = ("contact", "deformable", "equality", "tendon", "actuator", "sensor", "custom", "asset")
_KINDS = {"freejoint": "joint", "spatial": "tendon", "fixed": "tendon"}
_BODY_PARTS = ("body", "joint", "freejoint", "geom", "site", "camera", "light")
_RECORDED_PARTS = ("joint", "freejoint", "site", "camera", "light")


def collect(body: Any, name: str, limb: str, removed: Removed) -> Iterator[Loss]:
    """Enter what is in `body`, its child bodies aside, into `removed`; yield what is worth recording of it.

    Args:
        body: The element that goes.
        name: Its name.
        limb: The limb that it belongs to.
        removed: Receives every named part.
    """
    removed[("body", name)] = limb
    for part in _parts(body):
        kind = _KINDS.get(part.tag, part.tag)
        own = part.get("name")
        if own:
            removed[(kind, own)] = limb
        if part.tag in _RECORDED_PARTS:
            yield Loss(kind, own or f"{kind} of {name}", limb, f"part of {limb}")


def _parts(body: Any) -> Iterator[Any]:
    """Everything in `body` and in its frames, but not in its child bodies."""
    for child in body:
        if child.tag == "frame":
            yield from _parts(child)
        elif child.tag in _BODY_PARTS and child.tag != "body":
            yield child


def prune_references(root: Any, removed: Removed, bones: Bones) -> Iterator[Loss]:
    """Take out whatever refers to something in `removed`, and what refers to that, until nothing does.

    A tendon, tuple, skin or flex goes whole where one of its parts goes, as with `MjSpec.delete`.
    """
    items = [item for section in root if section.tag in _SECTIONS for item in section if _can_refer(section, item)]
    found = True
    while found:
        found = False
        for item in items[:]:
            hit = _hit(item, removed, bones)
            if hit is None:
                continue
            kind, target = hit
            items.remove(item)
            found = True
            limb = removed[hit]
            name = item.get("name")
            own = _own_kind(item)
            if name:
                removed[(own, name)] = limb
            yield Loss(own, name or f"{item.tag} of {kind} {target}", limb, f"refers to {kind} {target}")
            section = item.getparent()
            detach(item)
            detach_emptied(section)
            if item.get("instance") is not None:
                yield from _drop_instance(root, item, f"{own} {name or item.tag}", limb)
    yield from _drop_targets(root, removed)


def _can_refer(section: Any, item: Any) -> bool:
    if not isinstance(item.tag, str):
        return False
    if section.tag == "custom":
        return bool(item.tag == "tuple")
    return bool(section.tag != "asset" or item.tag == "skin")


def _own_kind(item: Any) -> str:
    section = str(item.getparent().tag)
    return section if section in ("equality", "tendon", "actuator", "sensor") else str(item.tag)


def _hit(item: Any, removed: Removed, bones: Bones) -> tuple[str, str] | None:
    """The first removed thing that `item` or a part of it refers to."""
    if item.tag == "skin":
        bone = next((name for name in bones.get(item.get("file", ""), ()) if ("body", name) in removed), None)
        if bone is not None:
            return "body", bone
    for element in item.iter():
        if not isinstance(element.tag, str):
            continue
        for kind, name in references(element):
            if (kind, name) in removed:
                return kind, name
    return None


def _drop_instance(root: Any, user: Any, named: str, limb: str) -> Iterator[Loss]:
    """Take out the plugin instance that `user` refers to where nothing else does: MuJoCo refuses one without a user."""
    instance = user.get("instance")
    if any(element.get("instance") == instance for element in root.iter()):
        return
    for element in list(root.iterfind("extension/plugin/instance")):
        if element.get("name") == instance:
            detach(element)
            yield Loss("plugin", instance, limb, f"only {named} used it")


def _drop_targets(root: Any, removed: Removed) -> Iterator[Loss]:
    """Cameras and lights stay, but no longer turn toward a body that went."""
    for element in root.iter("camera", "light"):
        target = element.get("target")
        if target is None or ("body", target) not in removed:
            continue
        del element.attrib["target"]
        if element.get("mode") is not None:
            del element.attrib["mode"]
        else:
            element.set("mode", "fixed")  # the mode comes from a default class
        reason = f"no longer turns toward body {target}; it is fixed to what carries it"
        yield Loss(element.tag, element.get("name", ""), removed[("body", target)], reason)
