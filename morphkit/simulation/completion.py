"""What a description lacks before it can be simulated: floor, base joints, motors, limb sensors."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import Any

import mujoco
import numpy as np

from morphkit.description import Description
from morphkit.errors import ConfigError
from morphkit.morphology import Actuator, Base
from morphkit.readers.urdf import drive_limits
from morphkit.simulation.inertia import settle_masses
from morphkit.simulation.mesh_repair import settle_meshes
from morphkit.tokens.quantities import sensed_quantities

FLOOR_NAME = "morphkit_floor"
URDF_TIMESTEP_S = 0.004
URDF_ARMATURE = 0.01
URDF_DAMPING = 0.1
_TINY = 1e-300
_MOST_BRAKING = 1e9  # rad/s^2 (m/s^2); MuJoCo starts anew beyond 1e10


def add_floor(spec: mujoco.MjSpec, *, solid: bool) -> bool:
    """Add a plane at height 0 where the world has neither plane nor height field; whether it was added.

    Args:
        spec: Changed in place.
        solid: Whether things collide with it. A robot on a fixed base gets a floor to look at only.
    """
    ground = (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD)
    if any(geom.type in ground for geom in spec.worldbody.geoms):
        return False
    spec.worldbody.add_geom(
        name=FLOOR_NAME,
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[40, 40, 1],
        rgba=[0.75, 0.78, 0.8, 1],
        contype=int(solid),
        conaffinity=int(solid),
        condim=3,
    )
    return True


def settle_urdf(spec: mujoco.MjSpec, description: Description, *, moving: Collection[str] = ()) -> list[str]:
    """Fill in what URDF has no words for, and mend masses, inertias and meshes that MuJoCo refuses.

    Time step 4 ms with the implicitfast integrator; armature 0.01 kg*m^2 (kg) on every joint. Where the file gives no
    damping: 0.1 N*m*s/rad (N*s/m), and a part that grows with the cube of the speed, such that the joint's effort limit
    drives it at its velocity limit. The robot's geoms collide with the floor but not with each other: a
    URDF does not say which links may touch, and neighbors often overlap.

    Args:
        spec: Changed in place.
        description: The URDF.
        moving: Names of bodies that are to move although they have no joint yet.

    Returns:
        A sentence for each thing that was mended.

    Raises:
        DescriptionError: An inertia is infinite, or a mesh that contacts need is refused.
    """
    limits = drive_limits(description)
    spec.option.timestep = URDF_TIMESTEP_S
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    for joint in spec.joints:
        joint.armature = max(joint.armature, URDF_ARMATURE)
        if not np.any(joint.damping):
            effort, speed = limits.get(joint.name, (None, None))
            joint.damping = [URDF_DAMPING, 0, _cubic_damping(effort or 0.0, speed or 0.0, joint.armature)]
        if not np.isfinite(joint.actfrcrange).all():  # of an infinite effort limit
            joint.actfrclimited, joint.actfrcrange = mujoco.mjtLimited.mjLIMITED_FALSE, [0, 0]
    for geom in spec.geoms:
        geom.conaffinity = 0
    return [*settle_masses(spec, description.file, moving), *settle_meshes(spec, description.file)]


def _cubic_damping(effort: float, speed: float, armature: float) -> float:
    """The coefficient of the cube of the speed with which `effort` drives a joint at `speed`.

    It is bounded such that no joint is braked with more than MuJoCo takes for a number, after it was driven by its
    whole effort for a time step.
    """
    if not (0 < effort < math.inf and 0 < speed < math.inf):
        return 0.0
    wanted = max(0.0, effort - URDF_DAMPING * speed) / max(speed * speed * speed, _TINY)
    first_speed = effort / armature * URDF_TIMESTEP_S
    return min(wanted, _MOST_BRAKING * armature / max(first_speed * first_speed * first_speed, _TINY))


def add_base_joints(spec: mujoco.MjSpec, root: Any, base: Base) -> None:
    """Attach the root to the world by a free joint, or by slides along world x and z and a hinge about world y.

    The z slide reads the height of the root's frame, m.
    """
    if base == "free":
        root.add_freejoint(name="root_free")
        return
    model = spec.copy().compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    world_to_root = data.body(root.name).xmat.reshape(3, 3).T
    for name, kind, axis in (("root_x", "SLIDE", 0), ("root_z", "SLIDE", 2), ("root_y", "HINGE", 1)):
        root.add_joint(
            name=name,
            type=getattr(mujoco.mjtJoint, f"mjJNT_{kind}"),
            axis=world_to_root[:, axis],
            limited=mujoco.mjtLimited.mjLIMITED_FALSE,
            armature=0,
            damping=[0, 0, 0],
            stiffness=[0, 0, 0],
            frictionloss=0,
            ref=root.pos[2] if name == "root_z" else 0,
        )


def add_motors(spec: mujoco.MjSpec, actuators: Sequence[Actuator]) -> None:
    """Add one motor an actuator, gear 1, its control bounded by the effort limit.

    Raises:
        ConfigError: An actuator that drives no joint.
    """
    for actuator in actuators:
        if actuator.joint is None:
            raise ConfigError(f"actuator {actuator.name!r} drives no joint, so no motor can be made for it")
        bounded = np.isfinite(actuator.low) and np.isfinite(actuator.high)
        motor = spec.add_actuator(
            name=actuator.name,
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            target=actuator.joint,
            ctrllimited=mujoco.mjtLimited.mjLIMITED_TRUE if bounded else mujoco.mjtLimited.mjLIMITED_FALSE,
        )
        motor.set_to_motor()
        if bounded:
            motor.ctrlrange = [actuator.low, actuator.high]


def motors_note(number: int) -> str:
    """What is said of so many added motors."""
    added = "1 motor was added," if number == 1 else f"{number} motors were added, each"
    return f"{added} bounded by its joint's effort limit"


def add_limb_sensors(spec: mujoco.MjSpec, bodies: Sequence[str]) -> None:
    """Append the sensors that tokens are read from, those of a limb one after the other; see `tokens.quantities`."""
    for body in bodies:
        for quantity in sensed_quantities():
            spec.add_sensor(
                name=limb_sensor(body, quantity.name),
                type=getattr(mujoco.mjtSensor, f"mjSENS_{str(quantity.sensor).upper()}"),
                objtype=mujoco.mjtObj.mjOBJ_XBODY,
                objname=body,
            )


def limb_sensor(limb: str, quantity: str) -> str:
    """Name of the sensor of a limb that a quantity is read from."""
    return f"morphkit/{limb}/{quantity}"
