"""Unit quaternions, real part first, over many environments."""

from __future__ import annotations

import numpy as np


def multiply(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """`other`, then `one`; (..., 4)."""
    w, u = one[..., :1], one[..., 1:]
    v, r = other[..., :1], other[..., 1:]
    real = w * v - (u * r).sum(-1, keepdims=True)
    return np.concatenate([real, w * r + v * u + np.cross(u, r)], -1)


def conjugate(quaternion: np.ndarray) -> np.ndarray:
    """The inverse rotation, (..., 4)."""
    return quaternion * np.array([1.0, -1.0, -1.0, -1.0])


def rotate(quaternion: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Vectors (..., 3) turned by quaternions (..., 4)."""
    w, u = quaternion[..., :1], quaternion[..., 1:]
    return vector + 2 * np.cross(u, np.cross(u, vector) + w * vector)


def yaw(quaternion: np.ndarray) -> np.ndarray:
    """Angle about the vertical by which the x axis is turned, rad, (...)."""
    w, x, y, z = np.moveaxis(quaternion, -1, 0)
    return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
