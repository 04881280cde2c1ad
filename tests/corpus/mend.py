"""Changes after which MuJoCo takes what it refuses whatever is cut; the same for a robot and its variant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from morphkit.formats import xml

SMALL_M = 1e-3
_SIZES = {"SPHERE": 1, "CAPSULE": 2, "CYLINDER": 2, "BOX": 3, "ELLIPSOID": 3}


def mend_urdf(source: bytes, *, file: str) -> bytes:
    """What MuJoCo's importer cannot parse: parts given twice, inertials without inertia, scales of meshes."""
    tree = xml.parse(source, file=file)
    for element in tree.getroot().iter("joint", "inertial"):
        for child in [child for child in element.iterchildren("*") if element.find(child.tag) is not child]:
            element.remove(child)
    for inertial in tree.getroot().iter("inertial"):
        if inertial.find("inertia") is None:
            zeros = dict.fromkeys(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), "0")
            inertial.append(inertial.makeelement("inertia", zeros))
    for mesh in tree.getroot().iter("mesh"):
        mesh.attrib.pop("scale", None)
    return xml.serialize(tree)


@dataclass(frozen=True, slots=True)
class Missing:
    """Names of the materials and geoms that a robot refers to and does not have."""

    materials: tuple[str, ...]
    geoms: tuple[str, ...]


def missing_in(spec: mujoco.MjSpec) -> Missing:
    """What is missing in a robot's source."""
    materials = {geom.material: spec.material(geom.material) for geom in spec.geoms if geom.material}
    geoms = {name: spec.geom(name) for pair in spec.pairs for name in (pair.geomname1, pair.geomname2)}
    return Missing(*(tuple(name for name, found in named.items() if found is None) for named in (materials, geoms)))


def mend(spec: mujoco.MjSpec, missing: Missing) -> None:
    """Give every shape a size, every body a mass and a possible inertia, and take out what else hinders compiling.

    Args:
        spec: A robot or a variant.
        missing: What is missing in the source, which is added. What is missing in a variant alone stays so.
    """
    for name in missing.materials:
        spec.add_material(name=name)
    for name in missing.geoms:
        spec.worldbody.add_geom(name=name)
    for geom in spec.geoms:
        _give_size(geom)
    for skin in list(spec.skins):
        spec.delete(skin)
    for joint in spec.joints:
        if joint.type == mujoco.mjtJoint.mjJNT_FREE and joint.parent.parent.name != "world":
            joint.type = mujoco.mjtJoint.mjJNT_BALL
        if joint.type == mujoco.mjtJoint.mjJNT_BALL:
            joint.range = [0, joint.range[1]]
    for body in spec.bodies:
        full = body.fullinertia
        if not np.isnan(full).any():
            xx, yy, zz, xy, xz, yz = full
            if np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])[0] <= 0:
                body.fullinertia, body.inertia = np.full(6, np.nan), [1e-3] * 3
    spec.compiler.balanceinertia = True
    spec.compiler.boundmass, spec.compiler.boundinertia = 1e-3, 1e-6
    spec.compiler.LRopt.mode = mujoco.mjtLRMode.mjLRMODE_NONE
    spec.memory = -1


def lose_field(spec: mujoco.MjSpec, field: Any, users: Sequence[Any], _: object) -> None:
    """Make small spheres of the geoms that use a height field that cannot be found."""
    for geom in users:
        geom.hfieldname, geom.type, geom.size = "", mujoco.mjtGeom.mjGEOM_SPHERE, [SMALL_M] * 3
    spec.delete(field)


def _give_size(geom: Any) -> None:
    """Sizes that are 0 become small; of a shape between two points only the radius is a size."""
    count = _SIZES.get(geom.type.name.removeprefix("mjGEOM_"), 0)
    if np.isfinite(geom.fromto).all():
        count = min(count, 1)
    geom.size = [max(size, SMALL_M) if place < count else size for place, size in enumerate(geom.size)]
