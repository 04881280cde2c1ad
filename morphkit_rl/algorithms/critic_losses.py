"""What critics learn: values as numbers, or as distributions over fixed atoms.

Critics give (members, batch, values) numbers, or (members, batch, values, atoms) logits.
"""

from __future__ import annotations

from typing import Protocol

import torch
from torch import Tensor

from morphkit.errors import ConfigError
from morphkit_rl.config.learner_config import LearnerConfig


class CriticLoss(Protocol):
    """How outputs of twin critics become values, targets and errors."""

    def expectation(self, output: Tensor) -> Tensor:
        """Values (members, batch, values)."""

    def target(self, next_output: Tensor, reward: Tensor, discount: Tensor) -> Tensor:
        """What both critics learn, from the target critics' outputs.

        Args:
            next_output: Outputs at the next observation.
            reward: (batch, values) rewards until there.
            discount: (batch, values) factor on the value there; 0 where nothing follows.
        """

    def error(self, output: Tensor, target: Tensor) -> Tensor:
        """(members, batch, values) errors of the outputs."""


class SquaredError:
    """Values are numbers; the target is that of the smaller twin (Fujimoto et al. 2018)."""

    def expectation(self, output: Tensor) -> Tensor:
        """The outputs themselves."""
        return output

    def target(self, next_output: Tensor, reward: Tensor, discount: Tensor) -> Tensor:
        """reward + discount * min(Q1, Q2)."""
        return reward + discount * next_output.amin(0)

    def error(self, output: Tensor, target: Tensor) -> Tensor:
        """Squared differences."""
        return (output - target).square()


class CrossEntropy:
    """Values are distributions over atoms from `-support` to `support` (Bellemare, Dabney, Munos 2017).

    The target is the distribution of the twin with the smaller mean, shifted by the reward, shrunk by the discount and
    projected back onto the atoms (their algorithm 1).

    Args:
        atoms: Number of atoms.
        support: Largest value.
        device: Where the atoms live.

    Raises:
        ConfigError: There are fewer than two atoms, or they do not differ.
    """

    def __init__(self, atoms: int, support: float, device: torch.device | str = "cpu"):
        if atoms < 2 or support <= 0:
            raise ConfigError(
                f"learner.atoms is {atoms} and learner.support {support}; expected at least two atoms and a positive "
                "support"
            )
        self.atoms, self.support = atoms, support
        self.values = torch.linspace(-support, support, atoms, device=device)

    def expectation(self, output: Tensor) -> Tensor:
        """Means of the distributions."""
        return torch.softmax(output, -1) @ self.values

    def target(self, next_output: Tensor, reward: Tensor, discount: Tensor) -> Tensor:
        """Probabilities (batch, values, atoms)."""
        probabilities = torch.softmax(next_output, -1)
        first, second = probabilities @ self.values
        smaller = torch.where((first < second)[..., None], probabilities[0], probabilities[1])
        return self.project(smaller, reward, discount)

    def project(self, probabilities: Tensor, reward: Tensor, discount: Tensor) -> Tensor:
        """Distribution of reward + discount * value, on the atoms; what lies beyond them goes to the outermost."""
        moved = (reward[..., None] + discount[..., None] * self.values).clamp_(-self.support, self.support)
        place = (moved + self.support) * ((self.atoms - 1) / (2 * self.support))
        below = place.floor().clamp_(0, self.atoms - 2)
        upper = probabilities * (place - below)
        index = below.long()
        projected = torch.zeros_like(probabilities).scatter_add_(-1, index, probabilities - upper)
        return projected.scatter_add_(-1, index + 1, upper)

    def error(self, output: Tensor, target: Tensor) -> Tensor:
        """Cross-entropies."""
        return -(target * torch.log_softmax(output, -1)).sum(-1)


def make_critic_loss(config: LearnerConfig, device: torch.device | str = "cpu") -> CriticLoss:
    """The loss that `config` names."""
    return CrossEntropy(config.atoms, config.support, device) if config.value == "categorical" else SquaredError()
