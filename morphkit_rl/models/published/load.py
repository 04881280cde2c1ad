"""Networks of the published programs, from the weights under their own names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from morphkit.errors import CheckpointError, ConfigError
from morphkit.tokens.spec import ActuatorToken, SensorToken, TokenLimb, TokenSpec
from morphkit_rl.models import amorpheus, anymorph, ma_bert, smp
from morphkit_rl.models.amorpheus import AmorpheusSettings
from morphkit_rl.models.anymorph import AnyMorphSettings
from morphkit_rl.models.layout import Layout, build_layout
from morphkit_rl.models.ma_bert import MaBertSettings
from morphkit_rl.models.published.parameter_names import (
    Weights,
    count,
    decoder,
    encoder,
    fill,
    limb_transformer,
    norm,
    part,
    smp_names,
    smp_sizes,
)
from morphkit_rl.models.vocabulary import Vocabulary


class Actor(nn.Module):
    """One robot's policy: (batch, limbs * scalars) -> (batch, limbs) in [-1, 1]."""

    def __init__(self, network: nn.Module, layout: Layout):
        super().__init__()
        self.network, self.layout = network, layout

    def forward(self, obs: Tensor) -> Tensor:
        """Act, the root included."""
        action: Tensor = self.network(obs, self.layout)
        return action


class TwinCritic(nn.Module):
    """One robot's values: a pair of (batch, limbs), SMP (batch, 1)."""

    def __init__(self, network: nn.Module, layout: Layout):
        super().__init__()
        self.network, self.layout = network, layout

    def forward(self, obs: Tensor, action: Tensor) -> tuple[Tensor, Tensor]:
        """Value actions (batch, limbs) at observations (batch, limbs * scalars)."""
        q1, q2 = self.network(obs, action, self.layout)
        return q1, q2


def load_published(
    method: str,
    tensors: Mapping[str, Tensor | np.ndarray],
    limbs: Sequence[str],
    parents: Sequence[int],
    num_heads: int = 2,
) -> tuple[Actor, TwinCritic]:
    """Build the networks that published weights belong to; all sizes follow from the weights' shapes.

    Weights of SMP whose messages only come down do not tell by their shapes for how many children they were made:
    for the most that a limb has here.

    Args:
        method: `anymorph`, `amorpheus` or `smp`; or `ma-bert`, which takes AnyMorph's weights with the two tables as
            its frozen embeddings.
        tensors: `weights/actor/...` and `weights/critic/...` under PyTorch's names; other keys are ignored.
        limbs: Names of the limbs, in the order of AnyMorph's tables.
        parents: Index of each limb's parent, -1 for the root.
        num_heads: Attention heads, which shapes do not tell.

    Raises:
        ConfigError: The method is none of these, limbs and parents make no tree, or heads do not divide a width.
        CheckpointError: Weights are missing or of unexpected shape, or were made for other limbs.
    """
    limbs, parents = [str(limb) for limb in limbs], [int(parent) for parent in parents]
    weights = {
        key: torch.as_tensor(value).detach().float() for key, value in tensors.items() if key.startswith("weights/")
    }
    loaders = {"anymorph": _anymorph, "ma-bert": _anymorph, "amorpheus": _amorpheus, "smp": _smp}
    if method not in loaders:
        raise ConfigError(f"no published weights of method {method!r} are known; there is {', '.join(loaders)}")
    _check_tree(limbs, parents)
    try:
        actor, critic, layout = loaders[method](method, weights, limbs, parents, num_heads)
    except ConfigError:
        raise
    except KeyError as error:
        raise CheckpointError(f"published weights of {method!r}: lack {error}") from None
    except (RuntimeError, ValueError) as error:
        raise CheckpointError(f"published weights of {method!r}: {error}") from None
    return Actor(actor, layout), TwinCritic(critic, layout)


Loaded = tuple[nn.Module, nn.Module, Layout]
_TWINS = ("weights/critic/critic1.", "weights/critic/critic2.")


def _anymorph(method: str, weights: Weights, limbs: Sequence[str], parents: Sequence[int], heads: int) -> Loaded:
    own = part(weights, "weights/actor/")
    sensors, actions = own["obs_embeddings.weight"], own["act_embeddings.weight"]
    read, size = own["actor.obs_z_input_layer.weight"], sensors.shape[1]
    sizes: dict[str, Any] = {
        "d_model": len(read),
        "layers": count(own, "actor.transformer.encoder.layers."),
        "heads": heads,
        "feedforward": len(own["actor.transformer.encoder.layers.0.linear1.weight"]),
        "code_size": read.shape[1] - size,
    }
    if len(actions) != len(limbs) or len(sensors) % len(limbs):
        raise ValueError(f"tables of {len(sensors)} sensors and {len(actions)} actions do not fit {len(limbs)} limbs")
    spec = _spec(limbs, parents, len(sensors) // len(actions))
    vocabulary = Vocabulary(
        tuple(sensor.name for sensor in spec.sensors),
        tuple(actuator.name for actuator in spec.actuators),
        scalars=len(sensors) // len(actions),
    )
    table = dict(zip((*vocabulary.sensors, *vocabulary.actions), torch.cat([sensors, actions]).numpy(), strict=True))
    layout = build_layout([spec], lambda texts: np.stack([table[text] for text in texts]), actions="limbs")
    settings: AnyMorphSettings | MaBertSettings
    if method == "anymorph":
        settings = AnyMorphSettings(**sizes, token_size=size)
        actor, _ = anymorph.build(settings, size, vocabulary)
    else:
        settings = MaBertSettings(**sizes)
        actor, _ = ma_bert.build(settings, size, vocabulary)
    head = own["actor.act_output_layer.weight"]
    names = {
        "read_name.weight": read[:, :size].T,
        "read_name.bias": own["actor.obs_z_input_layer.bias"],
        "read_code.weight": read[:, size:].T,
        "read_query.weight": own["actor.act_z_input_layer.weight"].T,
        "read_query.bias": own["actor.act_z_input_layer.bias"],
        "head_name.weight": head[:, :size].T,
        "head_name.bias": own["actor.act_output_layer.bias"],
        "head.weight": head[:, size:].T,
        **norm(own, "actor.obs_norm", "obs_norm"),
        **norm(own, "actor.act_norm", "query_norm"),
        **encoder(own, "actor.transformer.encoder", "encoder"),
        **decoder(own, "actor.transformer.decoder", "decoder"),
    }
    if method == "anymorph":
        names |= {"tokens.sensors": sensors, "tokens.actions": actions}
    fill(actor, [names])
    return actor, _limb_critic(weights, settings, vocabulary.scalars), layout


def _amorpheus(method: str, weights: Weights, limbs: Sequence[str], parents: Sequence[int], heads: int) -> Loaded:
    own = part(weights, "weights/actor/actor.")
    d_model, scalars = own["encoder.weight"].shape
    settings = AmorpheusSettings(
        d_model=d_model,
        layers=count(own, "transformer_encoder.layers."),
        heads=heads,
        feedforward=len(own["transformer_encoder.layers.0.linear1.weight"]),
        conditioned=own["decoder.weight"].shape[1] > d_model,
    )
    actor = amorpheus.Actor(scalars, settings)
    fill(actor, [limb_transformer(own)])
    return actor, _limb_critic(weights, settings, scalars), _layout(limbs, parents, scalars)


def _limb_critic(weights: Weights, actor: AmorpheusSettings, scalars: int) -> nn.Module:
    """Twin critics of their own sizes."""
    twins = [part(weights, prefix) for prefix in _TWINS]
    d_model = len(twins[0]["encoder.weight"])
    settings = replace(
        actor,
        d_model=d_model,
        layers=count(twins[0], "transformer_encoder.layers."),
        feedforward=len(twins[0]["transformer_encoder.layers.0.linear1.weight"]),
        conditioned=twins[0]["decoder.weight"].shape[1] > d_model,
    )
    critic = amorpheus.TwinCritic(scalars, settings)
    fill(critic, [limb_transformer(twin) for twin in twins])
    return critic


def _smp(method: str, weights: Weights, limbs: Sequence[str], parents: Sequence[int], heads: int) -> Loaded:
    children = max(1, *map(parents.count, range(len(limbs))))
    own, twins = part(weights, "weights/actor/"), part(weights, "weights/critic/")
    sizes = smp_sizes(own, "actor.0.", ("action_base", "base"), 0, children)
    critic_sizes = smp_sizes(twins, "critic.0.", ("baseQ1",), 1, children)
    for _, _, most, direction, _ in (sizes, critic_sizes):
        if direction != "none" and children > most:
            raise ValueError(f"were made for at most {most} children a limb, here a limb has {children}")
    actor = smp.Actor(*sizes)
    fill(actor, [smp_names(own, "actor.0.", "action", ("action_base", "base"))])
    critic = smp.TwinCritic(*critic_sizes)
    fill(critic, [smp_names(twins, "critic.0.", "value", (head,)) for head in ("baseQ1", "baseQ2")])
    return actor, critic, _layout(limbs, parents, sizes[0])


def _layout(limbs: Sequence[str], parents: Sequence[int], scalars: int) -> Layout:
    return build_layout([_spec(limbs, parents, scalars)], lambda t: np.zeros((len(t), 1), np.float32), actions="limbs")


def _check_tree(limbs: Sequence[str], parents: Sequence[int]) -> None:
    """Raise ConfigError unless there is one parent a limb, and every limb hangs on a root."""
    rooted = set[int]()
    while grown := {i for i, p in enumerate(parents) if i not in rooted and (p < 0 or p in rooted)}:
        rooted |= grown
    if not limbs or len(limbs) != len(parents) or len(set(limbs)) != len(limbs) or len(rooted) != len(limbs):
        raise ConfigError(
            f"limbs {list(limbs)} and parents {list(parents)} make no tree: expected one parent a limb, -1 for the root"
        )


def _spec(limbs: Sequence[str], parents: Sequence[int], scalars: int) -> TokenSpec:
    """A robot with an actuator in each limb and scalars whose quantities are only numbered."""
    sensors = [(limb, number) for limb in limbs for number in range(scalars)]
    names = [f"{limb}_{number}" for limb, number in sensors]
    return TokenSpec(
        morphology="published", file="", format="mjcf", sha256="", naming="raw", family=None, task=None, base="planar",
        limbs=tuple(
            TokenLimb(limb, limbs[parent] if parent >= 0 else None, None, ())
            for limb, parent in zip(limbs, parents, strict=True)
        ),
        sensors=tuple(
            SensorToken(index, name, name, limb, str(number), None, "1", None, None, None)
            for index, (name, (limb, number)) in enumerate(zip(names, sensors, strict=True))
        ),
        actuators=tuple(
            ActuatorToken(index, f"{limb}_ctrl", f"{limb}_ctrl", limb, None, "1", -1.0, 1.0)
            for index, limb in enumerate(limbs)
        ),
    )  # fmt: skip
