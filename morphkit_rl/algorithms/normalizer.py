"""Running mean and variance per quantity and component, shared by all robots and limbs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from morphkit.tokens.spec import TokenSpec

CLIP = 10.0
"""Bound of standardized observations, so that a wild state cannot saturate the networks."""
OBSERVATION_BOUND = 1000.0
"""Bound of observations (m, m/s, rad/s, ...) as the statistics see them, so that a simulation on its way to diverging
cannot hide from all robots what they sense."""


class Normalizer:
    """Standardizes observations with statistics of like scalars.

    Statistics are kept per (quantity, component), never per robot or limb, so that limbs that were never seen have
    them too. Merging follows Chan et al. 1979.
    """

    def __init__(self) -> None:
        self.keys: list[str] = []
        self.count = np.zeros(0)
        self.mean = np.zeros(0)
        self.m2 = np.zeros(0)

    def index(self, specs: Sequence[TokenSpec], *, grow: bool = False) -> np.ndarray:
        """Row of statistics of each token of `specs` side by side; -1 for a quantity without any.

        Args:
            specs: Robots.
            grow: Whether to add rows for quantities that are new.
        """
        names = [f"{s.quantity}/{s.component or ''}" for spec in specs for s in spec.sensors]
        if grow:
            new = [name for name in dict.fromkeys(names) if name not in self.keys]
            self.keys += new
            self.count, self.mean, self.m2 = (
                np.append(a, np.zeros(len(new))) for a in (self.count, self.mean, self.m2)
            )
        row = {key: number for number, key in enumerate(self.keys)}
        return np.array([row.get(name, -1) for name in names], dtype=np.int64)

    def update(self, obs: np.ndarray, index: np.ndarray) -> None:
        """Add observations (batch, tokens), bounded by `OBSERVATION_BOUND`; `index` says of which statistics."""
        size = len(self.keys)
        obs = obs.astype(np.float64).clip(-OBSERVATION_BOUND, OBSERVATION_BOUND)
        count = np.bincount(index, minlength=size) * float(len(obs))
        total = np.bincount(index, obs.sum(0), minlength=size)
        seen = np.maximum(count, 1)
        mean = total / seen
        m2 = np.bincount(index, ((obs - mean[index]) ** 2).sum(0), minlength=size)
        merged = np.maximum(self.count + count, 1)
        delta = mean - self.mean
        self.mean = self.mean + delta * count / merged
        self.m2 = self.m2 + m2 + delta**2 * self.count * count / merged
        self.count = self.count + count

    def scale_and_shift(self, index: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Factor and summand (float32, one a token) with which `obs * factor + summand` is standardized."""
        variance = np.append(self.m2 / np.maximum(self.count, 1), 1.0)
        mean = np.append(self.mean, 0.0)
        factor = 1 / np.sqrt(variance + 1e-4)
        return factor[index].astype(np.float32), (-mean * factor)[index].astype(np.float32)

    def state_dict(self) -> dict[str, np.ndarray]:
        """The statistics; the keys travel separately, as `keys`."""
        return {"count": self.count, "mean": self.mean, "m2": self.m2}

    def load_state_dict(self, state: dict[str, np.ndarray], keys: Sequence[str]) -> None:
        """Take over statistics."""
        self.keys = list(keys)
        self.count, self.mean, self.m2 = (np.array(state[name], dtype=np.float64) for name in ("count", "mean", "m2"))


def normalize(obs: Tensor, scale: Tensor | None, shift: Tensor | None, *, out: Tensor | None = None) -> Tensor:
    """Observation rows times `scale` plus `shift` (`Normalizer.scale_and_shift`), bounded by `CLIP`.

    Without both, the rows as they are. `out` is where they are written to, if it is given.
    """
    if scale is None or shift is None:
        return obs if out is None else out.copy_(obs)
    return torch.mul(obs, scale, out=out).add_(shift).clamp_(-CLIP, CLIP)
