"""What a token specification holds: sensor tokens, actuator tokens and limbs."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SensorToken:
    """One scalar that a limb or a declared sensor senses.

    Attributes:
        index: Place in the observation, from 0.
        name: Name, unique in the robot, such as `ffoot_position_x`.
        text: What the text encoder reads, unique in the robot, such as `ffoot position x`.
        limb: Name of the limb in the description file; None for a declared sensor that belongs to no single limb.
        quantity: `position`, `translational_velocity`, `rotational_velocity`, `exponential_map`, `type`, `angle`,
            `joint_range_low` or `joint_range_high`; of a declared sensor that of its `Reading`, such as `gyro`.
        component: `x`, `y` or `z`; `0` to `3` for `type`; None where there is one scalar only.
        unit: Unit, `1` for a share or a flag.
        frame: `world` (x positions are relative to the root limb's x), None for scalars without a frame. A declared
            sensor's is that of its `Reading`, and its x positions are relative to nothing.
        low: What the value is clipped to from below; None where it is not clipped.
        high: What the value is clipped to from above; None where it is not clipped.
    """

    index: int
    name: str
    text: str
    limb: str | None
    quantity: str
    component: str | None
    unit: str
    frame: str | None
    low: float | None
    high: float | None


@dataclass(frozen=True, slots=True)
class ActuatorToken:
    """One scalar that an actuator accepts.

    Attributes:
        index: Place in the action and in the simulator's control vector, from 0.
        name: Name, unique in the robot, such as `ffoot_ctrl`.
        text: What the text encoder reads, unique in the robot.
        limb: Name of the limb that it drives; None where it drives no single limb, such as a tendon.
        joint: Name of the joint that it drives; None where it drives no single joint.
        unit: Unit of the control.
        low: Lower bound of the control; None where unbounded.
        high: Upper bound of the control; None where unbounded.
    """

    index: int
    name: str
    text: str
    limb: str | None
    joint: str | None
    unit: str
    low: float | None
    high: float | None


@dataclass(frozen=True, slots=True)
class TokenLimb:
    """A limb as tokens refer to it: names from the description file, the parent's too, and the family's type word."""

    name: str
    parent: str | None
    type: str | None
    joints: tuple[str, ...]
