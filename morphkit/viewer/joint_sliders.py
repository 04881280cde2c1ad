"""Poses of a robot by the values of its joints, in the units that people read."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from morphkit.simulation.inspection_model import Mechanics
from morphkit.simulation.start_pose import couplings, follow

_BALL_DEGREES = 60.0
_SLIDE_M = 0.25  # How far a slide without limits is moved each way.


@dataclass(frozen=True, slots=True)
class Dial:
    """One number that moves a joint; a ball joint has three, its rotation vector's.

    Attributes:
        name: Name of the joint; of a ball joint with ` x`, ` y` or ` z`.
        limb: Limb that the joint moves.
        unit: `°` or `m`.
        low: Least value, in `unit`.
        high: Greatest value.
        start: Value in the start pose.
        joint: Id of the joint in the model.
        axis: Which component of a ball joint's rotation vector; None for hinges and slides.
    """

    name: str
    limb: str
    unit: str
    low: float
    high: float
    start: float
    joint: int
    axis: int | None = None


def dials(mechanics: Mechanics) -> tuple[Dial, ...]:
    """Everything that can be moved by itself: not a free or planar base, no joint that follows another."""
    model = mechanics.model
    free = mechanics.base_joints if mechanics.morphology.base != "fixed" else 0
    followers = {follower for follower, _, _ in couplings(model)}
    found: list[Dial] = []
    for joint in mechanics.joints[free:]:
        if joint not in followers:
            found += _dials_of(mechanics, joint)
    return tuple(found)


def pose(mechanics: Mechanics, values: Mapping[str, float]) -> np.ndarray:
    """The pose in which dials have the given values and everything else is as at the start.

    Args:
        mechanics: The robot.
        values: Name of a dial -> its value in the dial's unit; names of no dial do not matter.

    Returns:
        State, shape (nq,).
    """
    model = mechanics.model
    qpos = mechanics.start.copy()
    balls: dict[int, np.ndarray] = {}
    for dial in dials(mechanics):
        value = values.get(dial.name, dial.start)
        address = model.jnt_qposadr[dial.joint]
        if dial.axis is None:
            qpos[address] = math.radians(value) if dial.unit == "°" else value
        else:
            balls.setdefault(dial.joint, np.zeros(3))[dial.axis] = math.radians(value)
    for joint, rotation in balls.items():
        address = model.jnt_qposadr[joint]
        turn = np.array([1.0, 0, 0, 0])
        mujoco.mju_quatIntegrate(turn, rotation, 1.0)
        mujoco.mju_mulQuat(qpos[address : address + 4], mechanics.start[address : address + 4], turn)
    follow(model, qpos, couplings(model))
    return qpos


def swing(dial: Dial, steps: int) -> Sequence[float]:
    """Values of a dial from its start up to its greatest, down to its least and back, smoothly."""
    corners = [dial.start, dial.high, dial.low, dial.start]
    lengths = np.abs(np.diff(corners)) + 1e-9
    path = np.concatenate([[0.0], np.cumsum(lengths)])
    values = []
    for along in np.linspace(0, path[-1], steps):
        leg = min(int(np.searchsorted(path, along, side="right")) - 1, 2)
        share = (1 - math.cos(math.pi * (along - path[leg]) / lengths[leg])) / 2
        values.append(float(corners[leg] + share * (corners[leg + 1] - corners[leg])))
    return values


def _dials_of(mechanics: Mechanics, joint: int) -> list[Dial]:
    model = mechanics.model
    name, kind = model.joint(joint).name, model.jnt_type[joint]
    limb = mechanics.limb_of[int(model.jnt_bodyid[joint])]
    limited = bool(model.jnt_limited[joint])
    low, high = (float(value) for value in model.jnt_range[joint])
    start = float(mechanics.start[model.jnt_qposadr[joint]])
    if kind == mujoco.mjtJoint.mjJNT_SLIDE:
        low, high = (low, high) if limited else (start - _SLIDE_M, start + _SLIDE_M)
        return [Dial(name, limb, "m", low, high, start, joint)]
    if kind == mujoco.mjtJoint.mjJNT_HINGE:
        start = math.degrees(start)
        low, high = (math.degrees(low), math.degrees(high)) if limited else (min(start, -180.0), max(start, 180.0))
        return [Dial(name, limb, "°", low, high, start, joint)]
    if kind == mujoco.mjtJoint.mjJNT_BALL:
        most = math.degrees(high) if limited else _BALL_DEGREES
        return [Dial(f"{name} {axis}", limb, "°", -most, most, 0.0, joint, i) for i, axis in enumerate("xyz")]
    return []
