"""What only a compiled MJCF tells: its mass, the lengths of its tendons, and how high its root stands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from morphkit.description import Description
from morphkit.formats.isolation import compiling, isolated
from morphkit.simulation.ground import ground_height, lowest_point
from morphkit.simulation.spec import compile_spec, load_spec
from morphkit.simulation.start_pose import upward


@dataclass(frozen=True)
class Lift:
    """The coordinate of the root that lifts it.

    Attributes:
        address: Its place in qpos.
        sign: 1 where it counts upward, else -1.
        free: Whether it is that of a free joint, the height itself; else that of a slide.
        reference: What it is in the zero pose.
    """

    address: int
    sign: float
    free: bool
    reference: float


@dataclass(frozen=True)
class Measures:
    """What a compiled model says of a robot.

    Attributes:
        mass: Mass of everything, kg, before `settotalmass`.
        tendons: Length of each tendon in the zero pose, m (rad), in the order of the model.
        lift: The coordinate that lifts the root; None where none does.
        ground: Height of the ground, m; 0 where there is none.
        root: Height of the root's origin in each pose, m.
        lowest: Height of the robot's lowest point in each pose, m.
        slides: Address in qpos of each slide, and its body.
        nq: Number of coordinates.
        nu: Number of controls.
    """

    mass: float
    tendons: tuple[float, ...]
    lift: Lift | None
    ground: float
    root: tuple[float, ...]
    lowest: tuple[float, ...]
    slides: tuple[tuple[int, str], ...]
    nq: int
    nu: int


def measure(description: Description, root: str, poses: Sequence[np.ndarray] = ()) -> Measures:
    """Measure an MJCF.

    Args:
        description: The MJCF.
        root: Name of the robot's root.
        poses: Coordinates, (nq,) each; those of another size count as the zero pose, which comes before all of them.

    Raises:
        DescriptionError: MuJoCo cannot compile it.
        AssetError: A mesh is missing.
    """
    return isolated(_measure, description, compiling(description), root=root, poses=list(poses))


def _measure(description: Description, *, root: str, poses: Sequence[np.ndarray]) -> Measures:
    spec, _ = load_spec(description, drawn=False)
    spec.compiler.settotalmass = -1
    model = compile_spec(spec, description.file)
    body = model.body(root).id
    data = mujoco.MjData(model)
    heights, lowest = [], []
    for pose in [model.qpos0, *(pose if len(pose) == model.nq else model.qpos0 for pose in poses)]:
        data.qpos[:] = pose
        mujoco.mj_kinematics(model, data)
        heights.append(float(data.xpos[body, 2]))
        lowest.append(lowest_point(model, body, pose))
    slides = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE)
    return Measures(
        mass=float(model.body_mass.sum()),
        tendons=tuple(model.tendon_length0),
        lift=_lift(model, body),
        ground=ground_height(model) or 0.0,
        root=tuple(heights),
        lowest=tuple(lowest),
        slides=tuple((int(model.jnt_qposadr[j]), model.body(model.jnt_bodyid[j]).name) for j in slides),
        nq=int(model.nq),
        nu=int(model.nu),
    )


def _lift(model: mujoco.MjModel, root: int) -> Lift | None:
    found = upward(model, root)
    if found is None:
        return None
    address, sign = found
    joint = int(np.searchsorted(model.jnt_qposadr, address, side="right")) - 1
    free = bool(model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE)
    return Lift(address, sign, free, float(model.qpos0[address]))
