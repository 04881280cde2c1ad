"""Poses in description files: read from MJCF and URDF attributes, composed, and written back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from morphkit.errors import AblationError

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
        position = numbers(_given(element, "pos") or "0 0 0")
        return Pose(position, self.rotation(element))

    def rotation(self, element: Any) -> np.ndarray:
        """The quaternion that the orientation attribute of `element` gives.

        Raises:
            AblationError: It gives none, such as a turn about an axis of length 0.
        """
        attribute = next((name for name in _ORIENTATIONS if _given(element, name)), None)
        if attribute is None:
            return np.array([1.0, 0.0, 0.0, 0.0])
        with np.errstate(invalid="ignore", divide="ignore"):
            quat = self._quaternion(attribute, numbers(element.get(attribute)))
        if not np.isfinite(quat).all():
            wrong = f'{attribute}="{element.get(attribute)}" in <{element.tag}>'
            raise AblationError(f"line {element.sourceline}: {wrong} is no orientation")
        return quat

    def _quaternion(self, attribute: str, values: np.ndarray) -> np.ndarray:
        scale = 1.0 if self.radian else np.pi / 180
        quat = np.zeros(4)
        if attribute == "quat":
            quat = values
            mujoco.mju_normalize4(quat)
        elif attribute == "axisangle":
            mujoco.mju_axisAngle2Quat(quat, values[:3] / np.linalg.norm(values[:3]), values[3] * scale)
        elif attribute == "euler":
            mujoco.mju_euler2Quat(quat, values * scale, self.sequence)
        elif attribute == "xyaxes":
            x = values[:3] / np.linalg.norm(values[:3])
            y = values[3:] - x * np.dot(x, values[3:])
            y /= np.linalg.norm(y)
            mujoco.mju_mat2Quat(quat, np.column_stack([x, y, np.cross(x, y)]).ravel())
        else:
            mujoco.mju_quatZ2Vec(quat, values)
        return quat


def _given(element: Any, attribute: str) -> str:
    """What an attribute holds; MuJoCo takes one without a word for one that is not there."""
    return str(element.get(attribute, "")).strip()


def write_mjcf(element: Any, pose: Pose, *, keep_orientation: bool) -> None:
    """Set `pos` of an MJCF body, and its orientation as `quat` unless what is there is still right."""
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
    """Set `xyz` of a URDF origin, and its `rpy` unless what is there is still right."""
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
    """The numbers of an attribute, separated by white space; ValueError where one is none that simulators read."""
    if not value.isascii() or "_" in value:  # Python reads 1_000 and other digits, too
        raise ValueError(f"{value!r} is no number")
    return np.array([float(word) for word in value.split()])


def text(values: np.ndarray) -> str:
    """Numbers as an attribute: 15 significant digits, noise of the last one rounded off, no negative zero."""
    return " ".join(f"{0.0 if abs(value) < 1e-15 else value:.15g}" for value in np.asarray(values, dtype=float))
