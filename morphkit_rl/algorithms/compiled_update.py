"""The update of TD3 by compiled kernels from end to end, where networks and losses are those of the default preset.

At batches of a few hundred samples, autograd and small operations take longer than all products of an update.
"""

from __future__ import annotations

import torch
from torch import Tensor

from morphkit_rl.algorithms.critic_losses import CrossEntropy
from morphkit_rl.algorithms.saturation import saturation_and_gradient
from morphkit_rl.algorithms.transitions import Learner, Transitions
from morphkit_rl.kernels import adam, categorical
from morphkit_rl.models import limb_former_pass
from morphkit_rl.models.layout import Layout
from morphkit_rl.models.perceptron_critic import PerceptronCritic


def suits(learner: Learner, obs: Tensor, layout: Layout) -> bool:
    """Whether there are kernels for all networks and losses of the learner at such observations."""
    return (
        isinstance(learner.critic_loss, CrossEntropy)
        and isinstance(learner.critic, PerceptronCritic)
        and learner.critic.suits_kernel(obs)
        and limb_former_pass.suits(learner.actor, obs, layout)
        and categorical.available(obs.device)
        and adam.available(obs.device)
    )


@torch.no_grad()
def update_critics(
    learner: Learner, batch: Transitions, next_action: Tensor, layout: Layout, factor: Tensor, *, follow: bool
) -> dict[str, Tensor]:
    """As `autograd_update.update_critics`."""
    critic, target, stored = learner.critic, learner.critic_target, layout.stored
    assert isinstance(learner.critic_loss, CrossEntropy)
    weight = torch.full_like(factor, 1 / (len(factor) * len(batch.reward)))
    call = critic.call(batch.obs, batch.action, stored, "parameters")
    errors = categorical.categorical_error(
        call.output,
        target(batch.next_obs, next_action, stored),
        batch.reward,
        batch.discount,
        learner.critic_loss.support,
        reward_scale=factor,
        weight=weight,
        value_weight=weight / factor,
    )
    parameters = critic.parameters_in_order
    gradients = call.backward(errors.gradient)[-len(parameters) :]
    averages = [(target.parameters_in_order, learner.config.tau)] if follow else []
    adam.adam_step(learner.critic_optimizer, parameters, gradients, learner.config.gradient_clip, averages)
    return {"critic_loss": errors.error, "q_mean": errors.value}


@torch.no_grad()
def update_actor(learner: Learner, obs: Tensor, layout: Layout) -> Tensor:
    """As `autograd_update.update_actor`, of the robots as they are."""
    config, options = learner.config, learner.options
    assert isinstance(learner.critic_loss, CrossEntropy)
    own = limb_former_pass.ActorPass(learner.actor, layout.part(obs), layout)
    members = 1 if options.actor_objective == "first" else 2
    call = learner.critic.call(obs, own.action, layout.stored, "action", members)
    weight = obs.new_full((layout.num_robots,), -1 / (layout.num_robots * len(obs)))
    loss, climb = categorical.categorical_value(call.output, learner.critic_loss.support, weight)
    gradient = call.backward(climb)[1]
    if config.saturation_penalty > 0:
        penalty, more = saturation_and_gradient(own.action, options.saturation_margin)
        loss = loss + config.saturation_penalty * penalty
        gradient = gradient.add_(more, alpha=config.saturation_penalty)
    averages = [(learner.actor_target, config.tau)]
    if learner.actor_average is not None:
        averages.append((learner.actor_average, 1 - options.actor_average))
    ordered = limb_former_pass.parameters_in_order
    adam.adam_step(
        learner.actor_optimizer,
        ordered(learner.actor),
        own.gradients(gradient),
        config.gradient_clip,
        [(ordered(average), share) for average, share in averages],
    )
    return loss
