"""Limb-Former's actor and back by compiled kernels in fixed memory, without autograd."""

from __future__ import annotations

import torch
from torch import Tensor

from morphkit_rl.kernels import actuator_heads, limb_tokens
from morphkit_rl.kernels.actuator_heads import ActuatorHeadsPass
from morphkit_rl.kernels.gradient_rows import GradientRows
from morphkit_rl.kernels.limb_layer import LimbLayerPass
from morphkit_rl.kernels.limb_tokens import LimbTokensPass
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
    """All parameters of the actor, in the order of their gradients in `ActorPass.gradients`."""
    encoder, found = actor.encoder, []
    for layer in encoder.layers:
        assert isinstance(layer, TransformerLayer)
        found += layer.map_parameters
    found += [encoder.relation_bias, *actor.read.parameters(), *actor.head.parameters(), actor.name.weight]
    return [*found, encoder.value.weight, *encoder.name.parameters()]


class ActorPass:
    """Actions of an actor at observations that lie in fixed memory, and the gradient of its parameters from theirs.

    Args:
        actor: The actor, whose parameters must stay where they are.
        obs: (batch, tokens) normalized observations, read anew by each `forward`.
        layout: The robots.
        learns: Whether there is a way back.

    Attributes:
        action: (batch, actuators) in [-1, 1], of `forward`.
        action_gradient: That of `action`, which `backward` starts from.
        gradients: Where `backward` adds those of the `parameters_in_order`, and needs some more.
    """

    def __init__(self, actor: Actor, obs: Tensor, layout: Layout, *, learns: bool):
        encoder, read, head = actor.encoder, actor.read, actor.head
        assert read.bias is not None
        assert head.bias is not None
        maps = encoder.value, encoder.name, actor.name
        self._maps = [each.weight for each in maps], [each.bias for each in maps]
        self._embeddings = layout.embeddings, layout.limb_embeddings, layout.embeddings[layout.action_text]
        width = read.weight.shape[-1]
        self._names = [obs.new_empty(1, len(embeddings), width) for embeddings in self._embeddings]
        vectors, limb_names, action_names = self._names
        into = GradientRows([*parameters_in_order(actor), *self._names]) if learns else None

        scalars = layout.observation.scalars
        last: LimbTokensPass | LimbLayerPass
        last = tokens = LimbTokensPass(obs, scalars, vectors, limb_names, encoder.precision, into)
        layers: list[LimbLayerPass] = []
        for layer in encoder.layers:
            assert isinstance(layer, TransformerLayer)
            own = [*layer.map_parameters, encoder.relation_bias]
            last = LimbLayerPass(last.output, layout.kinship, layer.heads, own, into, last.gradient)
            layers.append(last)
        own = [read.weight, read.bias, action_names, head.weight, head.bias]
        heads = ActuatorHeadsPass(last.output[0], layout.action_limb, own, into, last.gradient[0])
        self._parts: tuple[LimbTokensPass | LimbLayerPass | ActuatorHeadsPass, ...] = (tokens, *layers, heads)
        self.action, self.action_gradient = heads.output, heads.gradient
        if into is not None:
            self.gradients = into

    def forward(self) -> None:
        """Act."""
        for weight, bias, embeddings, names in zip(*self._maps, self._embeddings, self._names, strict=True):
            if bias is None:
                torch.mm(embeddings, weight[0], out=names[0])
            else:
                torch.addmm(bias[0], embeddings, weight[0], out=names[0])
        for part in self._parts:
            part.forward()

    def backward(self) -> None:
        """From `action_gradient` to `gradients`."""
        for part in reversed(self._parts):
            part.backward()
        for weight, bias, embeddings, names in zip(*self._maps, self._embeddings, self._names, strict=True):
            gradient = self.gradients.take(names)[0]
            torch.mm(embeddings.T, gradient, out=self.gradients.part(weight)[0])
            if bias is not None:
                torch.sum(gradient, 0, keepdim=True, out=self.gradients.part(bias)[0])
