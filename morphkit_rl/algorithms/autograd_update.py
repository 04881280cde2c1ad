"""The update of TD3 by PyTorch's operations and autograd, for any networks, losses and devices."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from morphkit_rl.algorithms.augmentation import Shown
from morphkit_rl.algorithms.saturation import saturation
from morphkit_rl.algorithms.transitions import Learner, Transitions
from morphkit_rl.models.layout import Layout


def update_critics(
    learner: Learner, batch: Transitions, next_action: Tensor, layout: Layout, factor: Tensor, *, follow: bool
) -> dict[str, Tensor]:
    """One step of the critics.

    A robot's reward holds for each of its values. Losses are means over a robot's values, then over the robots.

    Args:
        learner: Whose critics.
        batch: Transitions of the layout's robots.
        next_action: (batch, actions) the target actor's, with noise.
        layout: The robots.
        factor: (robots,) factors on rewards.
        follow: Whether the target critics move toward the critics afterwards.

    Returns:
        Scalars: `critic_loss` and `q_mean`.
    """
    stored, loss = layout.stored, learner.critic_loss
    robot = learner.critic.value_robot(stored)
    share = _shares(robot, layout)
    with torch.no_grad():
        next_output = learner.critic_target(batch.next_obs, next_action, stored)
        target = loss.target(next_output, (batch.reward * factor)[:, robot], batch.discount[:, robot])
    output = learner.critic(batch.obs, batch.action, stored)
    critic_loss = (loss.error(output, target).mean(1) * share).sum()
    _step(learner, critic_loss, learner.critic_optimizer, learner.critic)
    if follow:
        polyak(learner.critic_target, learner.critic, learner.config.tau)
    q = loss.expectation(output.detach()).mean((0, 1))
    return {"critic_loss": critic_loss.detach(), "q_mean": (q * share / factor[robot]).sum()}


def update_actor(learner: Learner, obs: Tensor, layout: Layout, shown: Shown, shift: Tensor | None) -> Tensor:
    """One step of the actor up the critics; its target and its average move toward it.

    Args:
        learner: Whose actor.
        obs: (batch, tokens) normalized observations.
        layout: The robots.
        shown: What the actor is shown of them.
        shift: (tokens,) what normalizing added to observations; None for nothing.

    Returns:
        The loss.
    """
    config, options, stored = learner.config, learner.options, layout.stored
    members = 1 if options.actor_objective == "first" else 2
    learner.critic.requires_grad_(False)
    own = shown.observe(layout.part(obs), None if shift is None else layout.part(shift))
    action = learner.actor(own, shown.layout)
    q = learner.critic_loss.expectation(learner.critic(obs, action, stored, members=members)).mean(0)
    learner.critic.requires_grad_(True)
    loss = -(q.mean(0) * _shares(learner.critic.value_robot(stored), layout)).sum()
    if config.saturation_penalty > 0:
        loss = loss + config.saturation_penalty * saturation(action, options.saturation_margin)
    _step(learner, loss, learner.actor_optimizer, learner.actor)
    if learner.actor_average is not None:
        polyak(learner.actor_average, learner.actor, 1 - options.actor_average)
    polyak(learner.actor_target, learner.actor, config.tau)
    return loss.detach()


@torch.no_grad()
def polyak(average: nn.Module, net: nn.Module, share: float) -> None:
    """Move a network's running average by `share` toward it."""
    torch._foreach_lerp_(list(average.parameters()), list(net.parameters()), share)


def _shares(robot: Tensor, layout: Layout) -> Tensor:
    """Weight of each value: robots count alike, and so do the values of each."""
    values = robot.new_zeros(layout.num_robots).index_add(0, robot, torch.ones_like(robot))  # bincount would wait
    return 1 / (layout.num_robots * values[robot])


def _step(learner: Learner, loss: Tensor, optimizer: torch.optim.Optimizer, net: nn.Module) -> None:
    optimizer.zero_grad(set_to_none=True)
    loss.backward()
    if learner.config.gradient_clip > 0:
        nn.utils.clip_grad_norm_(net.parameters(), learner.config.gradient_clip)
    optimizer.step()
