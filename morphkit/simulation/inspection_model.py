"""A robot description -> a MuJoCo model of its shapes, joints and masses that is only looked at, whatever is missing.

Unlike `simulation.build` it stops at no missing or broken mesh and at no impossible inertia: what cannot be used is
left out and noted. It cannot be stepped in a meaningful way.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from morphkit.description import Description
from morphkit.errors import DescriptionError
from morphkit.formats.document import Document, document_of
from morphkit.formats.isolation import compiling, isolated
from morphkit.morphology import Joint, JointKind, Morphology
from morphkit.readers import read
from morphkit.readers.urdf import drive_limits
from morphkit.simulation import completion, visual_geoms
from morphkit.simulation.spec import compile_spec, drop_shape, load_spec
from morphkit.simulation.start_pose import stand, start_pose

JOINT_KINDS: dict[int, JointKind] = {0: "free", 1: "ball", 2: "slide", 3: "hinge"}
"""Value of MuJoCo's mjtJoint -> kind of joint."""

_TINY = 1e-12  # kg, kg*m^2: what MuJoCo needs to accept a moving body without a mass
_PLAIN = 0.01  # m
_COULD_TOUCH = 1  # As a geom's priority, which means nothing where nothing touches.
_ELEMENT = re.compile(r"Element name '(.*?)', id \d+", re.DOTALL)


@dataclass(frozen=True)
class Mechanics:
    """A robot as shapes, joints and masses.

    Attributes:
        description: Where it comes from.
        morphology: Its limbs.
        model: The model: the robot and what else is in its file, without contacts.
        start: The start pose, shape (nq,).
        root: Body id of the root limb.
        limb_of: Body id -> name of the limb that the body belongs to, for all bodies of the robot.
        joints: Joint ids of the robot, those of its base first.
        base_joints: How many of `joints` move the root.
        weightless: Names of bodies whose mass is not known, because it follows from shapes that are missing.
        velocity_limits: What a URDF says of its joints and MuJoCo does not know: velocity limit, rad/s (m/s), by joint;
            None where it says none.
        notes: One sentence for each thing that was left out.
    """

    description: Description
    morphology: Morphology
    model: mujoco.MjModel
    start: np.ndarray
    root: int
    limb_of: dict[int, str]
    joints: tuple[int, ...]
    base_joints: int
    weightless: frozenset[str]
    velocity_limits: Mapping[str, float | None]
    notes: tuple[str, ...]

    @property
    def states_dynamics(self) -> bool:
        """Whether the file has words for start height, armature, stiffness and the gains of actuators: MJCF has."""
        return self.morphology.format == "mjcf"


def load_mechanics(description: Description, *, shapes: bool = True) -> Mechanics:
    """Read a description for looking at it.

    Args:
        description: The robot.
        shapes: Load everything that can be drawn, and draw a limb without shapes as a stick. Else only the shapes that
            masses follow from, which spares reading most meshes.

    Raises:
        DescriptionError: MuJoCo cannot read or compile the file, for a reason other than meshes and inertias, or a mass
            or a place is infinite.
        AssetError: An included file is missing.
    """
    read(description)
    made = isolated(_load, description, compiling(description), shapes=shapes)
    return made if made.description is description else replace(made, description=description)


def _load(description: Description, *, shapes: bool) -> Mechanics:
    morphology = read(description)
    incomplete: set[str] = set()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # MuJoCo's advice on the file is for those who simulate it.
        source = description if shapes or description.format == "mjcf" else _without_shapes(description)
        spec, dropped = load_spec(source, incomplete=incomplete, drawn=shapes)
        notes = list(dropped)
        limb_of = {member: limb.name for limb in morphology.limbs for member in limb.members}
        root = spec.body(morphology.root.name)
        if root is None:
            raise DescriptionError(f"{description.file}: MuJoCo made no body of root {morphology.root.name!r}")
        if description.format == "urdf":
            visual_geoms.hide_collision_shapes(spec)
            spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
        if shapes:
            visual_geoms.show_left_shapes(spec, incomplete)
            visual_geoms.add_sticks(spec, root, limb_of)
            has_floor = not completion.add_floor(spec, solid=False)
        else:
            _drop_meshes_without_mass(spec)
        weightless = {body.name for body in spec.bodies if body.name in incomplete and _weighs_by_shape(spec, body)}
        for geom in spec.geoms:
            if shapes or geom.meshname:
                geom.priority = _COULD_TOUCH if geom.contype or geom.conaffinity else 0
                geom.contype = geom.conaffinity = 0  # Else MuJoCo computes the convex hull of every mesh.
        model = _compile(spec, description.file, incomplete=weightless, notes=notes)
        _refuse_infinite(model, description.file)
    root_id = model.body(morphology.root.name).id
    start = start_pose(model, description.info.start, description.file)
    if shapes:
        start = stand(model, start, root_id, model.geom_priority == _COULD_TOUCH)
    if shapes:
        visual_geoms.color_limbs(model, root_id)
        if not has_floor:
            visual_geoms.lay_floor(model, model.geom(completion.FLOOR_NAME).id, root_id, start)
    own = {model.body(name).id: limb for name, limb in limb_of.items()}
    joints = tuple(joint for joint in range(model.njnt) if int(model.jnt_bodyid[joint]) in own)
    return Mechanics(
        description=description,
        morphology=morphology,
        model=model,
        start=start,
        root=root_id,
        limb_of=own,
        joints=joints,
        base_joints=int(model.body_jntnum[root_id]),
        weightless=frozenset(weightless),
        velocity_limits=_velocity_limits(description),
        notes=tuple(notes),
    )


def _velocity_limits(description: Description) -> dict[str, float | None]:
    limits = drive_limits(description) if description.format == "urdf" else {}
    return {joint: velocity for joint, (_, velocity) in limits.items()}


def base_joints(mechanics: Mechanics) -> tuple[Joint, ...]:
    """The joints of the root, which a `Morphology` does not hold."""
    model, found = mechanics.model, []
    for joint in mechanics.joints[: mechanics.base_joints]:
        limited = bool(model.jnt_limited[joint])
        low, high = (float(value) for value in model.jnt_range[joint]) if limited else (0.0, 0.0)
        found.append(Joint(model.joint(joint).name, JOINT_KINDS[int(model.jnt_type[joint])], limited, low, high))
    return tuple(found)


def _weighs_by_shape(spec: mujoco.MjSpec, body: Any) -> bool:
    """Whether the body's mass follows from its shapes."""
    by_shape = spec.compiler.inertiafromgeom
    kinds = mujoco.mjtInertiaFromGeom
    return by_shape == kinds.mjINERTIAFROMGEOM_TRUE or (
        by_shape == kinds.mjINERTIAFROMGEOM_AUTO and not body.explicitinertial
    )


def _without_shapes(description: Description) -> Description:
    """A URDF without shapes: nothing in it weighs by its shape, and reading meshes takes long."""
    tree = document_of(description).copy()
    for link in tree.getroot().iterchildren("link"):
        for shape in [*link.iterchildren("visual", "collision")]:
            link.remove(shape)
    document = Document.of_tree(tree, file=description.file)
    return replace(description, source=document.source, document=document)


def _drop_meshes_without_mass(spec: mujoco.MjSpec) -> None:
    """Make geoms spheres that need a mesh or height field from which no mass follows."""
    for geom in spec.geoms:
        if (geom.meshname or geom.hfieldname) and not _weighs_by_shape(spec, geom.parent):
            geom.meshname = geom.hfieldname = ""
            geom.type, geom.size = mujoco.mjtGeom.mjGEOM_SPHERE, [_PLAIN, 0, 0]
    used = {geom.meshname for geom in spec.geoms}
    for mesh in [mesh for mesh in spec.meshes if mesh.name not in used]:
        spec.delete(mesh)


def _compile(spec: mujoco.MjSpec, file: str, *, incomplete: set[str], notes: list[str]) -> mujoco.MjModel:
    """Compile `spec`; broken meshes and impossible inertias are left out and noted, with the names of their bodies."""
    spec.compiler.boundmass, spec.compiler.boundinertia = _TINY, _TINY
    spec.compiler.balanceinertia = True
    spec.compiler.fusestatic = spec.compiler.discardvisual = False  # what the file has is looked at as it stands there
    for _ in range(len(spec.meshes) + len(spec.bodies) + 1):
        try:
            return spec.compile()
        except ValueError as error:
            if not _leave_out(spec, str(error), incomplete, notes):
                break
    return compile_spec(spec, file)


def _refuse_infinite(model: mujoco.MjModel, file: str) -> None:
    facts = {
        "mass": model.body_mass,
        "inertia": model.body_inertia,
        "position": model.body_pos,
        "center": model.body_ipos,
    }
    for fact, values in facts.items():
        bad = np.flatnonzero(~np.isfinite(values.reshape(model.nbody, -1)).all(axis=1))
        if len(bad):
            name = model.body(int(bad[0])).name
            raise DescriptionError(f"{file}: the {fact} of {name!r} is no finite number; 'morphkit check' says where")


def _leave_out(spec: mujoco.MjSpec, complaint: str, incomplete: set[str], notes: list[str]) -> bool:
    """Leave out the mesh or the inertia that MuJoCo complains about; whether it was one of those."""
    reason = " ".join(complaint.removeprefix("Error:").split())
    for mesh in spec.meshes:
        if (mesh.name and f"'{mesh.name}'" in complaint) or (mesh.file and mesh.file in complaint):
            users = [geom for geom in spec.geoms if geom.meshname == mesh.name]
            if "volume" in complaint and mesh.inertia != mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL:
                mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # It can be drawn, but nothing weighs it.
                incomplete.update(geom.parent.name for geom in users if _weighs_by_shape(spec, geom.parent))
                return True
            notes.append(f"mesh {mesh.name!r} was left out: {reason}")
            drop_shape(spec, mesh, users, incomplete)
            return True
    named = _ELEMENT.search(complaint)
    body = spec.body(named[1]) if named and "inertia" in complaint else None
    if body is None or body.name in incomplete:
        return False
    notes.append(f"the inertia of {body.name!r} was left out: {reason}")
    incomplete.add(body.name)
    body.explicitinertial = True
    body.fullinertia = [np.nan, 0, 0, 0, 0, 0]
    body.mass, body.inertia, body.ipos = _TINY, [_TINY] * 3, [0, 0, 0]
    return True
