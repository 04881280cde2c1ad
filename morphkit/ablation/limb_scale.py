"""How much larger, heavier and stronger a limb of a variant is than that of its source."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class LimbScale:
    """Factors of one limb.

    Attributes:
        length: Of every length, in all directions. Masses of the same material go with its cube.
        mass: Of the mass and inertia, on top of that.
        gain: Of the forces and torques of what drives the limb: gears, gains of servos, force limits.
    """

    length: float = 1.0
    mass: float = 1.0
    gain: float = 1.0

    @property
    def total_mass(self) -> float:
        """Factor of the limb's mass."""
        return self.length**3 * self.mass

    @property
    def inertia(self) -> float:
        """Factor of the limb's moments of inertia."""
        return self.total_mass * self.length**2


SAME = LimbScale()
"""That of a limb as it is in the source."""
