"""A URDF description -> an MJCF with motors, limits and meshes that MuJoCo compiles and steps."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path

import mujoco
import numpy as np

from morphkit.conversion.unsupported import Missing, without_counterpart
from morphkit.description import Description
from morphkit.errors import ConfigError, DescriptionError
from morphkit.formats.document import document_of
from morphkit.morphology import Base, Morphology
from morphkit.readers import read
from morphkit.simulation import completion
from morphkit.simulation.ground import raise_root
from morphkit.simulation.spec import compile_spec, load_spec
from morphkit.simulation.start_pose import KEYFRAMES, start_pose
from morphkit.simulation.timestep import settle_timestep, stays_finite

_DIGEST, _LONGEST_STEM = 8, 50


@dataclass(frozen=True)
class ConversionReport:
    """What a conversion did.

    Attributes:
        description: The URDF.
        base: How its root is attached to the world.
        notes: One sentence for each thing that was added, changed or left out.
        missing: What has no counterpart in MJCF.
        bodies: Number of bodies.
        joints: Number of joints, those of a free or planar base included.
        motors: Number of motors.
        mass: Mass of the robot, kg.
    """

    description: Description
    base: Base
    notes: tuple[str, ...]
    missing: tuple[Missing, ...]
    bodies: int
    joints: int
    motors: int
    mass: float

    def report(self) -> ConversionReport:
        """The same without the model, which cannot be pickled."""
        return ConversionReport(**{each.name: getattr(self, each.name) for each in fields(ConversionReport)})


@dataclass(frozen=True)
class Conversion(ConversionReport):
    """An MJCF made of a URDF.

    Attributes:
        spec: The model; `spec.assets` holds its meshes by their file name, among other names.
    """

    spec: mujoco.MjSpec


def convert(
    description: Description, *, base: Base | None = None, floor: bool | None = None, thorough: bool = True
) -> Conversion:
    """Convert a URDF.

    Every link becomes a body, fixed ones included; joints keep names, axes, limits, damping and friction; a mimic
    becomes an equality; joints with an effort limit get a motor of gear 1 whose control is bounded by it. What URDF
    leaves open is settled as in `simulation.build`: armature, damping where none is given, time step, and links that do
    not collide with each other.

    Args:
        description: The URDF.
        base: How to attach a root that no joint attaches; None takes what the description says.
        floor: Whether to add a floor; None adds one where the base is not fixed. A root that can move is then put at
            the height at which the robot touches it in its start pose.
        thorough: Whether a time step is looked for at which the robot stays finite whatever its motors do, which takes
            seconds; else only one at which it does by itself.

    Raises:
        ConfigError: It is an MJCF already, or `base` contradicts the joint that attaches the root.
        DescriptionError: It cannot be read, or MuJoCo cannot compile or step what it says.
        AssetError: A mesh that contacts need is missing.
    """
    if description.format != "urdf":
        raise ConfigError(f"{description.file}: is an MJCF model already; MuJoCo reads it as it is")
    morphology = read(description)
    missing = tuple(without_counterpart(document_of(description).root))
    spec, repaired = load_spec(description, only=morphology)
    notes = [*repaired]
    root = spec.body(morphology.root.name)
    if root is None:
        raise DescriptionError(f"{description.file}: MuJoCo made no body of root {morphology.root.name!r}")
    own_base = morphology.base if list(root.joints) else None
    if own_base is not None and base not in (None, own_base):
        raise ConfigError(
            f"{description.file}: base {base!r} was asked for, but a joint of {root.name!r} makes it {own_base}"
        )
    base = own_base or base or morphology.base
    notes += completion.settle_urdf(spec, description, moving=() if base == "fixed" else (root.name,))
    notes.append(
        f"joints got armature {completion.URDF_ARMATURE:g}, those without damping {completion.URDF_DAMPING:g} and as"
        " much as holds them at their velocity limits; links do not collide with each other"
    )
    floor = base != "fixed" if floor is None else floor
    if base != "fixed":
        if floor:
            model = compile_spec(spec.copy(), description.file)
            raise_root(spec, root, model, start_pose(model, description.info.start, description.file))
        if own_base is None:
            completion.add_base_joints(spec, root, base)
            notes.append(f"a {base} base was added at {root.name!r}")
        notes.append(f"{root.name!r} starts at height {root.pos[2]:.3f} m")
    if floor and completion.add_floor(spec, solid=base != "fixed"):
        notes.append("a floor was added")
    completion.add_motors(spec, morphology.actuators)
    notes += _motor_notes(morphology)
    _name_meshes(spec)
    model = compile_spec(spec, description.file)
    start = start_pose(model, description.info.start, description.file)
    if not np.array_equal(start, model.qpos0):
        spec.add_key(name=KEYFRAMES[0], qpos=start)
        notes.append(f"keyframe {KEYFRAMES[0]!r} holds the start pose, in which all joints are within their limits")
        model = compile_spec(spec, description.file)
    if thorough or not stays_finite(model, start):
        notes += settle_timestep(spec, model, start, description.file)
    return Conversion(
        description=description,
        base=base,
        spec=spec,
        notes=tuple(notes),
        missing=missing,
        bodies=int(model.nbody) - 1,
        joints=int(model.njnt),
        motors=int(model.nu),
        mass=float(model.body_subtreemass[model.body(root.name).id]),
    )


def _motor_notes(morphology: Morphology) -> Iterator[str]:
    bounded = [each for each in morphology.actuators if np.isfinite(each.high)]
    if bounded:
        yield completion.motors_note(len(bounded))
    for actuator in morphology.actuators:
        if actuator not in bounded:
            yield f"motor {actuator.name!r} is unbounded: joint {actuator.joint!r} has no effort limit"
    driven = {actuator.joint for actuator in morphology.actuators}
    for joint in morphology.joints:
        if joint.name not in driven:
            yield f"joint {joint.name!r} got no motor: it has no effort limit or transmission, or mimics another"


def _name_meshes(spec: mujoco.MjSpec) -> None:
    """Call meshes and their files as the URDF does, equal contents sharing one file.

    The names of files end in a digest of their content, so that files of two conversions can lie side by side.
    """
    file_of: dict[str, str] = {}
    assets: dict[str, bytes] = {}
    taken: set[str] = set()
    for mesh in spec.meshes:
        if not mesh.file:
            continue
        content = spec.assets[mesh.file]
        key = hashlib.sha256(content).hexdigest()
        own = Path(re.sub(r"[^\w.-]", "_", re.sub(r"^(\d+_)+", "", mesh.file)))
        if key not in file_of:
            file_of[key] = f"{own.stem[:_LONGEST_STEM]}-{key[:_DIGEST]}{own.suffix}"
            assets[file_of[key]] = content
        name = _unique(own.stem, taken)
        taken.add(name)
        for geom in spec.geoms:
            if geom.meshname == mesh.name:
                geom.meshname = name
        mesh.name, mesh.file = name, file_of[key]
    spec.assets = assets


def _unique(stem: str, taken: set[str]) -> str:
    name, number = stem, 1
    while name in taken:
        number += 1
        name = f"{stem}_{number}"
    return name
