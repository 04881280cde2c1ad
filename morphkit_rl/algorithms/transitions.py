"""What an update learns from, and what it changes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import torch
from torch import Tensor

from morphkit_rl.algorithms.critic_losses import CriticLoss
from morphkit_rl.config.learner_config import LearnerConfig
from morphkit_rl.config.train_config import TD3Config


@dataclass(frozen=True, slots=True)
class Transitions:
    """As `Batch`, with normalized observations, on the device of the networks.

    Attributes:
        obs: (batch, tokens).
        next_obs: (batch, tokens).
        action: (batch, actions) in [-1, 1].
        reward: (batch, robots).
        discount: (batch, robots).
    """

    obs: Tensor
    next_obs: Tensor
    action: Tensor
    reward: Tensor
    discount: Tensor


class Learner(Protocol):
    """Networks with their settings and optimizers, as `TD3` has them."""

    config: TD3Config
    options: LearnerConfig
    critic_loss: CriticLoss
    actor: Any
    actor_target: Any
    actor_average: Any
    critic: Any
    critic_target: Any
    actor_optimizer: torch.optim.Adam
    critic_optimizer: torch.optim.Adam
