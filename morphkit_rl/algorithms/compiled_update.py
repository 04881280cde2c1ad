"""The update of TD3 by compiled kernels from end to end, where networks and losses are those of the default preset.

At batches of so few samples, autograd and small operations take longer than all products of an update. So everything
that an update computes lies in fixed memory, and kernels know where.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from morphkit_rl.algorithms.critic_losses import CrossEntropy
from morphkit_rl.algorithms.normalizer import normalize
from morphkit_rl.algorithms.saturation import saturation_and_gradient
from morphkit_rl.algorithms.transitions import Learner
from morphkit_rl.buffers.replay_buffer import Batch
from morphkit_rl.kernels import adam, categorical
from morphkit_rl.kernels.adam import AdamStep
from morphkit_rl.kernels.gradient_rows import GradientRows
from morphkit_rl.models import limb_former_pass
from morphkit_rl.models.layout import Layout
from morphkit_rl.models.limb_former_pass import ActorPass
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


class CompiledUpdate:
    """Updates of a learner from batches of one size of the robots of a layout.

    Args:
        learner: What learns; `suits` says whether it can be so.
        layout: The robots.
        size: Samples in a batch.
    """

    def __init__(self, learner: Learner, layout: Layout, size: int):
        config, critic, target = learner.config, learner.critic, learner.critic_target
        assert isinstance(learner.critic_loss, CrossEntropy)
        self._config, self._margin, self._layout = config, learner.options.saturation_margin, layout
        self._support, self._size, self._threads = learner.critic_loss.support, size, torch.get_num_threads()
        stored, robots = layout.stored, layout.num_robots
        self._obs, self._next_obs = (torch.empty(size, stored.num_tokens) for _ in range(2))
        self._action, self._next_action = (torch.empty(size, layout.num_actions) for _ in range(2))
        self._reward, self._discount = (torch.empty(size, robots) for _ in range(2))
        self._weight = torch.full((robots,), 1 / (robots * size))
        self._own_obs, self._own_next_obs = map(self._room, (self._obs, self._next_obs))

        self._target_actor = ActorPass(learner.actor_target, self._own_next_obs, layout, learns=False)
        self._actor = ActorPass(learner.actor, self._own_obs, layout, learns=True)
        parameters = critic.parameters_in_order
        gradients = GradientRows(parameters)
        self._critic = critic.bound(self._obs, self._action, stored, into=gradients)
        self._critic_target = target.bound(self._next_obs, self._next_action, stored)
        members = 1 if learner.options.actor_objective == "first" else 2
        self._action_gradients = torch.empty(members, size, layout.num_actions)
        self._judge = critic.bound(self._obs, self._actor.action, stored, members, into=self._action_gradients)

        optimizer, clip = learner.critic_optimizer, config.gradient_clip
        follow = [(target.parameters_in_order, config.tau)]
        self._critic_steps = [AdamStep(optimizer, parameters, gradients, clip, moved) for moved in ([], follow)]
        ordered = limb_former_pass.parameters_in_order
        moved = [(ordered(learner.actor_target), config.tau)]
        if learner.actor_average is not None:
            moved.append((ordered(learner.actor_average), 1 - learner.options.actor_average))
        own = ordered(learner.actor)
        self._actor_step = AdamStep(learner.actor_optimizer, own, self._actor.gradients, clip, moved)
        bound = (parameters, own, *(tensors for tensors, _ in (*follow, *moved)))
        self._fixed = [tensor for tensors in bound for tensor in tensors]
        self._places = [tensor.data_ptr() for tensor in self._fixed]

    def fits(self, size: int) -> bool:
        """Whether it can take batches of so many samples, and all that it knows the place of is still there."""
        return (
            (size, torch.get_num_threads()) == (self._size, self._threads)
            and [tensor.data_ptr() for tensor in self._fixed] == self._places
            and self._critic_steps[0].is_current
            and self._actor_step.is_current
        )

    @torch.no_grad()
    def update_critics(
        self,
        batch: Batch,
        noise: np.ndarray,
        scale: Tensor | None,
        shift: Tensor | None,
        factor: Tensor,
        *,
        follow: bool,
    ) -> dict[str, Tensor]:
        """As `autograd_update.update_critics`, from a batch that is not normalized.

        Args:
            batch: Transitions.
            noise: (batch, actions) noise on the target actor's actions.
            scale: As in `TD3.update`.
            shift: As in `TD3.update`.
            factor: (robots,) factors on rewards.
            follow: Whether the target critics move toward the critics afterwards.
        """
        for rows, room in ((batch.obs, self._obs), (batch.next_obs, self._next_obs)):
            normalize(torch.from_numpy(rows), scale, shift, out=room)
        for array, room in (
            (batch.action, self._action), (batch.reward, self._reward), (batch.discount, self._discount),
        ):  # fmt: skip
            room.copy_(torch.from_numpy(array))
        self._part(self._next_obs, self._own_next_obs)
        self._target_actor.forward()
        torch.add(self._target_actor.action, torch.from_numpy(noise), out=self._next_action).clamp_(-1, 1)
        self._critic_target.forward()
        self._critic.forward()
        error, value = categorical.categorical_error(
            self._critic.output,
            self._critic_target.output,
            self._reward,
            self._discount,
            self._support,
            reward_scale=factor,
            weight=self._weight,
            value_weight=self._weight / factor,
            gradient=self._critic.gradient,
        )
        self._critic.backward()
        self._critic_steps[follow]()
        return {"critic_loss": error, "q_mean": value}

    @torch.no_grad()
    def update_actor(self) -> Tensor:
        """As `autograd_update.update_actor`, of the robots as they are, at the observations of the latest batch."""
        self._part(self._obs, self._own_obs)
        self._actor.forward()
        self._judge.forward()
        judge, actor, penalty = self._judge, self._actor, self._config.saturation_penalty
        loss = categorical.categorical_value(judge.output, self._support, -self._weight, judge.gradient)
        judge.backward()
        torch.sum(self._action_gradients, 0, out=actor.action_gradient)
        if penalty > 0:
            saturated, slope = saturation_and_gradient(actor.action, self._margin)
            loss = loss + penalty * saturated
            actor.action_gradient.add_(slope, alpha=penalty)
        actor.backward()
        self._actor_step()
        return loss

    def _room(self, rows: Tensor) -> Tensor:
        """Where the actor's part of such rows has room: in the rows themselves where that is all of them."""
        return rows if self._layout.columns is None else torch.empty(len(rows), self._layout.num_tokens)

    def _part(self, rows: Tensor, room: Tensor) -> None:
        """Put the actor's part of rows where it has room."""
        if self._layout.columns is not None:
            torch.index_select(rows, -1, self._layout.columns, out=room)
