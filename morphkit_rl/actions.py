"""Actions in [-1, 1], as policies give them, and in the units of the actuators."""

from __future__ import annotations

import numpy as np

from morphkit.tokens import TokenSpec


class ActionScale:
    """The affine map from [-1, 1] onto a robot's control ranges; an unbounded control keeps [-1, 1]."""

    def __init__(self, spec: TokenSpec):
        low = np.array([-1.0 if a.low is None or a.high is None else a.low for a in spec.actuators])
        high = np.array([1.0 if a.low is None or a.high is None else a.high for a in spec.actuators])
        self.center, self.half = (low + high) / 2, (high - low) / 2

    def to_controls(self, action: np.ndarray) -> np.ndarray:
        """(..., actuators) in [-1, 1] to the actuators' units."""
        return self.center + self.half * action
