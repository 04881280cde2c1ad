"""What the published programs call the parameters of our networks; transposed, without the leading member axis."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from morphkit_rl.models.smp import Direction, Widths

Weights = dict[str, Tensor]


def fill(network: nn.Module, members: Sequence[Weights]) -> None:
    """Set all parameters of `network`, from one set of tensors a member.

    Where a parameter has fewer members than there are sets, the first set counts.

    Raises:
        ValueError: A tensor is missing, left over, or of another shape.
    """
    parameters = dict(network.named_parameters())
    if parameters.keys() != members[0].keys():
        raise ValueError(f"expected other parameters: {', '.join(sorted(parameters.keys() ^ members[0].keys()))}")
    with torch.no_grad():
        for name, parameter in parameters.items():
            own = parameter.view(1, *parameter.shape) if name.startswith("tokens.") else parameter
            for place, member in zip(own, members, strict=False):
                if place.numel() != member[name].numel():
                    raise ValueError(f"{name} has shape {tuple(member[name].shape)}, expected {tuple(place.shape)}")
                place.copy_(member[name].reshape(place.shape))


def part(weights: Weights, prefix: str) -> Weights:
    """Tensors whose names start with `prefix`, under the rest of their names."""
    return {key[len(prefix) :]: value for key, value in weights.items() if key.startswith(prefix)}


def count(own: Weights, prefix: str) -> int:
    """Number of layers whose names start with `prefix`."""
    return 1 + max((int(key[len(prefix) :].partition(".")[0]) for key in own if key.startswith(prefix)), default=-1)


def affine(own: Weights, theirs: str, ours: str) -> Weights:
    """An affine map."""
    return {f"{ours}.weight": own[f"{theirs}.weight"].T, f"{ours}.bias": own[f"{theirs}.bias"]}


def norm(own: Weights, theirs: str, ours: str) -> Weights:
    """A layer norm."""
    return {f"{ours}.{name}": own[f"{theirs}.{name}"] for name in ("weight", "bias")}


def encoder(own: Weights, theirs: str, ours: str) -> Weights:
    """An encoder with a final norm."""
    names = norm(own, f"{theirs}.norm", f"{ours}.norm")
    for number in range(count(own, f"{theirs}.layers.")):
        their, our = f"{theirs}.layers.{number}", f"{ours}.layers.{number}"
        names |= _layer(own, their, our, norms=2)
    return names


def decoder(own: Weights, theirs: str, ours: str) -> Weights:
    """A decoder with a final norm; the bias of the keys from the memory has no effect and goes."""
    names = norm(own, f"{theirs}.norm", f"{ours}.norm")
    for number in range(count(own, f"{theirs}.layers.")):
        their, our = f"{theirs}.layers.{number}", f"{ours}.layers.{number}"
        weights = own[f"{their}.multihead_attn.in_proj_weight"].chunk(3)
        biases = own[f"{their}.multihead_attn.in_proj_bias"].chunk(3)
        for name, weight, bias in zip(("query", "key", "value"), weights, biases, strict=True):
            names[f"{our}.cross.{name}.weight"] = weight.T
            if name != "key":
                names[f"{our}.cross.{name}.bias"] = bias
        names |= affine(own, f"{their}.multihead_attn.out_proj", f"{our}.cross.out")
        names |= _layer(own, their, our, norms=3)
    return names


def _layer(own: Weights, theirs: str, ours: str, norms: int) -> Weights:
    names = {
        f"{ours}.attention.qkv.weight": own[f"{theirs}.self_attn.in_proj_weight"].T,
        f"{ours}.attention.qkv.bias": own[f"{theirs}.self_attn.in_proj_bias"],
        **affine(own, f"{theirs}.self_attn.out_proj", f"{ours}.attention.out"),
        **affine(own, f"{theirs}.linear1", f"{ours}.feedforward.expand"),
        **affine(own, f"{theirs}.linear2", f"{ours}.feedforward.contract"),
    }
    for number in range(1, norms + 1):
        names |= norm(own, f"{theirs}.norm{number}", f"{ours}.norm{number}")
    return names


def limb_transformer(own: Weights) -> Weights:
    """Amorpheus's actor or one of its critics."""
    return {
        **affine(own, "encoder", "network.read"),
        **affine(own, "decoder", "network.head"),
        **encoder(own, "transformer_encoder", "network.encoder"),
    }


def smp_sizes(
    own: Weights, head: str, tops: Sequence[str], actions: int, children: int
) -> tuple[int, int, int, Direction, Widths]:
    """Scalars, message size, children, direction and widths of SMP's actor or critic.

    Args:
        own: Its tensors.
        head: Prefix of what acts or values where messages come down or none go.
        tops: Names that the MLP which acts or values can have.
        actions: 1 in the critics, which read a limb's action too, else 0.
        children: Most children of a limb, for messages that only come down: shapes do not tell.

    Raises:
        KeyError: The MLP which acts or values is missing.
        ValueError: Messages that come down do not divide among the children.
    """
    up, down, top = _smp_parts(own, head, tops)
    first, inputs = own[f"{top}.l1.weight"].shape
    second = len(own[f"{top}.l2.weight"])
    scalars, message, width = inputs - actions, 0, Widths().up
    if up:
        width, scalars = own["sNet.0.fc1.weight"].shape
        scalars -= actions
        message = len(own["sNet.0.fc3.weight"])
        children = (own["sNet.0.fc2.weight"].shape[1] - width) // message
    elif down:
        message, rest = divmod(len(own[f"{head}msg_base.l3.weight"]), children)
        if rest:
            raise ValueError(f"messages do not divide into pieces for the {children} children of a limb")
        scalars -= message
    direction: Direction = "both" if up and down else "up" if up else "down" if down else "none"
    return scalars, message, children, direction, Widths(width, first, second)


def smp_names(own: Weights, head: str, ours: str, tops: Sequence[str]) -> Weights:
    """SMP's actor, or its critic with one of its twin values."""
    up, down, top = _smp_parts(own, head, tops)
    names = _mlp(own, top, ours)
    if up:
        for name in ("fc1", "fc2", "fc3"):
            names |= affine(own, f"sNet.0.{name}", f"messages.up.{name}")
    if down:
        names |= _mlp(own, f"{head}msg_base", "messages.down.base")
    return names


def _smp_parts(own: Weights, head: str, tops: Sequence[str]) -> tuple[bool, bool, str]:
    """Whether messages go up, whether they come down, and the name of the MLP which acts or values."""
    up, down = "sNet.0.fc1.weight" in own, f"{head}msg_base.l1.weight" in own
    prefix = head if down or not up else "sNet.0."
    found = [f"{prefix}{name}" for name in tops if f"{prefix}{name}.l1.weight" in own]
    if not found:
        raise KeyError(f"{prefix}{tops[0]}.l1.weight")
    return up, down, found[0]


def _mlp(own: Weights, theirs: str, ours: str) -> Weights:
    return {
        k: v for layer in ("l1", "l2", "l3") for k, v in affine(own, f"{theirs}.{layer}", f"{ours}.{layer}").items()
    }
