"""Actions in [-1, 1], as policies give them, and in the units of the actuators."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from morphkit.tokens.spec import TokenSpec

if TYPE_CHECKING:
    from morphkit_rl.models.layout import Layout


class ActionScale:
    """The affine map from [-1, 1] onto a robot's control ranges; an unbounded control keeps [-1, 1]."""

    def __init__(self, spec: TokenSpec):
        low = np.array([-1.0 if a.low is None or a.high is None else a.low for a in spec.actuators])
        high = np.array([1.0 if a.low is None or a.high is None else a.high for a in spec.actuators])
        self.center, self.half = (low + high) / 2, (high - low) / 2

    def to_controls(self, action: np.ndarray) -> np.ndarray:
        """(..., actuators) in [-1, 1] to the actuators' units."""
        return self.center + self.half * action


class ActionRows:
    """Action rows of a layout to controls: the columns that drive an actuator, in its units."""

    def __init__(self, layout: Layout):
        self._parts = [
            (np.arange(columns.start, columns.stop)[used], ActionScale(spec))
            for columns, used, spec in zip(layout.actions, layout.actuator_columns, layout.specs, strict=True)
        ]

    def to_controls(self, action: np.ndarray) -> list[np.ndarray]:
        """(batch, actions) in [-1, 1] to one (batch, actuators) a robot."""
        return [scale.to_controls(action[:, columns]) for columns, scale in self._parts]
