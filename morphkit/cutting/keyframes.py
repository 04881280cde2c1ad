"""Keyframes of an MJCF file: their vectors are cut to the joints and actuators that stay."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Iterable, Iterator
from typing import Any

import mujoco
import numpy as np
from lxml import etree

from morphkit.cutting.loss import Loss
from morphkit.cutting.tidy import detach, detach_emptied

_MESH_TYPES = ("mesh", "hfield", "sdf")


class Keyframes:
    """The layout of the vectors in a file's keyframes, taken before anything is cut."""

    def __init__(self, root: Any) -> None:
        self._keys = [key for section in root.iterfind("keyframe") for key in section.iterfind("key")]
        self._names: dict[int, str] = {}
        self._model: mujoco.MjModel | None = None
        if not self._keys:
            return
        self._held = list(root.iter())  # keeps the proxies alive, so that id() identifies an element
        skeleton = copy.deepcopy(root)
        # Names for what has none, so that an element is found again in the compiled model.
        for number, (element, twin) in enumerate(zip(self._held, skeleton.iter(), strict=True)):
            if isinstance(element.tag, str):
                if twin.get("name") is None and (twin.tag == "body" or _is_actuator(twin)):
                    twin.set("name", f"unnamed {number}")
                self._names[id(element)] = twin.get("name", "")
        _strip_assets(skeleton)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # they are about the robot, not about its layout
                self._model = mujoco.MjSpec.from_string(etree.tostring(skeleton, encoding="unicode")).compile()
        except (ValueError, RuntimeError):
            self._model = None

    def cut(self, bodies: Iterable[Any], actuators: Iterable[Any]) -> Iterator[Loss]:
        """Take the values of the joints, mocap bodies and actuators that went out of every keyframe.

        Args:
            bodies: The body elements that went, those below them included.
            actuators: The actuator elements that went.
        """
        bodies, actuators = list(bodies), list(actuators)
        if not self._keys:
            return
        if self._model is None:
            yield from self._drop()
            return
        gone = self._indices(bodies, actuators)
        for key in self._keys:
            changed = []
            for attribute, (indices, size) in gone.items():
                words = key.get(attribute, "").split()
                if len(words) == size and indices:
                    left = " ".join(word for index, word in enumerate(words) if index not in indices)
                    changed.append(f"{attribute} lost {len(indices)} of {size} values")
                    if left:
                        key.set(attribute, left)
                    else:
                        del key.attrib[attribute]
            if changed:
                yield Loss("keyframe", key.get("name", ""), "", "resized: " + ", ".join(changed))

    def _drop(self) -> Iterator[Loss]:
        for key in self._keys:
            yield Loss("keyframe", key.get("name", ""), "", "removed: MuJoCo cannot compile the source to resize it")
            section = key.getparent()
            detach(key)
            detach_emptied(section)

    def _indices(self, bodies: list[Any], actuators: list[Any]) -> dict[str, tuple[set[int], int]]:
        model = self._model
        assert model is not None
        qpos: set[int] = set()
        qvel: set[int] = set()
        mocap: set[int] = set()
        act: set[int] = set()
        ctrl: set[int] = set()
        plastic: set[int] = set()
        widths = {0: (7, 6), 1: (4, 3), 2: (1, 1), 3: (1, 1)}
        for body in bodies:
            index = model.body(self._names[id(body)]).id
            mocap |= {int(model.body_mocapid[index])} - {-1}
            first = int(model.body_jntadr[index])
            for joint in range(first, first + int(model.body_jntnum[index])):
                nq, nv = widths[int(model.jnt_type[joint])]
                qpos |= _span(model.jnt_qposadr[joint], nq)
                qvel |= _span(model.jnt_dofadr[joint], nv)
                plastic |= _plastic(model, joint)
        for actuator in actuators:
            index = model.actuator(self._names[id(actuator)]).id
            if model.actuator_actadr[index] >= 0:
                act |= _span(model.actuator_actadr[index], model.actuator_actnum[index])
            ctrl |= _span(*_controls(model, index))
        return {
            "qpos": (qpos, model.nq),
            "qvel": (qvel, model.nv),
            "act": (act, model.na),
            "ctrl": (ctrl, model.nu),
            "mpos": ({3 * m + i for m in mocap for i in range(3)}, 3 * model.nmocap),
            "mquat": ({4 * m + i for m in mocap for i in range(4)}, 4 * model.nmocap),
            "plastic": (plastic, int(getattr(model, "nplastic", 0))),
        }


def _span(start: Any, count: Any) -> set[int]:
    return set(range(int(start), int(start) + int(count)))


def _controls(model: mujoco.MjModel, actuator: int) -> tuple[int, int]:
    """First control input and their number; before MuJoCo 4 an actuator has exactly one."""
    if hasattr(model, "actuator_ctrladr"):
        return int(model.actuator_ctrladr[actuator]), int(model.actuator_ctrlnum[actuator])
    return actuator, 1


def _plastic(model: mujoco.MjModel, joint: int) -> set[int]:
    """The values of `key/plastic` that belong to a joint; MuJoCo 4 keeps the yielded angle of a spring there."""
    if not hasattr(model, "jnt_plasticadr") or model.jnt_plasticadr[joint] < 0:
        return set()
    start = int(model.jnt_plasticadr[joint])
    arrays = [model.jnt_plasticadr, model.tendon_plasticadr, model.flex_plasticadr]
    later = [int(address) for address in np.concatenate(arrays) if address > start]
    return set(range(start, min([*later, model.nplastic])))


def _is_actuator(element: Any) -> bool:
    parent = element.getparent()
    return parent is not None and parent.tag == "actuator"


def _strip_assets(root: Any) -> None:
    """Take out what needs files and does not matter to the layout, so that missing meshes do no harm."""
    for element in list(root.iterfind("asset/*")):
        if element.tag != "model":
            element.getparent().remove(element)
    for element in root.iter("geom", "site", "tendon", "spatial", "flex", "skin", "light"):
        for attribute in ("mesh", "hfield", "material", "texture"):
            element.attrib.pop(attribute, None)
        if element.get("type") in _MESH_TYPES:
            element.set("type", "sphere")
        if element.tag == "geom" and element.get("size") is None and element.get("fromto") is None:
            element.set("size", "0.1 0.1 0.1")
    for element in list(root.iterfind("deformable/skin")) + list(root.iterfind("default//material")):
        element.getparent().remove(element)
    # Stand-ins have no proper inertia; the last word of several compiler sections counts.
    etree.SubElement(root, "compiler", boundmass="0.001", boundinertia="0.001", balanceinertia="true")
