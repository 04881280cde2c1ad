"""The arrays of a compiled MJCF model, element by element and by their names in MuJoCo.

All arrays of a kind count but for those that are listed here: what is compared elsewhere, what says where other arrays
hold something, what follows from the rest, and what only shows.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from morphkit.simulation.inspection_model import Mechanics

Row = dict[str, Any]
Rows = dict[str, Row]
"""Name of an element -> its limb under `limb`, then name of an array -> what it holds of the element."""

KINDS = {
    "body": ("body", mujoco.mjtObj.mjOBJ_BODY),
    "joint": ("jnt", mujoco.mjtObj.mjOBJ_JOINT),
    "site": ("site", mujoco.mjtObj.mjOBJ_SITE),
    "camera": ("cam", mujoco.mjtObj.mjOBJ_CAMERA),
    "tendon": ("tendon", mujoco.mjtObj.mjOBJ_TENDON),
    "actuator": ("actuator", mujoco.mjtObj.mjOBJ_ACTUATOR),
    "equality": ("eq", mujoco.mjtObj.mjOBJ_EQUALITY),
    "sensor": ("sensor", mujoco.mjtObj.mjOBJ_SENSOR),
    "geom": ("geom", mujoco.mjtObj.mjOBJ_GEOM),
    "contact pair": ("pair", mujoco.mjtObj.mjOBJ_PAIR),
    "contact exclusion": ("exclude", mujoco.mjtObj.mjOBJ_EXCLUDE),
}
"""Kind of element -> how its arrays' names begin, and MuJoCo's type of object."""
_COUNTED = {"body": "body_mass", "camera": "cam_fovy", "actuator": "actuator_trntype", "tendon": "tendon_num"}
_COUNTED |= {"contact pair": "pair_dim", "contact exclusion": "exclude_signature"}
OTHER_PREFIXES = frozenset(
    {
        *("mesh", "hfield", "tex", "mat", "skin", "flex", "flexedge", "bvh", "oct", "light"),
        *("key", "numeric", "text", "tuple", "plugin", "tree", "wrap", "name", "names"),
        *("B", "D", "M", "ten", "efm0", "efmC", "mapM2M", "mapD2M", "mapM2D"),
    }
)
"""Beginnings of arrays of meshes and looks, which do not count, of other objects, and of MuJoCo's own tables."""
ELSEWHERE = frozenset(
    {
        *("body_mass", "body_inertia", "body_ipos", "body_iquat", "body_parentid", "body_pos", "body_quat"),
        *("jnt_type", "jnt_axis", "jnt_pos", "jnt_range", "jnt_limited", "jnt_stiffness", "jnt_bodyid"),
        *("dof_damping", "dof_frictionloss", "dof_armature"),
        *("actuator_trntype", "actuator_trnid", "actuator_dyntype", "actuator_dynprm", "actuator_gear"),
        *("actuator_gainprm", "actuator_biasprm", "actuator_forcerange", "actuator_forcelimited"),
        *("actuator_ctrlrange", "actuator_ctrllimited", "sensor_cutoff"),
    }
)
"""Arrays that the tables of limbs, joints and actuators hold."""
_PLACES = re.compile(
    r".*(adr|num|treeid|rootid|weldid|mocapid|actuatorid|jntid|dof_bodyid|parentid|dataid|plugin|history)"
)
_DERIVED = re.compile(
    r".*(invweight0|subtreemass|_acc0|_length0|_M0|_length|_simple|_sameframe|_margin0|_pos0|_poscom0|_mat0|_bvh\w*)"
)
_LOOKS = re.compile(
    r".*(rgba|matid|_group|_user|_width|body_contype|body_conaffinity|body_margin)|cam_(ipd|user)|site_(size|type)"
    r"|geom_(aabb|rbound)|(pair|exclude)_signature"
)
_SHAPE = ("geom_type", "geom_size", "geom_pos", "geom_quat")
"""What counts of the geoms that touch others; of those that only show it is looks."""
_REFERENCE = re.compile(r"(site|cam|geom)_bodyid|cam_targetbodyid|eq_obj[12]id|sensor_(obj|ref)id|pair_geom[12]")


def is_compared(array: str) -> bool:
    """Whether an array of an `MjModel` is one of an element, and not left out for one of the reasons above."""
    prefix = array.partition("_")[0]
    if prefix not in ("dof", *(prefix for prefix, _ in KINDS.values())) or array in ELSEWHERE:
        return array in ("qpos0", "qpos_spring")
    return not any(each.fullmatch(array) for each in (_PLACES, _DERIVED, _LOOKS))


def rows(mechanics: Mechanics) -> dict[str, Rows]:
    """Kind of element -> its elements and what the model's arrays hold of them."""
    model = mechanics.model
    arrays = {name: value for name in dir(model) if isinstance(value := getattr(model, name), np.ndarray)}
    kept = {name: array for name, array in arrays.items() if is_compared(name)}
    return {kind: dict(_rows(mechanics, kind, kept)) for kind in KINDS}


def options(model: mujoco.MjModel) -> Row:
    """The settings of the physics, such as `timestep`."""
    return {name: _value(getattr(model.opt, name)) for name in dir(model.opt) if not name.startswith("_")}


def _rows(mechanics: Mechanics, kind: str, arrays: dict[str, np.ndarray]) -> Iterator[tuple[str, Row]]:
    model = mechanics.model
    prefix, of_type = KINDS[kind]
    own = {name: array for name, array in arrays.items() if name.startswith(f"{prefix}_")}
    limbs = {limb.name for limb in mechanics.morphology.limbs}
    for number in range(1 if kind == "body" else 0, len(getattr(model, _COUNTED.get(kind, f"{prefix}_type")))):
        name = mujoco.mj_id2name(model, of_type, number) or _unnamed(model, kind, number)
        row: Row = {"limb": _limb(mechanics, kind, number)}
        row |= {array: _reference(model, array, number) or _value(values[number]) for array, values in own.items()}
        if kind == "geom" and not _touches(model, number):
            row = {array: value for array, value in row.items() if array not in _SHAPE}
        if kind == "body" and (name not in limbs or model.body_parentid[number] == 0):
            row |= {each: _value(getattr(model, each)[number]) for each in ("body_pos", "body_quat")}
        if kind == "joint":
            row |= _of_joint(model, number, arrays)
        if kind == "equality" and _couples_joints(model, number):
            row = {key: row[key] for key in ("limb", "eq_solref", "eq_solimp")}
        if kind == "tendon":
            row["path"] = _path(model, number)
        yield name, row


def _touches(model: mujoco.MjModel, geom: int) -> bool:
    """Whether anything can touch a geom, by its bits or by a pair."""
    paired = (model.pair_geom1 == geom).any() or (model.pair_geom2 == geom).any()
    return bool(model.geom_contype[geom] or model.geom_conaffinity[geom] or paired)


def _couples_joints(model: mujoco.MjModel, equality: int) -> bool:
    """Whether it makes a joint follow another, which the tables of joints say."""
    return bool(model.eq_type[equality] == mujoco.mjtEq.mjEQ_JOINT and model.eq_obj2id[equality] >= 0)


def _unnamed(model: mujoco.MjModel, kind: str, number: int) -> str:
    """What an element without a name is called: after what it refers to, so that its number does not count."""
    if kind == "equality":
        return f"of {_reference(model, 'eq_obj1id', number)} and {_reference(model, 'eq_obj2id', number)}"
    if kind == "tendon":
        return f"along {' '.join(map(str, _path(model, number)[::2]))}"
    if kind == "geom":
        body = model.body(int(model.geom_bodyid[number]))
        return f"of {body.name} number {number - int(body.geomadr[0])}"
    if kind == "contact pair":
        return f"of {_reference(model, 'pair_geom1', number)} and {_reference(model, 'pair_geom2', number)}"
    if kind == "contact exclusion":
        first, second = divmod(int(model.exclude_signature[number]), 1 << 16)
        return f"of {model.body(first).name} and {model.body(second).name}"
    return f"number {number}"


def _of_joint(model: mujoco.MjModel, number: int, arrays: dict[str, np.ndarray]) -> Row:
    """What the arrays of degrees of freedom and positions hold of a joint."""
    kind = int(model.jnt_type[number])
    first, dofs = int(model.jnt_dofadr[number]), {0: 6, 1: 3}.get(kind, 1)
    row = {name: _value(values[first : first + dofs]) for name, values in arrays.items() if name.startswith("dof_")}
    if kind not in (0, 1):  # the place of a free joint is that of its body
        place = int(model.jnt_qposadr[number])
        row |= {name: _value(getattr(model, name)[place]) for name in ("qpos0", "qpos_spring")}
    return row


def _path(model: mujoco.MjModel, tendon: int) -> tuple[Any, ...]:
    """What a tendon runs along."""
    kinds = {1: "joint", 2: "pulley", 3: "site", 4: "geom", 5: "geom"}
    found: list[Any] = []
    for wrap in range(int(model.tendon_adr[tendon]), int(model.tendon_adr[tendon] + model.tendon_num[tendon])):
        kind, thing = kinds.get(int(model.wrap_type[wrap]), "nothing"), int(model.wrap_objid[wrap])
        name = getattr(model, kind)(thing).name if kind in ("joint", "site", "geom") and thing >= 0 else kind
        found += [name, f"{float(model.wrap_prm[wrap]):g}"]
    return tuple(found)


def _reference(model: mujoco.MjModel, array: str, number: int) -> str | None:
    """The name of the element that an array refers to; None where it holds no reference."""
    if _REFERENCE.fullmatch(array) is None:
        return None
    thing, of_type = int(getattr(model, array)[number]), mujoco.mjtObj.mjOBJ_BODY
    if array.startswith("pair_"):
        of_type = mujoco.mjtObj.mjOBJ_GEOM
    if array.startswith(("eq_", "sensor_")):
        types = {"eq": "eq_objtype", "sensor": array.replace("id", "type")}[array.partition("_")[0]]
        of_type = mujoco.mjtObj(int(getattr(model, types)[number]))
        if array.startswith("eq_") and of_type == mujoco.mjtObj.mjOBJ_UNKNOWN:
            of_type = {2: mujoco.mjtObj.mjOBJ_JOINT, 3: mujoco.mjtObj.mjOBJ_TENDON}.get(
                int(model.eq_type[number]), mujoco.mjtObj.mjOBJ_BODY
            )
    return (mujoco.mj_id2name(model, of_type, thing) if thing >= 0 else "") or "none"


def _limb(mechanics: Mechanics, kind: str, number: int) -> str | None:
    model = mechanics.model
    if kind in ("body", "joint", "site", "camera", "geom"):
        bodies = {"joint": "jnt_bodyid", "site": "site_bodyid", "camera": "cam_bodyid", "geom": "geom_bodyid"}
        body = number if kind == "body" else int(getattr(model, bodies[kind])[number])
        return mechanics.limb_of.get(body)
    return None


def _value(value: Any) -> Any:
    """A number, or a tuple of numbers without zeros at the end, which MuJoCo pads with."""
    numbers = [float(each) for each in np.ravel(value)]
    if np.ndim(value) == 0 or len(numbers) == 1:
        return numbers[0]
    return tuple(np.trim_zeros(np.array(numbers), "b").tolist())
