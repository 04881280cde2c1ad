"""Masses and inertias that MuJoCo accepts, changed no more than needed."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any

import mujoco
import numpy as np

from morphkit.errors import DescriptionError

_MARGIN = 1e-9
"""Share by which moments stay clear of what MuJoCo refuses, so that its rounding does no harm."""

_NOTABLE = 1e-6
SMALLEST_MOMENT = 1e-14
"""kg*m^2; MuJoCo refuses smaller principal moments."""

LEAST_MASS = 1e-10
"""kg; what is lighter is a placeholder, and too light for MuJoCo to move."""

STAND_IN_MASS = 1e-3
STAND_IN_GYRATION = 0.01
_NO_TENSOR = np.array([np.nan, 0, 0, 0, 0, 0])


def settle_masses(spec: mujoco.MjSpec, file: str, moving: Collection[str] = ()) -> Iterator[str]:
    """Make every mass and inertia of a URDF possible, in place; yield a sentence for each change.

    Links without a mass weigh nothing, whatever their shapes; a moving one to which nothing heavy is fixed gets 1 g. An
    inertia of zero becomes that of a radius of gyration of 1 cm. Impossible ones keep their axes: negative moments
    become small, and the smaller ones grow until no moment exceeds the sum of the others.

    Args:
        spec: Changed in place.
        file: What the robot is called in messages.
        moving: Names of bodies that are to move although they have no joint yet.

    Raises:
        DescriptionError: An inertia is infinite.
    """
    for body in spec.bodies[1:]:
        if body.explicitinertial and body.mass >= LEAST_MASS:
            yield from _settle_inertia(body, file)
            continue
        if body.explicitinertial and body.mass != 0:
            yield f"link {body.name!r} has mass {body.mass:g} kg, which counts as none"
        body.explicitinertial, body.fullinertia = False, _NO_TENSOR
        for geom in body.geoms:
            geom.mass = 0
        if (list(body.joints) or body.name in moving) and not _carries_mass(body):
            _set(body, STAND_IN_MASS, np.full(3, STAND_IN_MASS * STAND_IN_GYRATION**2))
            yield f"link {body.name!r} moves and has no mass: it got {STAND_IN_MASS:g} kg"


def _carries_mass(body: Any) -> bool:
    """Whether the body or one that is fixed to it has a mass of its own."""
    pending = [body]
    while pending:
        each = pending.pop()
        if each.explicitinertial and each.mass >= LEAST_MASS:
            return True
        pending.extend(child for child in each.bodies if not list(child.joints))
    return False


def _set(body: Any, mass: float, moments: np.ndarray) -> None:
    body.explicitinertial = True
    body.mass, body.inertia, body.fullinertia = mass, moments, _NO_TENSOR
    if not np.isfinite(body.ipos).all():
        body.ipos = np.zeros(3)


def _settle_inertia(body: Any, file: str) -> Iterator[str]:
    if np.isnan(body.fullinertia[0]):
        moments, axes = np.array(body.inertia, dtype=float), np.eye(3)
    else:
        xx, yy, zz, xy, xz, yz = body.fullinertia
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        if not np.isfinite(tensor).all():
            raise DescriptionError(
                f"{file}: the inertia of link {body.name!r} is not finite; 'morphkit check' says where"
            )
        moments, axes = np.linalg.eigh(tensor)
    settled = possible_moments(moments, float(body.mass))
    if np.array_equal(settled, moments):
        return
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1
    turn, turned = np.zeros(4), np.zeros(4)
    mujoco.mju_mat2Quat(turn, axes.ravel())
    mujoco.mju_mulQuat(turned, np.asarray(body.iquat, dtype=float), turn)
    body.iquat = turned
    _set(body, float(body.mass), settled)
    if np.allclose(settled, moments, rtol=_NOTABLE, atol=0):
        return  # possible but for rounding
    before, after = (", ".join(f"{moment:.4g}" for moment in each) for each in (moments, settled))
    yield f"inertia of link {body.name!r} is impossible: principal moments {before} became {after} kg*m^2"


def possible_moments(moments: np.ndarray, mass: float) -> np.ndarray:
    """Principal moments that a body can have, the nearest to `moments` that keep the largest.

    Args:
        moments: Three principal moments, kg*m^2.
        mass: kg; where no moment is above what MuJoCo takes for zero, they become those of a radius of gyration of
            1 cm.
    """
    if moments.max() <= SMALLEST_MOMENT:
        return np.full(3, mass * STAND_IN_GYRATION**2)
    order = np.argsort(moments)
    low, middle, high = np.maximum(moments[order], max(moments.max() * _NOTABLE, SMALLEST_MOMENT * (1 + _MARGIN)))
    lack = high * (1 + _MARGIN) - low - middle
    if lack <= 0 and np.array_equal([low, middle, high], moments[order]):
        return moments
    if lack > 0:
        # The lowest first, up to the middle one; then both alike.
        raised = min(lack, middle - low)
        low, lack = low + raised, lack - raised
        low, middle = low + lack / 2, middle + lack / 2
    settled = np.empty(3)
    settled[order] = low, middle, high
    return settled
