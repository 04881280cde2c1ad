"""Limb-Former's actor and back by compiled kernels, without autograd."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain

import torch
from torch import Tensor

from morphkit_rl.kernels import actuator_heads, limb_tokens
from morphkit_rl.kernels.actuator_heads import ActuatorHeads
from morphkit_rl.kernels.call import Call
from morphkit_rl.kernels.limb_layer import LimbLayer
from morphkit_rl.kernels.limb_tokens import LimbTokens
from morphkit_rl.models.blocks import TransformerLayer
from morphkit_rl.models.layout import Layout
from morphkit_rl.models.limb_former import Actor


def suits(actor: object, obs: Tensor, layout: Layout) -> bool:
    """Whether `ActorPass` can act for these robots at such observations."""
    plain = layout.each_action_has_a_limb and layout.num_actions > 0 and not layout.hides_limbs
    if not isinstance(actor, Actor) or not plain:
        return False
    width = actor.read.weight.shape[-1]
    limbs = torch.empty(1, 1, 1, width, dtype=actor.encoder.precision)
    return (
        limb_tokens.available(obs, width, actor.encoder.precision)
        and all(isinstance(layer, TransformerLayer) and layer.suits_kernel(limbs) for layer in actor.encoder.layers)
        and actuator_heads.available(limbs[0])
    )


def parameters_in_order(actor: Actor) -> list[Tensor]:
    """All parameters of the actor, as `ActorPass.gradients` takes them."""
    encoder, found = actor.encoder, []
    for layer in encoder.layers:
        assert isinstance(layer, TransformerLayer)
        found += layer.map_parameters
    found += [encoder.relation_bias, *actor.read.parameters(), *actor.head.parameters(), actor.name.weight]
    return [*found, encoder.value.weight, *encoder.name.parameters()]


class ActorPass:
    """Actions of an actor at observation rows, and the gradient of its parameters from theirs.

    Args:
        actor: The actor.
        obs: (batch, tokens) normalized observations.
        layout: The robots.

    Attributes:
        action: (batch, actuators) in [-1, 1].
    """

    def __init__(self, actor: Actor, obs: Tensor, layout: Layout):
        encoder, self._layout = actor.encoder, layout
        names, actuators = actor.read_names(layout)
        precision = encoder.precision
        self._tokens = _call(LimbTokens, 3, obs, layout.observation.scalars, precision, names.vectors, names.tokens)
        x, self._layers = self._tokens.output, []
        for layer in encoder.layers:
            assert isinstance(layer, TransformerLayer)
            parameters = *layer.map_parameters, encoder.relation_bias
            self._layers.append(_call(LimbLayer, 3, x, layout.kinship, layer.heads, *parameters))
            x = self._layers[-1].output
        self._heads = _call(ActuatorHeads, 2, x[0], layout.action_limb, *actor.head_parameters(actuators))
        self.action = self._heads.output

    def gradients(self, action_gradient: Tensor) -> list[Tensor]:
        """Gradient of each of the `parameters_in_order`, with as many numbers."""
        x, _, *heads = self._heads.backward(action_gradient)
        x = x.unsqueeze(0)
        layers: list[Sequence[Tensor]] = []
        relations: list[Tensor] = []
        for call in reversed(self._layers):
            x, _, _, *maps, relation = call.backward(x)
            layers.insert(0, maps)
            relations.append(relation)
        *_, vectors, tokens = self._tokens.backward(x)
        layout = self._layout
        own = [*heads[:2], *heads[3:], layout.embeddings[layout.action_text].T @ heads[2]]
        own += [layout.embeddings.T @ vectors[0], layout.limb_embeddings.T @ tokens[0], tokens[0].sum(0)]
        return [*chain.from_iterable(layers), torch.stack(relations).sum(0), *own]


def _call(function: type[torch.autograd.Function], others: int, *arguments: object) -> Call:
    """A call of which the first `others` arguments are no parameters; only the very first of these has a gradient."""
    return Call(function, *arguments, wanted=(True, *[False] * (others - 1), *[True] * (len(arguments) - others)))
