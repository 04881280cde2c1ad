"""What mass and inertia a rigid body can have."""

from __future__ import annotations

from typing import Any

import numpy as np

from morphkit.simulation.inertia import SMALLEST_MOMENT
from morphkit.validation.document import CheckedDocument

_ROUNDING = 0.01
_RELATIVE_ZERO = 1e-9


def check_tensor(
    doc: CheckedDocument, element: Any, tensor: np.ndarray, *, mass: float, owner: str, name: str, counts: bool = True
) -> bool:
    """Report an inertia tensor that no body has.

    Args:
        doc: Receives the finding.
        element: Where the tensor is.
        tensor: Inertia about the center of mass, kg*m^2, symmetric (3, 3).
        mass: Mass of the body, kg.
        owner: For the message, such as `link 'shin'`.
        name: Name of the link or body.
        counts: Whether the body is a notable part of what it is fixed to; where not, an inertia of zero is no matter.

    Returns:
        Whether the tensor is possible and not zero.
    """
    moments = np.linalg.eigvalsh(tensor)
    shown = ", ".join(f"{moment:.4g}" for moment in moments)
    largest = float(np.abs(moments).max())
    if largest > SMALLEST_MOMENT and (moments[0] < -_RELATIVE_ZERO * largest or moments[2] <= 0):
        doc.add("inertia-negative", element, f"{owner} has the principal moments {shown} kg*m^2", name=name)
        return False
    if moments[0] <= max(SMALLEST_MOMENT, _RELATIVE_ZERO * largest):
        what = f"{owner} has mass {mass:g} kg and the principal moments {shown} kg*m^2"
        if counts or largest > 0:
            doc.add("inertia-zero" if counts else "inertia-negligible", element, what, name=name)
        return False
    excess = moments[2] / (moments[0] + moments[1]) - 1
    if excess > _ROUNDING:
        what = f"{owner} has the principal moments {shown} kg*m^2: the largest exceeds the sum of the others"
        doc.add("inertia-triangle", element, what, name=name)
        return False
    if excess > _RELATIVE_ZERO * 1e3:
        what = f"{owner}: the largest principal moment exceeds the sum of the others by {excess:.2%} ({shown} kg*m^2)"
        doc.add("inertia-rounded", element, what, name=name)
    return True


def symmetric(xx: float, yy: float, zz: float, xy: float = 0.0, xz: float = 0.0, yz: float = 0.0) -> np.ndarray:
    """The tensor of six moments and products."""
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
