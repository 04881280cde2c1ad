"""A cut against `MjSpec.delete`: the same model, in the form in which the robot compiles."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Literal
from unittest import mock

import mujoco
import numpy as np

from morphkit.description import Description
from morphkit.errors import MorphkitError
from morphkit.simulation import spec as mujoco_spec
from morphkit.simulation.spec import load_spec

from .mend import Missing, lose_field, mend, mend_urdf, missing_in

Form = Literal["meshes", "mesh-free"]
"""`meshes`: all meshes found and converted. `mesh-free`: small tetrahedra for meshes, and mended, see `mend`."""

TOLERANCE = 1e-9
_STAND_IN = b"v 0 0 0\nv .02 0 0\nv 0 .02 0\nv 0 0 .02\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
_SKIPPED = ("_", "name", "nname", "path", "npath", "signature", "nbuffer")
_ORDERED = ("mesh_", "nmesh", "bvh_", "geom_dataid")
_NAMES = ("body", "joint", "geom", "site", "camera", "light", "tendon", "actuator", "sensor", "equality", "key", "pair")


def spec_of(description: Description, form: Form, missing: Missing | None = None) -> mujoco.MjSpec:
    """The robot as MuJoCo parses it, in the given form; of a variant, `missing` is what is missing in its source."""
    spec = _parse(description, form)
    if form == "mesh-free":
        mend(spec, missing_in(spec) if missing is None else missing)
    return spec


def missing_names(description: Description) -> Missing:
    """What is missing in a robot's source."""
    return missing_in(_parse(description, "mesh-free"))


def _parse(description: Description, form: Form) -> mujoco.MjSpec:
    if form == "meshes":
        return load_spec(description)[0]
    if description.format == "urdf":
        description = replace(description, source=mend_urdf(description.source, file=description.file))
    with (
        mock.patch.object(mujoco_spec, "_mesh_bytes", return_value=("stand_in.obj", _STAND_IN)),
        mock.patch.object(mujoco_spec, "drop_shape", lose_field),
    ):
        return load_spec(description, incomplete=set())[0]


def without_body(description: Description, body: str, form: Form) -> mujoco.MjModel:
    """The oracle: `body` deleted by MuJoCo.

    What it leaves behind and then does not compile goes too: targets of cameras and lights; and of a URDF the unused
    meshes, for its importer makes only used ones.
    """
    spec = spec_of(description, form)
    spec.delete(spec.body(body))
    left = {body.name for body in spec.bodies}
    for looking in [*spec.cameras, *spec.lights]:
        if looking.targetbody and looking.targetbody not in left:
            looking.targetbody, looking.mode = "", mujoco.mjtCamLight.mjCAMLIGHT_FIXED
    if description.format == "urdf":
        used = {geom.meshname for geom in spec.geoms}
        for mesh in [mesh for mesh in spec.meshes if mesh.name not in used]:
            spec.delete(mesh)
    return spec.compile()


def differences(first: mujoco.MjModel, second: mujoco.MjModel, *, by_geom: bool) -> list[str]:
    """What two models differ in: names of arrays, sizes, options and lists of names.

    Args:
        first: A model.
        second: The other.
        by_geom: Whether meshes are compared geom by geom. MuJoCo's URDF importer orders meshes, and names geoms, by
            their first use, which may have been cut.
    """
    found = []
    for name in dir(first):
        if name.startswith(_SKIPPED) or name.endswith("pathadr") or (by_geom and name.startswith(_ORDERED)):
            continue
        one, other = getattr(first, name), getattr(second, name)
        if isinstance(one, np.ndarray):
            if not _equal(one, other):
                found.append(name)
        elif isinstance(one, int | float | bytes) and one != other:
            found.append(name)
    kinds = [kind for kind in _NAMES if not (by_geom and kind == "geom")]
    found += [f"names of {kind}" for kind in kinds if _names(first, kind) != _names(second, kind)]
    if by_geom and not found:
        found += [f"mesh of geom {geom}" for geom in range(first.ngeom) if not _same_mesh(first, second, geom)]
    return found


def _equal(one: np.ndarray, other: np.ndarray) -> bool:
    if np.array_equal(one, other):  # most are, and it is much faster
        return True
    return one.shape == other.shape and np.allclose(one, other, rtol=TOLERANCE, atol=TOLERANCE, equal_nan=True)


def _same_mesh(first: mujoco.MjModel, second: mujoco.MjModel, geom: int) -> bool:
    """Whether a geom has the same mesh in both models: its corners, triangles and frame."""
    pair = []
    for model in (first, second):
        mesh = int(model.geom_dataid[geom])
        if mesh < 0 or model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_MESH:
            pair.append([])
            continue
        corner, face = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
        corners = model.mesh_vert[corner : corner + model.mesh_vertnum[mesh]]
        faces = model.mesh_face[face : face + model.mesh_facenum[mesh]]
        pair.append([corners, faces, model.mesh_pos[mesh], model.mesh_quat[mesh]])
    return len(pair[0]) == len(pair[1]) and all(_equal(*both) for both in zip(*pair, strict=True))


def _names(model: mujoco.MjModel, kind: str) -> list[str]:
    count = {"equality": "neq", "pair": "npair", "key": "nkey", "camera": "ncam", "light": "nlight", "joint": "njnt"}
    obj = getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}")
    number = getattr(model, count.get(kind, {"actuator": "nactuator"}.get(kind, f"n{kind}")), None)
    number = model.nu if number is None else number
    return [mujoco.mj_id2name(model, obj, index) or "" for index in range(number)]


def forms(description: Description) -> Iterator[tuple[Form, str]]:
    """Try both forms; yield each with the reason why it does not compile, empty where it does."""
    tries: tuple[Form, ...] = ("meshes", "mesh-free")
    for form in tries:
        yield form, reason(lambda form=form: spec_of(description, form).compile())


def has_meshes(description: Description) -> bool:
    """Whether a robot whose meshes are all found has any."""
    return bool(spec_of(description, "meshes").meshes)


def reason(action: Any) -> str:
    """Why MuJoCo or morphkit refused `action`, in one line; empty where they did not."""
    try:
        action()
    except (ValueError, mujoco.FatalError, MorphkitError) as error:
        return " ".join(str(error).split())[:300]
    return ""
