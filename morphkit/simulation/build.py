"""A robot description -> a MuJoCo model that can be stepped and whose sensors hold the numbers of every token."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import mujoco
import numpy as np

from morphkit.description import Actuation, Description
from morphkit.errors import ConfigError, DescriptionError
from morphkit.formats.isolation import compiling, isolated
from morphkit.morphology import Base, Morphology
from morphkit.readers import read
from morphkit.readers.mjcf import subtree
from morphkit.simulation import actuation as actuating
from morphkit.simulation import completion
from morphkit.simulation.ground import lowest_point, raise_root
from morphkit.simulation.inertia import settle_masses
from morphkit.simulation.mesh_repair import settle_meshes
from morphkit.simulation.spec import compile_spec, load_spec
from morphkit.simulation.start_pose import outside_limits, stand, start_pose
from morphkit.simulation.timestep import settle_timestep
from morphkit.tokens.quantities import numbers_per_limb, sensed_quantities
from morphkit.tokens.spec import TokenSpec, token_spec

_SHOWN_NAMES = 4


@dataclass(frozen=True)
class Simulation:
    """A robot that can be simulated.

    Attributes:
        description: Where it comes from.
        morphology: Its limbs, joints and actuators; `base` is how the model attaches the root.
        tokens: Its raw tokens; controls of `model` are in the order of `tokens.actuators`.
        model: The complete model, limb sensors last. Automatic resets are off: a diverged state stays visible as such.
        start: Coordinates of the start pose, see `start_pose`, (nq,), read-only.
        kinematics: A copy that senses limbs without computing forces. One step of it from a state, whatever the result,
            leaves in `sensordata` what `mj_forward` would sense there.
        limb_body: Body id of every limb, int (limbs,).
        limb_sensor: Index in `sensordata` of every limb's numbers, int (limbs, numbers), in the order of
            `tokens.quantities.sensed_quantities`.
        limb_joints: Joint ids of every limb, in the order of its angle tokens; none for the root.
        base_joints: Joint ids of the root: a free joint; x slide, z slide and y hinge of a planar base; none if fixed.
        notes: One sentence for each thing that was added or left out.
        mended: Those of `notes` that say what was changed of what the file says, as `convert` changes it.
        actuation: How the motors are driven.
        gains: Gains of the servo of each joint that got one, by the joint's name.
    """

    description: Description
    morphology: Morphology
    tokens: TokenSpec
    model: mujoco.MjModel
    start: np.ndarray
    kinematics: mujoco.MjModel
    limb_body: np.ndarray
    limb_sensor: np.ndarray
    limb_joints: tuple[tuple[int, ...], ...]
    base_joints: tuple[int, ...]
    notes: tuple[str, ...]
    mended: tuple[str, ...]
    actuation: Actuation = "as-file"
    gains: Mapping[str, actuating.Gains] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Name of the robot or variant."""
        return self.description.name

    @property
    def base(self) -> Base:
        """How the root is attached to the world."""
        return self.morphology.base


def compile_plain(description: Description) -> mujoco.MjModel:
    """Compile the file as it is, with nothing added but what a URDF lacks for that.

    Raises:
        DescriptionError: MuJoCo cannot read or compile it.
        AssetError: A mesh that is needed is missing.
    """
    return isolated(_compile_plain, description, compiling(description))


def _compile_plain(description: Description) -> mujoco.MjModel:
    spec, _ = load_spec(description, drawn=False)
    if description.format == "urdf":
        list(settle_masses(spec, description.file))
        list(settle_meshes(spec, description.file))
    return compile_spec(spec, description.file)


def build_simulation(
    description: Description,
    *,
    base: Base | None = None,
    actuation: Actuation | None = None,
    drawn: bool = True,
) -> Simulation:
    """Compile a description together with what it lacks to be simulated.

    Added where missing: a floor (`morphkit_floor`), base joints, motors within the effort limits (URDF); always, and
    last: the sensors of the limbs. The robot starts in its start pose, its root at the height at which it touches the
    ground; a root on slides of the file's own keeps its height where it starts in the zero pose and above the floor.

    Args:
        description: The robot.
        base: How to attach a root that has no joint of its own; None takes what the description says.
        drawn: Whether the model is drawn. Else no image of a texture and no mesh that only decorates is read, and
            textures are flat.
        actuation: How motors are driven, see `simulation.actuation`; None: by position on a free base whose file has no
            actuators, otherwise as the file says, with motors within the effort limits where it has none.

    Raises:
        DescriptionError: MuJoCo cannot read, compile or step it, or it has more control inputs than actuator tokens.
        AssetError: A mesh that the simulation needs is missing.
        ConfigError: `base` contradicts the root's own joints, or an actuator cannot be driven so.
    """
    read(description)
    made = isolated(_build, description, compiling(description), base=base, actuation=actuation, drawn=drawn)
    return made if made.description is description else replace(made, description=description)


def _build(description: Description, *, base: Base | None, actuation: Actuation | None, drawn: bool) -> Simulation:
    morphology = read(description)
    spec, dropped = load_spec(description, only=morphology, drawn=drawn, decorated=drawn)
    root = _find_root(spec, morphology)
    own_base = morphology.base if list(root.joints) else None
    if own_base is not None and base is not None and base != own_base:
        raise ConfigError(
            f"{description.file}: base {base!r} was asked for, but joints of {root.name!r} make it {own_base}; "
            f"leave the base out, or say {own_base}"
        )
    morphology = replace(morphology, base=own_base or base or morphology.base)
    limbs = _limb_names(root, morphology)
    moving = () if morphology.base == "fixed" else (root.name,)
    settled = completion.settle_urdf(spec, description, moving=moving) if description.format == "urdf" else []
    mended = (*dropped, *settled)
    own_actuators = bool(spec.actuators)
    notes = [*mended, *_complete(spec, root, morphology, own_base, description)]
    kind = actuating.choose(actuation, description.info, morphology.base, own_actuators=own_actuators)
    gains: Mapping[str, actuating.Gains] = {}
    if kind != "as-file" and len(spec.actuators) == len(morphology.actuators):
        plain = compile_spec(spec.copy(), description.file)
        pose = start_pose(plain, description.info.start, description.file)
        driven, gains = actuating.drive(spec, plain, pose, morphology.actuators, kind, description.info)
        morphology = replace(morphology, actuators=driven)
        if gains:
            notes.append(f"{len(gains)} of {len(driven)} actuators follow target positions around the start pose")
    completion.add_limb_sensors(spec, limbs)
    model = compile_spec(spec, description.file)
    tokens = token_spec(morphology)
    if model.nu != len(tokens.actuators):
        raise DescriptionError(
            f"{description.file}: the model has {model.nu} control inputs, but {len(tokens.actuators)} actuators "
            "were found in the file; actuators with several inputs are not supported"
        )
    body_ids = [model.body(name).id for name in limbs]
    start = start_pose(model, description.info.start, description.file)
    if own_base is not None:
        start = stand(model, start, body_ids[0])
    start.flags.writeable = False
    notes += _start_notes(model, start)
    if description.format == "urdf":
        notes += settle_timestep(spec, model, start, description.file)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_SENSOR)  # a file may do without; tokens cannot
    return Simulation(
        description=description,
        morphology=morphology,
        tokens=tokens,
        model=model,
        start=start,
        kinematics=_kinematics(model),
        limb_body=np.array(body_ids),
        limb_sensor=_sensor_addresses(model, limbs),
        limb_joints=((), *(_joints_of(model, body) for body in body_ids[1:])),
        base_joints=_base_joints(model, body_ids[0], morphology.base, description.file),
        notes=tuple(notes),
        mended=mended,
        actuation=kind,
        gains=gains,
    )


def _complete(
    spec: mujoco.MjSpec, root: Any, morphology: Morphology, own_base: Base | None, description: Description
) -> list[str]:
    notes: list[str] = []
    base = morphology.base
    has_floor = not completion.add_floor(spec, solid=base != "fixed")
    if base != "fixed" and (own_base is None or not has_floor):
        model = compile_spec(spec.copy(), description.file)
        pose = start_pose(model, description.info.start, description.file)
        if own_base is None:
            raise_root(spec, root, model, pose)
            completion.add_base_joints(spec, root, base)
            notes.append(f"a {base} base was added at {root.name!r}, which starts at height {root.pos[2]:.3f} m")
        elif lowest_point(model, model.body(root.name).id, pose) < 0:
            raise_root(spec, root, model, pose)
            notes.append(f"{root.name!r} was raised to {root.pos[2]:.3f} m, out of the floor")
    if not has_floor:
        notes.append("a floor was added")
    if not spec.actuators and morphology.actuators:
        completion.add_motors(spec, morphology.actuators)
        notes.append(completion.motors_note(len(morphology.actuators)))
    return notes


def _start_notes(model: mujoco.MjModel, start: np.ndarray) -> list[str]:
    left = outside_limits(model, start)
    moved = [joint for joint in outside_limits(model) if joint not in left]
    if not moved:
        return []
    names = ", ".join(moved[:_SHOWN_NAMES]) + (", ..." if len(moved) > _SHOWN_NAMES else "")
    return [f"the zero pose of {len(moved)} joints lies outside of their limits, so they start elsewhere: {names}"]


def _find_root(spec: mujoco.MjSpec, morphology: Morphology) -> Any:
    root = spec.body(morphology.root.name)
    if root is None:
        names = ", ".join(body.name for body in spec.bodies)
        raise DescriptionError(
            f"{morphology.file}: MuJoCo made no body of root {morphology.root.name!r}; it made {names}"
        )
    return root


def _limb_names(root: Any, morphology: Morphology) -> list[str]:
    """Names of the limbs' bodies in limb order, checked against what MuJoCo made of the file."""
    made = [body.name for body in subtree(root) if body is root or list(body.joints)]
    names = [limb.name for limb in morphology.limbs]
    if made != names:
        raise DescriptionError(
            f"{morphology.file}: MuJoCo makes the limbs {', '.join(made)} of the file, but it was read as "
            f"{', '.join(names)}; write out what replicate or attach makes"
        )
    return names


def _kinematics(model: mujoco.MjModel) -> mujoco.MjModel:
    kinematics = copy.deepcopy(model)
    off = mujoco.mjtDisableBit
    for flag in ("CONSTRAINT", "CONTACT", "ACTUATION", "GRAVITY", "SPRING", "DAMPER", "AUTORESET"):
        kinematics.opt.disableflags |= getattr(off, f"mjDSBL_{flag}")
    kinematics.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)  # bodies asleep are not sensed anew
    kinematics.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    kinematics.opt.density = kinematics.opt.viscosity = 0.0
    return kinematics


def _sensor_addresses(model: mujoco.MjModel, limbs: list[str]) -> np.ndarray:
    """Index in `sensordata` of each limb's numbers; the sensors of a limb follow one another."""
    first = [model.sensor(completion.limb_sensor(limb, sensed_quantities()[0].name)).adr[0] for limb in limbs]
    return np.array(first)[:, None] + np.arange(numbers_per_limb())


def _joints_of(model: mujoco.MjModel, body: int) -> tuple[int, ...]:
    first = int(model.body_jntadr[body])
    return tuple(range(first, first + int(model.body_jntnum[body]))) if first >= 0 else ()


def _base_joints(model: mujoco.MjModel, root: int, base: Base, file: str) -> tuple[int, ...]:
    """The root's joints in the order x slide, z slide, y hinge where the base is planar."""
    joints = _joints_of(model, root)
    if base != "planar":
        return joints
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    kinds = mujoco.mjtJoint
    found = []
    for kind, axis in ((kinds.mjJNT_SLIDE, 0), (kinds.mjJNT_SLIDE, 2), (kinds.mjJNT_HINGE, 1)):
        matching = [j for j in joints if model.jnt_type[j] == kind and abs(data.xaxis[j, axis]) > 0.99]
        if len(matching) != 1:
            raise DescriptionError(
                f"{file}: a planar base needs one slide along world x, one along world z and one hinge about world y; "
                f"the root has {', '.join(model.joint(j).name for j in joints)}, along or about other axes. Let "
                "it float or be fixed instead"
            )
        found += matching
    return tuple(found)
