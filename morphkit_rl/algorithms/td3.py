"""TD3 over many morphologies at once (Fujimoto et al. 2018, algorithm 1)."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from morphkit.errors import ConfigError
from morphkit_rl.algorithms import autograd_update, compiled_update
from morphkit_rl.algorithms.augmentation import Augmentation, Shown
from morphkit_rl.algorithms.compiled_update import CompiledUpdate
from morphkit_rl.algorithms.critic_losses import make_critic_loss
from morphkit_rl.algorithms.normalizer import normalize
from morphkit_rl.algorithms.transitions import Transitions
from morphkit_rl.buffers.replay_buffer import Batch
from morphkit_rl.config.learner_config import LearnerConfig
from morphkit_rl.config.methods import ModelSettings
from morphkit_rl.config.train_config import TD3Config
from morphkit_rl.kernels import library
from morphkit_rl.models import build
from morphkit_rl.models.blocks import set_precision
from morphkit_rl.models.layout import Layout
from morphkit_rl.models.perceptron_critic import build_perceptron_critic
from morphkit_rl.models.vocabulary import Vocabulary


class TD3:
    """Actor, twin critics, their targets and optimizers.

    Args:
        model: Size of the networks.
        config: Hyperparameters.
        embedding_size: Size of a token's text embedding.
        learner: Critics, their loss and step sizes; default: those of TD3 and the method.
        vocabulary: What the method must know of the training robots.
        critic_vocabulary: The same for perceptron critics, where these see more than the actor.
        tune: Makes a network's own text embeddings; None: they are frozen.
        device: Where the networks live.
        precision: `float32`, or `bfloat16` for the transformer layers; parameters are float32.

    Raises:
        ConfigError: The device cannot be used, the method or a size is impossible, or settings contradict each other.
    """

    def __init__(
        self,
        model: ModelSettings,
        config: TD3Config,
        embedding_size: int,
        *,
        learner: LearnerConfig | None = None,
        vocabulary: Vocabulary | None = None,
        critic_vocabulary: Vocabulary | None = None,
        tune: Callable[[], nn.Module] | None = None,
        device: str = "cpu",
        precision: str = "float32",
    ):
        self.config, self.options = config, learner or LearnerConfig()
        self.device = find_device(device)
        self.precision = precision
        self.critic_loss = make_critic_loss(self.options, self.device)
        self._build = lambda: build_networks(
            model, self.options, embedding_size, vocabulary, tune, critic_vocabulary or vocabulary
        )
        actor, critic = self._build()
        for network in (actor, critic):
            set_precision(network, getattr(torch, precision))
        self.actor, self.critic = actor.to(self.device), critic.to(self.device)
        self.actor_target, self.critic_target = (
            deepcopy(net).requires_grad_(False) for net in (self.actor, self.critic)
        )
        fused = self.device.type in ("cpu", "cuda")
        self._rates = config.learning_rate, self.options.critic_learning_rate or config.learning_rate
        self.actor_optimizer, self.critic_optimizer = (
            torch.optim.Adam(net.parameters(), rate, fused=fused)
            for net, rate in zip((self.actor, self.critic), self._rates, strict=True)
        )
        self.actor_average = deepcopy(self.actor_target) if self.options.actor_average > 0 else None
        self.updates = 0
        self._compiled: dict[Layout, CompiledUpdate | None] = {}

    def update(
        self,
        batch: Batch,
        scale: Tensor | None,
        shift: Tensor | None,
        layout: Layout,
        rng: np.random.Generator,
        number: int | None = None,
        reward_scale: Tensor | None = None,
        augmentation: Augmentation | None = None,
    ) -> dict[str, Tensor]:
        """Update the critics, and every `policy_delay`-th time the actor and the targets.

        A robot's reward holds for each of its values. Losses are means over a robot's values, then over the robots.

        Args:
            batch: Transitions of the layout's robots, raw observations of the layout `stored`.
            scale: (tokens,) factor that normalizes these; None leaves them as they are.
            shift: (tokens,) summand that normalizes observations; None as with `scale`.
            layout: The robots.
            rng: Source of the target noise and of what is shown.
            number: Which update it is, from 0, for `policy_delay`; default: that of all so far.
            reward_scale: (robots,) factors on rewards, besides `td3.reward_scale`; None for 1.
            augmentation: What the actor is shown besides the robots as they are.

        Returns:
            Scalars: `critic_loss` and `q_mean`, with `actor_loss` where the actor was updated.
        """
        factor = torch.full((layout.num_robots,), self.config.reward_scale, device=self.device)
        if reward_scale is not None:
            factor = factor * reward_scale
        first = 0 if self.config.actor_first else self.config.policy_delay - 1
        due = (self.updates if number is None else number) % self.config.policy_delay == first
        acts = due and self.updates >= self.options.actor_start
        noise = self._target_noise((len(batch.reward), layout.num_actions), rng)
        compiled = self._compiled_update(layout, batch) if augmentation is None else None
        if compiled is not None:
            losses = compiled.update_critics(batch, noise, scale, shift, factor, follow=due)
            if acts:
                losses["actor_loss"] = compiled.update_actor()
        else:
            obs, next_obs = (normalize(self._tensor(rows), scale, shift) for rows in (batch.obs, batch.next_obs))
            rest = (self._tensor(array) for array in (batch.action, batch.reward, batch.discount))
            transitions = Transitions(obs, next_obs, *rest)
            next_action = self._next_action(next_obs, layout, self._tensor(noise))
            losses = autograd_update.update_critics(self, transitions, next_action, layout, factor, follow=due)
            if acts:
                shown = Shown(layout) if augmentation is None else augmentation.draw(rng)
                losses["actor_loss"] = autograd_update.update_actor(self, obs, layout, shown, shift)
        self.updates += 1
        if self.config.reset_updates and self.updates % self.config.reset_updates == 0:
            self._reset(rng)
        return losses

    def _compiled_update(self, layout: Layout, batch: Batch) -> CompiledUpdate | None:
        """The quick way to update, where there is one."""
        if library.is_suspended():
            return None
        if layout not in self._compiled:
            suits = compiled_update.suits(self, self._tensor(batch.obs), layout)
            self._compiled[layout] = CompiledUpdate(self, layout, len(batch.reward)) if suits else None
        found = self._compiled[layout]
        if found is not None and not found.fits(len(batch.reward)):
            found = self._compiled[layout] = CompiledUpdate(self, layout, len(batch.reward))
        return found

    def _target_noise(self, shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
        bound = self.config.target_noise_clip
        return (rng.standard_normal(shape, dtype=np.float32) * self.config.target_noise).clip(-bound, bound)

    @torch.no_grad()
    def _next_action(self, next_obs: Tensor, layout: Layout, noise: Tensor) -> Tensor:
        """The target actor's action with noise on it."""
        return (self.actor_target(layout.part(next_obs), layout) + noise).clamp(-1, 1)

    @torch.no_grad()
    def act(
        self, obs: np.ndarray, scale: Tensor | None, shift: Tensor | None, layout: Layout, *, final: bool = False
    ) -> np.ndarray:
        """Noise-free actions in [-1, 1] (batch, actions) at raw observations (batch, tokens).

        Args:
            obs: Observations.
            scale: As in `update`.
            shift: As in `update`.
            layout: The robots.
            final: Whether the actor acts that is kept in the end: the average of weights, if there is one.
        """
        actor = self.actor_average if final and self.actor_average is not None else self.actor
        return actor(normalize(self._tensor(obs), scale, shift), layout).cpu().numpy()

    def set_rates(self, used: float) -> None:
        """Set the step sizes for a moment when the share `used` of the budget is used up."""
        left = 1 - (1 - self.options.final_learning_rate) * used
        for optimizer, rate in zip((self.actor_optimizer, self.critic_optimizer), self._rates, strict=True):
            for group in optimizer.param_groups:
                group["lr"] = rate * left

    def networks(self) -> dict[str, nn.Module]:
        """The networks by name; `actor` is the one that is kept in the end."""
        averaged = {} if self.actor_average is None else {"actor_online": self.actor}
        return {
            "actor": self.actor if self.actor_average is None else self.actor_average,
            **averaged,
            "critic": self.critic,
            "actor_target": self.actor_target,
            "critic_target": self.critic_target,
        }

    def actors(self) -> list[nn.Module]:
        """The actor, its target and, if there is one, its average."""
        return [self.actor, self.actor_target, *([self.actor_average] if self.actor_average is not None else [])]

    def optimizers(self) -> dict[str, torch.optim.Optimizer]:
        """The optimizers by name."""
        return {"actor": self.actor_optimizer, "critic": self.critic_optimizer}

    def _reset(self, rng: np.random.Generator) -> None:
        """Draw the last layers of all networks anew, targets like online ones, and forget their optimizers' moments."""
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(int(rng.integers(2**63)))
            fresh = self._build()
        nets = ((self.actor, self.actor_target, self.actor_optimizer),
                (self.critic, self.critic_target, self.critic_optimizer))  # fmt: skip
        for drawn, (online, target, optimizer) in zip(fresh, nets, strict=True):
            values = dict(drawn.named_parameters())
            for network in (online, target):
                for name, parameter in network.named_parameters():
                    if name.startswith(online.last_layers):
                        parameter.data.copy_(values[name])
                        optimizer.state.pop(parameter, None)

    def _tensor(self, array: np.ndarray) -> Tensor:
        return torch.as_tensor(array, dtype=torch.float32, device=self.device)


def build_networks(
    model: ModelSettings,
    learner: LearnerConfig,
    embedding_size: int,
    vocabulary: Vocabulary | None = None,
    tune: Callable[[], nn.Module] | None = None,
    critic_vocabulary: Vocabulary | None = None,
) -> tuple[Any, Any]:
    """The actor of a method, and the twin critics of the method or, made for `critic_vocabulary`, of the learner.

    Raises:
        ConfigError: There is no such method, or its critics cannot give categorical values.
    """
    actor, critic = build(model, embedding_size, vocabulary, tune)
    if learner.critic == "perceptron":
        return actor, build_perceptron_critic(learner, critic_vocabulary or vocabulary or Vocabulary())
    if learner.value == "categorical":
        raise ConfigError("learner.value = 'categorical' needs learner.critic = 'perceptron'")
    return actor, critic


def find_device(name: str) -> torch.device:
    """The device that PyTorch calls so.

    Raises:
        ConfigError: There is no such device, or it cannot be used on this machine.
    """
    try:
        device = torch.device(name)
        torch.zeros(1, device=device).item()
    except (RuntimeError, AssertionError) as error:  # The latter from a PyTorch that was built without the device.
        reason = str(error).strip().partition("\n")[0]
        raise ConfigError(f"device {name!r} cannot be used here: {reason}") from None
    return device


def resolve_precision(precision: str, device: str) -> str:
    """`auto` becomes `bfloat16` where the processor multiplies it natively, else `float32`.

    Raises:
        ConfigError: The device cannot be used.
    """
    if precision != "auto":
        return precision
    if find_device(device).type == "cuda":
        return "bfloat16" if torch.cuda.is_bf16_supported() else "float32"
    return "bfloat16" if torch.cpu._is_avx512_bf16_supported() else "float32"
