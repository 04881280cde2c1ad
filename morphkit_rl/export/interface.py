"""What a program must know of an exported policy to drive its robot."""

from __future__ import annotations

import json
from dataclasses import dataclass, fields
from importlib import metadata
from typing import Any

from morphkit_rl.algorithms.policy import Policy
from morphkit_rl.envs.batch_env import BatchEnv
from morphkit_rl.envs.robot import Robot

INPUT, OUTPUT = "observation", "control"


@dataclass(frozen=True)
class Interface:
    """Metadata of an exported policy, a list for each property of the observation's and the control's scalars.

    Attributes:
        robot: Name of the robot.
        method: Name of the policy's method.
        base: How the root is attached to the world.
        control_frequency_hz: Control steps a second that the policy was trained with.
        sensor_names: Token of each scalar of the observation.
        sensor_units: Its unit.
        sensor_limbs: Limb that it belongs to.
        sensor_joints: Joint whose angle or range it is; None for others.
        sensor_quantities: What it measures, such as `position`.
        sensor_components: Component, such as `x`; None without one.
        sensor_constants: Its value where that never changes, such as a joint's range; None for others.
        actuator_names: Token of each scalar of the control.
        actuator_units: Its unit.
        actuator_low: Its lower bound; None without one.
        actuator_high: Its upper bound; None without one.
        morphkit_version: Version that exported it.
    """

    robot: str
    method: str
    base: str
    control_frequency_hz: float
    sensor_names: list[str]
    sensor_units: list[str]
    sensor_limbs: list[str | None]
    sensor_joints: list[str | None]
    sensor_quantities: list[str]
    sensor_components: list[str | None]
    sensor_constants: list[float | None]
    actuator_names: list[str]
    actuator_units: list[str]
    actuator_low: list[float | None]
    actuator_high: list[float | None]
    morphkit_version: str

    def to_metadata(self) -> dict[str, str]:
        """Text by name, as ONNX holds it: words as they are, everything else as JSON."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: value if isinstance(value, str) else json.dumps(value) for name, value in values.items()}


def interface_of(policy: Policy, robot: Robot) -> Interface:
    """The interface of a policy for one robot.

    Args:
        policy: The policy.
        robot: The robot, from `policy.prepare`.
    """
    sensors, actuators = robot.spec.sensors, robot.spec.actuators
    period_s = robot.simulation.model.opt.timestep * robot.task.frame_skip
    joints = _joints(robot)
    return Interface(
        robot=robot.name,
        method=policy.config.model.method,
        base=robot.simulation.base,
        control_frequency_hz=float(round(1 / period_s, 9)),
        sensor_names=[sensor.name for sensor in sensors],
        sensor_units=[sensor.unit for sensor in sensors],
        sensor_limbs=[sensor.limb for sensor in sensors],
        sensor_joints=joints,
        sensor_quantities=[sensor.quantity for sensor in sensors],
        sensor_components=[sensor.component for sensor in sensors],
        sensor_constants=_constants(policy, robot, joints),
        actuator_names=[actuator.name for actuator in actuators],
        actuator_units=[actuator.unit for actuator in actuators],
        actuator_low=[actuator.low for actuator in actuators],
        actuator_high=[actuator.high for actuator in actuators],
        morphkit_version=metadata.version("morphkit"),
    )


def _joints(robot: Robot) -> list[str | None]:
    """The joint of each sensor token; a limb with several joints has a token of a quantity for each, in their order."""
    model, simulation = robot.simulation.model, robot.simulation
    names = {
        limb.name: [model.joint(joint).name for joint in joints]
        for limb, joints in zip(robot.spec.limbs, simulation.limb_joints, strict=True)
    }
    left: dict[tuple[str | None, str], list[str]] = {}
    found: list[str | None] = []
    for sensor in robot.spec.sensors:
        about_joint = sensor.quantity == "angle" or sensor.quantity.startswith("joint_range")
        own = left.setdefault((sensor.limb, sensor.quantity), list(names.get(sensor.limb or "", ())))
        found.append(own.pop(0) if about_joint and own else None)
    return found


def _constants(policy: Policy, robot: Robot, joints: list[str | None]) -> list[Any]:
    """What never changes of an observation: types of limbs, ranges of joints, and the angle of the root's none."""
    observation = policy.config.trainer.observation
    env = BatchEnv([robot.simulation], [robot.task], 1, specs=[robot.spec], observation=observation)
    values = env.reset()[0][0].tolist()
    env.close()
    fixed = ("type", "joint_range_low", "joint_range_high")
    return [
        value if sensor.quantity in fixed or (sensor.quantity == "angle" and joint is None) else None
        for value, sensor, joint in zip(values, robot.spec.sensors, joints, strict=True)
    ]
