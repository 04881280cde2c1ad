"""Named arrays over all environments of one robot: what reward terms and observations are made of."""

from __future__ import annotations

from functools import cached_property

import mujoco
import numpy as np

from morphkit.simulation.actuation import drives
from morphkit.simulation.build import Simulation
from morphkit.tokens.quantities import numbers_per_limb, quantity_columns
from morphkit_rl.envs.feet import CONTACT_M, Feet
from morphkit_rl.envs.rotations import conjugate, multiply, rotate, yaw
from morphkit_rl.envs.start_frame import start_frame
from morphkit_rl.envs.stepping import SteppedRobot
from morphkit_rl.envs.task_settings import Task
from morphkit_rl.envs.tip import find_tip

_HINGE_OR_SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
_GRAVITY = np.array([0.0, 0.0, -1.0])


class RobotArrays:
    """Where a robot is in all its environments, n of them, after a control step.

    Everything is computed when it is asked for first. Frames: the body frame turns with the root's limb and is parallel
    to the world's in the start pose; the heading frame has its x axis where the body's points, in the horizontal plane,
    and its z axis vertical. All are float64.

    Args:
        simulation: The robot.
        task: Its task.
        stepped: Its states and models.
        sensors: Its limbs' sensor numbers, (n * limbs, numbers), kept up to date by others.

    Attributes:
        command: Velocity that it is told to move with: forward, to the left (m/s), turning left (rad/s), (n, 3).
        speed_unit: What a term counts speeds in, m/s.
        target: Where the tip is to be, world frame, m, (n, 3).
        action: Latest action, as shares of the actuators' ranges from -1 to 1, (n, actuators).
        previous_action: The one before, (n, actuators); 0 where an episode began.
        air_time: How long each foot has been off the floor, s, (n, feet); where it has just landed, how long it was.
        ended: Whether the robot fell in this step, bool (n,).
        age: Control steps since the episode began, (n, 1).
        factors: On friction, mass and gains in this episode, (n, 3).
        memory: All of these that the next step depends on, (n, numbers); they are views of it.
        dt: Duration of a control step, s.
    """

    def __init__(self, simulation: Simulation, task: Task, stepped: SteppedRobot, sensors: np.ndarray) -> None:
        self.simulation, self._stepped, self.model = simulation, stepped, simulation.model
        n = len(stepped.state)
        self.limbs = sensors.reshape(n, -1, numbers_per_limb())
        self.dt = stepped.frame_skip * float(self.model.opt.timestep)
        self.speed_unit = task.speed_unit
        self.feet, self.tip = Feet(simulation), find_tip(simulation)
        frame = start_frame(simulation)
        self._start_height, self._start_back = float(frame[2]), conjugate(frame[3:])
        every = [joint for own in simulation.limb_joints for joint in own]
        joints = [joint for joint in every if self.model.jnt_type[joint] in _HINGE_OR_SLIDE]
        self._balls = [joint for joint in every if joint not in joints]
        self._order = np.argsort([every.index(joint) for joint in (*joints, *self._balls)])
        self._qpos, self._qvel = self.model.jnt_qposadr[joints], self.model.jnt_dofadr[joints]
        self.joint_start = stepped.start[1 + self._qpos]
        limited = self.model.jnt_limited[joints] != 0
        self.joint_low = np.where(limited, self.model.jnt_range[joints, 0], -np.inf)
        self.joint_high = np.where(limited, self.model.jnt_range[joints, 1], np.inf)
        self._center, self._half = _middle_and_half(stepped.bounds)
        self._drives = drives(self.model, simulation.morphology.actuators, simulation.start)
        widths = {"command": 3, "target": 3, "action": self.model.nu, "previous_action": self.model.nu}
        widths |= {"air_time": len(self.feet.limbs), "age": 1, "factors": 3}
        ends = np.cumsum([0, *widths.values()])
        self.memory = np.zeros((n, ends[-1]))
        parts = {
            name: self.memory[:, a:b] for name, a, b in zip(widths, ends[:-1].tolist(), ends[1:].tolist(), strict=True)
        }
        self.command, self.target, self.factors = parts["command"], parts["target"], parts["factors"]
        self.action, self.previous_action = parts["action"], parts["previous_action"]
        self.air_time, self.age = parts["air_time"], parts["age"]
        self.ended = np.zeros(n, bool)
        self.factors[:] = 1.0

    def refresh(self) -> None:
        """Forget what was computed of an earlier state."""
        for name in _DERIVED:
            self.__dict__.pop(name, None)

    def remember(self, ctrl: np.ndarray, ended: np.ndarray) -> None:
        """Take over controls (n, actuators), in the actuators' units, and who fell, bool (n,), after a step."""
        self.refresh()
        self.previous_action[:] = self.action
        self.action[:] = (ctrl - self._center) / self._half
        self.ended = ended
        self.age += 1
        self.air_time += self.dt

    def settle(self) -> None:
        """Count the time in the air anew of feet that touch the floor; after the terms have seen it."""
        self.air_time[self.foot_contact] = 0.0

    def forget(self, which: np.ndarray) -> None:
        """Start episodes in environments `which`, int (k,), without a past."""
        self.action[which] = self.previous_action[which] = self.air_time[which] = self.age[which] = 0.0

    @cached_property
    def root_position(self) -> np.ndarray:
        """World frame, m, (n, 3)."""
        return self.limbs[:, 0, quantity_columns("position")]

    @cached_property
    def height(self) -> np.ndarray:
        """Height of the root's frame as a share of that at the start, (n,)."""
        return self.root_position[:, 2] / max(abs(self._start_height), 1e-6)

    @cached_property
    def orientation(self) -> np.ndarray:
        """Rotation of the body frame since the start, unit quaternions, (n, 4)."""
        return multiply(self.limbs[:, 0, quantity_columns("exponential_map")], self._start_back)

    @cached_property
    def gravity(self) -> np.ndarray:
        """Unit vector along gravity in the body frame, (n, 3)."""
        return rotate(conjugate(self.orientation), _GRAVITY)

    @cached_property
    def heading(self) -> np.ndarray:
        """How far left the robot has turned since the start pose, -pi to pi rad, (n,)."""
        return yaw(self.orientation)

    @cached_property
    def velocity(self) -> np.ndarray:
        """Velocity of the root in the heading frame: forward, left, up, m/s, (n, 3)."""
        velocity = self.limbs[:, 0, quantity_columns("translational_velocity")]
        cos, sin = np.cos(self.heading), np.sin(self.heading)
        x, y, z = velocity.T
        return np.stack([cos * x + sin * y, cos * y - sin * x, z], 1)

    @cached_property
    def rotational_velocity(self) -> np.ndarray:
        """Rotational velocity of the root in the body frame, rad/s, (n, 3)."""
        return rotate(conjugate(self.orientation), self.limbs[:, 0, quantity_columns("rotational_velocity")])

    @cached_property
    def yaw_rate(self) -> np.ndarray:
        """Speed of turning left, rad/s, (n,)."""
        return self.limbs[:, 0, quantity_columns("rotational_velocity").start + 2]

    @property
    def declared(self) -> np.ndarray:
        """What the sensors of the file read, in the order of their tokens, (n, readings), where that is observed."""
        return self._stepped.declared

    @cached_property
    def joint_position(self) -> np.ndarray:
        """Coordinates of the limbs' hinges and slides, rad (m), (n, joints)."""
        return self._stepped.qpos[:, self._qpos]

    @cached_property
    def joint_velocity(self) -> np.ndarray:
        """Their velocities, rad/s (m/s), (n, joints)."""
        return self._stepped.qvel[:, self._qvel]

    @cached_property
    def joint_speed(self) -> np.ndarray:
        """Velocity of each joint, balls included, whose speed counts, in the order of their tokens, (n, all joints)."""
        first = self.model.jnt_dofadr[self._balls]
        turning = [np.linalg.norm(self._stepped.qvel[:, a : a + 3], axis=1, keepdims=True) for a in first.tolist()]
        return np.concatenate([self.joint_velocity, *turning], 1)[:, self._order] if turning else self.joint_velocity

    @cached_property
    def power(self) -> np.ndarray:
        """Mechanical power, positive or negative, of each actuator that drives one hinge or slide, W, (n, drives)."""
        index = [own.index for own in self._drives]
        gear, gain = self.model.actuator_gear[index, 0], self.model.actuator_gainprm[index, 0]
        bias = self.model.actuator_biasprm[index]
        joint = self.model.actuator_trnid[index, 0]
        speed = self._stepped.qvel[:, self.model.jnt_dofadr[joint]]
        length = gear * self._stepped.qpos[:, self.model.jnt_qposadr[joint]]
        ctrl = self._center[index] + self._half[index] * self.action[:, index]
        force = gain * ctrl + bias[:, 0] + bias[:, 1] * length + bias[:, 2] * gear * speed
        effort = np.array([own.effort for own in self._drives])
        return np.clip(self.factors[:, 2:] * force * gear, -effort, effort) * speed

    @cached_property
    def weight(self) -> float:
        """The robot's weight, N."""
        mass = float(self.model.body_subtreemass[self.simulation.limb_body[0]])
        return max(mass * float(np.linalg.norm(self.model.opt.gravity)), 1e-6)

    @cached_property
    def foot_height(self) -> np.ndarray:
        """Height of the feet above the floor, m, (n, feet)."""
        feet = self.limbs[:, self.feet.limbs]
        center = rotate(feet[..., quantity_columns("exponential_map")], self.feet.center)[..., 2]
        return feet[..., quantity_columns("position").start + 2] + center - self.feet.radius - self.feet.floor

    @cached_property
    def foot_contact(self) -> np.ndarray:
        """Whether each foot touches the floor, bool (n, feet)."""
        return self.foot_height < CONTACT_M

    @cached_property
    def foot_landed(self) -> np.ndarray:
        """Whether each foot touches the floor and did not before this step, bool (n, feet)."""
        return self.foot_contact & (self.air_time > 1.5 * self.dt)

    @cached_property
    def foot_velocity(self) -> np.ndarray:
        """Velocity of the feet, world frame, m/s, (n, feet, 3)."""
        feet = self.limbs[:, self.feet.limbs]
        arm = rotate(feet[..., quantity_columns("exponential_map")], self.feet.center)
        turning = np.cross(feet[..., quantity_columns("rotational_velocity")], arm)
        return feet[..., quantity_columns("translational_velocity")] + turning

    @cached_property
    def tip_position(self) -> np.ndarray:
        """Far end of the last limb of the deepest chain, world frame, m, (n, 3)."""
        limb = self.limbs[:, self.tip.limb]
        turned = rotate(limb[:, quantity_columns("exponential_map")], self.tip.point)
        return limb[:, quantity_columns("position")] + turned

    @cached_property
    def to_target(self) -> np.ndarray:
        """From the tip to its target, world frame, m, (n, 3)."""
        return self.target - self.tip_position


_DERIVED = tuple(name for name, value in vars(RobotArrays).items() if isinstance(value, cached_property))


def _middle_and_half(bounds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of the actuators' ranges, (2, actuators); an unbounded control counts in its own unit."""
    low, high = np.where(np.isfinite(bounds).all(0), bounds, [[-1.0], [1.0]])
    return (low + high) / 2, np.maximum((high - low) / 2, 1e-12)
