"""Poses in description files: read from MJCF and URDF attributes, composed, and written back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

_ORIENTATIONS = ("quat", "axisangle", "euler", "xyaxes", "zaxis")


@dataclass(frozen=True, slots=True)
class Pose:
    """A frame in its parent frame.

    Attributes:
        position: Origin, shape (3,), m.
        rotation: Unit quaternion, scalar first, shape (4,).
    """

    position: np.ndarray
    rotation: np.ndarray

    def __matmul__(self, other: Pose) -> Pose:
        """The pose of `other`, given in this frame, in this frame's parent."""
        rotation = np.zeros(4)
        mujoco.mju_mulQuat(rotation, self.rotation, other.rotation)
        return Pose(self.apply(other.position), rotation)

    def apply(self, point: np.ndarray) -> np.ndarray:
        """The point (3,) of this frame in the parent frame."""
        return self.position + self.rotate(point)

    def rotate(self, vector: np.ndarray) -> np.ndarray:
        """The vector (3,) of this frame in the parent frame."""
        rotated = np.zeros(3)
        mujoco.mju_rotVecQuat(rotated, np.asarray(vector, dtype=float), self.rotation)
        return rotated

    def unrotate(self, vector: np.ndarray) -> np.ndarray:
        """The vector (3,) of the parent frame in this frame."""
        back = np.zeros(4)
        mujoco.mju_negQuat(back, self.rotation)
        return Pose(self.position, back).rotate(vector)

    @property
    def turned(self) -> bool:
        """Whether the frame's axes differ from its parent's."""
        return bool(np.any(np.abs(self.rotation[1:]) > 1e-12))


def identity() -> Pose:
    """The pose of a frame in itself."""
    return Pose(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))


@dataclass(frozen=True, slots=True)
class Angles:
    """How an MJCF file writes angles: `radian` or degrees, and the order of its Euler angles."""

    radian: bool = False
    sequence: str = "xyz"

    def pose(self, element: Any) -> Pose:
        """The pose that the attributes of an MJCF body or frame give."""
        position = numbers(element.get("pos", "0 0 0"))
        return Pose(position, self.rotation(element))

    def rotation(self, element: Any) -> np.ndarray:
        """The quaternion that the orientation attribute of `element` gives."""
        scale = 1.0 if self.radian else np.pi / 180
        quat = np.array([1.0, 0.0, 0.0, 0.0])
        if (text := element.get("quat")) is not None:
            quat = numbers(text)
            mujoco.mju_normalize4(quat)
        elif (text := element.get("axisangle")) is not None:
            values = numbers(text)
            axis = values[:3] / np.linalg.norm(values[:3])
            mujoco.mju_axisAngle2Quat(quat, axis, values[3] * scale)
        elif (text := element.get("euler")) is not None:
            mujoco.mju_euler2Quat(quat, numbers(text) * scale, self.sequence)
        elif (text := element.get("xyaxes")) is not None:
            values = numbers(text)
            x = values[:3] / np.linalg.norm(values[:3])
            y = values[3:] - x * np.dot(x, values[3:])
            y /= np.linalg.norm(y)
            mujoco.mju_mat2Quat(quat, np.column_stack([x, y, np.cross(x, y)]).ravel())
        elif (text := element.get("zaxis")) is not None:
            mujoco.mju_quatZ2Vec(quat, numbers(text))
        return quat


def write_mjcf(element: Any, pose: Pose, *, keep_orientation: bool) -> None:
    """Set `pos` of an MJCF body, and its orientation as `quat` unless what stands there is still right."""
    element.set("pos", text(pose.position))
    if not keep_orientation:
        for attribute in _ORIENTATIONS:
            element.attrib.pop(attribute, None)
        if pose.turned:
            element.set("quat", text(pose.rotation))


def urdf_pose(origin: Any | None) -> Pose:
    """The pose of a URDF `<origin xyz rpy>`; none is the identity."""
    pose = identity()
    if origin is None:
        return pose
    rotation = np.zeros(4)
    # Roll, pitch, yaw turn about the fixed axes x, y, z: MuJoCo writes such sequences in capitals.
    mujoco.mju_euler2Quat(rotation, numbers(origin.get("rpy", "0 0 0")), "XYZ")
    return Pose(numbers(origin.get("xyz", "0 0 0")), rotation)


def write_urdf(origin: Any, pose: Pose, *, keep_orientation: bool) -> None:
    """Set `xyz` of a URDF origin, and its `rpy` unless what stands there is still right."""
    origin.set("xyz", text(pose.position))
    if not keep_orientation:
        origin.set("rpy", text(_rpy(pose.rotation)))


def _rpy(rotation: np.ndarray) -> np.ndarray:
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, rotation)
    m = matrix.reshape(3, 3)
    cosine = np.hypot(m[0, 0], m[1, 0])
    pitch = np.arctan2(-m[2, 0], cosine)
    if cosine > 1e-9:
        return np.array([np.arctan2(m[2, 1], m[2, 2]), pitch, np.arctan2(m[1, 0], m[0, 0])])
    # Looking straight up or down only the sum or difference of roll and yaw counts: all of it goes to roll.
    return np.array([np.arctan2(-m[1, 2], m[1, 1]), pitch, 0.0])


def numbers(value: str) -> np.ndarray:
    """The numbers of an attribute, separated by white space."""
    return np.array([float(word) for word in value.split()])


def text(values: np.ndarray) -> str:
    """Numbers as an attribute: 15 significant digits, noise of the last one rounded off, no negative zero."""
    return " ".join(f"{0.0 if abs(value) < 1e-15 else value:.15g}" for value in np.asarray(values, dtype=float))
