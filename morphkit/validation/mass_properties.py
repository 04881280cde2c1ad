"""Whether the mass and inertia of a link fit its shapes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from morphkit.validation.document import CheckedDocument
from morphkit.validation.meshes import check_density

_LARGEST_SHARE = 10.0
"""Largest I / (m r^2) that raises no alarm, r being the distance of the furthest corner; 1 is the most there can be."""

_SMALLEST_SHARE = 1e-4
_SMALLEST_M = 1e-3


@dataclass(frozen=True)
class Shape:
    """A visual, collision or geom.

    Attributes:
        volume: m^3; 0 where it is unknown.
        corners: Of its bounding box, in the frame of the link, (8, 3), m.
    """

    volume: float
    corners: np.ndarray


def box(volume: float, half: Sequence[float] | np.ndarray, pose: Any) -> Shape:
    """A shape of a volume, m^3, whose bounding box has half extents `half`, m, around `pose`."""
    signs = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
    return Shape(volume, np.array([pose.apply(corner) for corner in signs * np.asarray(half)]))


def check_body(
    doc: CheckedDocument,
    element: Any,
    name: str,
    *,
    mass: float,
    center: np.ndarray | None,
    tensor: np.ndarray | None,
    shapes: Sequence[Sequence[Shape]],
) -> None:
    """Report a mass, center or inertia that does not fit.

    Args:
        doc: Receives the findings.
        element: Where mass and inertia are.
        name: Name of the link or body.
        mass: kg.
        center: Center of mass in the link's frame, m; None where unknown.
        tensor: Inertia about the center, kg*m^2, (3, 3); None where unknown.
        shapes: Alternatives, such as visuals and collisions; the one that fits best counts.
    """
    shapes = [group for group in shapes if group]
    if not shapes:
        return
    volumes = [sum(shape.volume for shape in group) for group in shapes if all(shape.volume > 0 for shape in group)]
    if volumes:
        fitting = min(volumes, key=lambda volume: abs(np.log(mass / volume / 1000.0)))
        check_density(doc, element, name, mass, fitting)
    points = np.concatenate([shape.corners for group in shapes for shape in group])
    low, high = points.min(axis=0), points.max(axis=0)
    diagonal = float(np.linalg.norm(high - low))
    if center is None or diagonal < _SMALLEST_M:
        return
    outside = float(np.linalg.norm(np.maximum(0.0, np.maximum(low - center, center - high))))
    if outside > diagonal:
        what = f"{name!r} has its center of mass {outside:.3g} m outside its shapes, which measure {diagonal:.3g} m"
        doc.add("center-outside", element, what, name=name)
        return
    if tensor is None:
        return
    radius = float(np.linalg.norm(points - center, axis=1).max())
    share = float(np.linalg.eigvalsh(tensor)[2]) / (mass * radius**2)
    if not _SMALLEST_SHARE <= share <= _LARGEST_SHARE:
        gyration = np.sqrt(share) * radius
        what = f"{name!r} has a radius of gyration of {gyration:.3g} m, and its shapes reach {radius:.3g} m"
        doc.add("inertia-size", element, what, name=name)
