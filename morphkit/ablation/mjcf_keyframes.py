"""Keyframes of an MJCF file: their vectors are cut to the joints, mocap bodies, actuators and tendons that stay."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Iterable, Iterator
from typing import Any

import mujoco
import numpy as np
from lxml import etree

from morphkit.ablation.loss import Loss
from morphkit.description import Description
from morphkit.errors import AssetError
from morphkit.formats import xml
from morphkit.formats.edit import detach, detach_emptied
from morphkit.formats.isolation import expanding, isolated
from morphkit.formats.mjcf_attach import prepare_parse

_MESH_TYPES = ("mesh", "hfield", "sdf")
_USES_OF_GEOMS = ("spatial", "composite", "flexcomp")
"""Where `<geom>` is no geom of its own: a tendon wraps around one, a composite and a flex make theirs of it."""
_WIDTHS = {0: (7, 6), 1: (4, 3), 2: (1, 1), 3: (1, 1)}
"""Joint type -> how many of qpos and of qvel it takes."""
_WITHOUT_STATE = ("contact", "equality", "sensor", "custom", "visual", "statistic", "keyframe")


class KeyframeLayout:
    """Which of a keyframe's values belong to which element of a file, taken before anything is cut.

    Elements are known by their number in document order, so that one layout serves every copy of the tree.
    """

    def __init__(self, root: Any, description: Description) -> None:
        """Take the layout of the tree below `root`, which is that of `description`."""
        self._model: mujoco.MjModel | None = None
        self._names: dict[int, tuple[str, str]] = {}  # kind and name of each body, actuator and tendon
        if next(root.iterfind("keyframe/key"), None) is None:
            return
        skeleton = copy.deepcopy(root)
        # Names for what has none, so that an element is found again in the compiled model.
        for number, twin in enumerate(skeleton.iter()):
            kind = _kind(twin)
            if kind:
                twin.set("name", twin.get("name") or f"unnamed {number}")
                self._names[number] = kind, twin.get("name")
        _strip(skeleton)
        source = etree.tostring(skeleton)
        self._model = isolated(_compiled, description, expanding(description), skeleton=source)

    def number(self, root: Any) -> dict[int, int]:
        """id() of every element below `root`, a tree of which nothing was cut yet -> its number."""
        return {} if self._model is None else {id(element): number for number, element in enumerate(root.iter())}

    def cut(self, root: Any, numbers: Iterable[int]) -> Iterator[Loss]:
        """Take the values of what went out of every keyframe.

        Args:
            root: The tree after the cut.
            numbers: Those of the elements that went; what is no body, actuator or tendon does not matter.
        """
        keys = list(root.iterfind("keyframe/key"))
        if keys and self._model is None:
            yield from _drop(keys, "MuJoCo cannot compile the source to resize it")
        if not keys or self._model is None:
            return
        gone = self._indices(numbers)
        for key in keys:
            changed = []
            for attribute, (indices, size) in gone.items():
                words = key.get(attribute, "").split()  # where they end early, MuJoCo goes on with its defaults
                if len(words) > size:
                    yield from _drop([key], f"its {attribute} has {len(words)} values where the source has {size}")
                    break
                kept = [word for index, word in enumerate(words) if index not in indices]
                if len(kept) < len(words):
                    left = " ".join(kept)
                    changed.append(f"{attribute} lost {len(words) - len(kept)} of {len(words)} values")
                    if left:
                        key.set(attribute, left)
                    else:
                        del key.attrib[attribute]
            else:
                if changed:
                    yield Loss("keyframe", key.get("name", ""), "", "resized: " + ", ".join(changed))

    def _indices(self, numbers: Iterable[int]) -> dict[str, tuple[set[int], int]]:
        model = self._model
        assert model is not None
        gone: dict[str, set[int]] = {
            name: set() for name in ("qpos", "qvel", "act", "ctrl", "mpos", "mquat", "plastic")
        }
        for kind, name in (self._names[number] for number in numbers if number in self._names):
            if kind == "actuator":
                actuator = model.actuator(name).id
                if model.actuator_actadr[actuator] >= 0:
                    gone["act"] |= _span(model.actuator_actadr[actuator], model.actuator_actnum[actuator])
                gone["ctrl"] |= _span(*_controls(model, actuator))
            elif kind == "tendon":
                gone["plastic"] |= _plastic(model, "tendon_plasticadr", model.tendon(name).id)
            else:
                self._add_body(model.body(name).id, gone)
        sizes = {"qpos": model.nq, "qvel": model.nv, "act": model.na, "ctrl": model.nu}
        sizes |= {"mpos": 3 * model.nmocap, "mquat": 4 * model.nmocap, "plastic": int(getattr(model, "nplastic", 0))}
        return {name: (indices, sizes[name]) for name, indices in gone.items()}

    def _add_body(self, body: int, gone: dict[str, set[int]]) -> None:
        model = self._model
        assert model is not None
        mocap = int(model.body_mocapid[body])
        if mocap >= 0:
            gone["mpos"] |= _span(3 * mocap, 3)
            gone["mquat"] |= _span(4 * mocap, 4)
        first = int(model.body_jntadr[body])
        for joint in range(first, first + int(model.body_jntnum[body])):
            nq, nv = _WIDTHS[int(model.jnt_type[joint])]
            gone["qpos"] |= _span(model.jnt_qposadr[joint], nq)
            gone["qvel"] |= _span(model.jnt_dofadr[joint], nv)
            gone["plastic"] |= _plastic(model, "jnt_plasticadr", joint)


def _compiled(description: Description, *, skeleton: bytes) -> mujoco.MjModel | None:
    """The model of what is left of a description; None where MuJoCo cannot compile it."""
    try:
        tree = xml.parse(skeleton, file=description.file)
        files = prepare_parse(tree, description)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # they are about the robot, not about its layout
            return mujoco.MjSpec.from_string(etree.tostring(tree, encoding="unicode"), include=files).compile()
    except (ValueError, RuntimeError, AssetError):
        return None


def _drop(keys: Iterable[Any], reason: str) -> Iterator[Loss]:
    for key in keys:
        yield Loss("keyframe", key.get("name", ""), "", f"removed: {reason}")
        section = key.getparent()
        detach(key)
        detach_emptied(section)


def _span(start: Any, count: Any) -> set[int]:
    return set(range(int(start), int(start) + int(count)))


def _controls(model: mujoco.MjModel, actuator: int) -> tuple[int, int]:
    """First control input and their number; before MuJoCo 4 an actuator has exactly one."""
    if hasattr(model, "actuator_ctrladr"):
        return int(model.actuator_ctrladr[actuator]), int(model.actuator_ctrlnum[actuator])
    return actuator, 1


def _plastic(model: mujoco.MjModel, addresses: str, index: int) -> set[int]:
    """The values of `key/plastic` of a joint or tendon; MuJoCo 4 keeps the yielded angle of a spring there."""
    if not hasattr(model, addresses) or getattr(model, addresses)[index] < 0:
        return set()
    start = int(getattr(model, addresses)[index])
    arrays = [model.jnt_plasticadr, model.tendon_plasticadr, model.flex_plasticadr]
    later = [int(address) for address in np.concatenate(arrays) if address > start]
    return set(range(start, min([*later, model.nplastic])))


def _kind(element: Any) -> str:
    """`body`, `actuator` or `tendon`; empty for any other element."""
    if element.tag == "body":
        return "body"
    parent = element.getparent()
    section = parent.tag if parent is not None and isinstance(element.tag, str) else ""
    return str(section) if section in ("actuator", "tendon") else ""


def _strip(root: Any) -> None:
    """Take out what has no part in the state, and what needs files, so that missing meshes do no harm."""
    for section in list(root):
        if section.tag in _WITHOUT_STATE:
            root.remove(section)
    for element in list(root.iterfind("asset/*")):
        if element.tag != "model":
            element.getparent().remove(element)
    for element in root.iter("geom", "site", "tendon", "spatial", "flex", "skin", "light"):
        for attribute in ("mesh", "hfield", "material", "texture"):
            element.attrib.pop(attribute, None)
        if element.get("type") in _MESH_TYPES:
            element.set("type", "sphere")
        if element.tag == "geom" and element.getparent().tag not in _USES_OF_GEOMS:
            element.set("size", "0.1 0.1 0.1")  # whatever is there, which MuJoCo may refuse
    for element in list(root.iterfind("deformable/skin")) + list(root.iterfind("default//material")):
        element.getparent().remove(element)
    # Stand-ins have no proper inertia; the last word of several compiler sections counts.
    compiler = etree.SubElement(root, "compiler", boundmass="0.001", boundinertia="0.001", balanceinertia="true")
    etree.SubElement(compiler, "lengthrange", mode="none")  # those of muscles take a simulation
