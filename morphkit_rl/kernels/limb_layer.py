"""A transformer layer over related limbs as one compiled operation; `limb_layer.cpp` shows its equations."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from morphkit_rl.kernels.gradient_rows import GradientRows
from morphkit_rl.kernels.library import (
    STEP,
    ThreadGradients,
    bound,
    integers,
    pointer,
    pointers,
    sequence_starts,
    takes,
)


@dataclass(frozen=True, eq=False)
class Kinship:
    """How the limbs of each robot are related.

    Attributes:
        edges: Where each robot's limbs begin in the sequence of all limbs, and their number.
        firsts: (robots,) int64 place of a robot's relations in `kinds`.
        kinds: int32 relation of limb j to limb i, (limbs, limbs) a robot, one robot after the other.
    """

    edges: tuple[int, ...]
    firsts: Tensor
    kinds: Tensor

    @classmethod
    def of(cls, relation: Tensor, limbs: Sequence[slice]) -> Kinship:
        """Those of robots whose limbs are slices of a sequence with (limbs, limbs) relations."""
        own = [relation[span, span].reshape(-1).to(torch.int32) for span in limbs]
        firsts = torch.tensor([0, *(len(kinds) for kinds in own)]).cumsum(0)[:-1]
        return cls((0, *(span.stop for span in limbs)), firsts, torch.cat(own).cpu().contiguous())


def available(x: Tensor, heads: int, hidden: int) -> bool:
    """Whether the kernel can do what `limb_layer` is asked for."""
    return x.shape[-1] % (heads * STEP) == 0 and hidden % STEP == 0 and takes(x, "limb_layer_forward")


def limb_layer(x: Tensor, kinship: Kinship, heads: int, parameters: Sequence[Tensor]) -> Tensor:
    """Apply the layer to limb tokens.

    Args:
        x: (members, batch, limbs, d_model), float32 or bfloat16, which is how precise factors are.
        kinship: How the limbs are related; limbs of different robots do not see each other.
        heads: Number of attention heads.
        parameters: Weights (members, inputs, outputs) and biases of what makes queries, keys and values, of what
            leaves the attention, and of both feed-forward maps; bias of attention (members, heads, kinds). All are
            float32.
    """
    if torch.is_grad_enabled() and any(tensor.requires_grad for tensor in (x, *parameters)):
        result: Tensor = LimbLayer.apply(x.contiguous(), kinship, heads, *parameters)
        return result
    return _forward(x.contiguous(), kinship, heads, parameters, ())


class LimbLayerPass:
    """`limb_layer` at tokens that lie in fixed memory, and back, without autograd.

    Args:
        x: As in `limb_layer`, read anew by each `forward`.
        kinship: As in `limb_layer`.
        heads: As in `limb_layer`.
        parameters: As in `limb_layer`; contiguous.
        into: Where `backward` adds gradients of the parameters; None where there is no way back.
        x_gradient: Like `x`: where `backward` writes that of `x`; None where there is no way back.

    Attributes:
        output: Like `x`, of `forward`.
        gradient: That of `output`, which `backward` starts from.
    """

    def __init__(
        self, x: Tensor, kinship: Kinship, heads: int, parameters: Sequence[Tensor],
        into: GradientRows | None = None, x_gradient: Tensor | None = None,
    ):  # fmt: skip
        self.output, self.gradient = torch.empty_like(x), torch.empty_like(x)
        saved = pointers(_saved(x, parameters)) if into is not None else (ctypes.c_void_p * 4)()
        common = (x, kinship, heads, parameters, saved)
        self.forward = _bound("limb_layer_forward", *common, pointer(self.output))
        if into is not None and x_gradient is not None:
            gradients = pointer(self.gradient), pointer(x_gradient), into.pointers(parameters)
            self.backward = _bound("limb_layer_backward", *common, *gradients)


class LimbLayer(torch.autograd.Function):
    """`limb_layer` for autograd."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, kinship: Kinship, heads: int, *parameters: Tensor) -> Tensor:
        """The output; keeps what the way back needs."""
        saved = _saved(x, parameters)
        ctx.save_for_backward(x, *saved, *parameters)
        ctx.kinship, ctx.heads = kinship, heads
        return _forward(x, kinship, heads, parameters, saved)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        """Gradients of all arguments; None of those that have none or need none."""
        x, *rest = ctx.saved_tensors
        saved, parameters = rest[:4], rest[4:]
        x_gradient = torch.empty_like(x)
        gradients = ThreadGradients(parameters, any(ctx.needs_input_grad[3:]))
        _bound(
            "limb_layer_backward", x, ctx.kinship, ctx.heads, parameters,
            pointers(saved), pointer(gradient.contiguous()), pointer(x_gradient), gradients.pointers,
        )()  # fmt: skip
        return x_gradient, None, None, *gradients.add_up()


def _forward(x: Tensor, kinship: Kinship, heads: int, parameters: Sequence[Tensor], saved: Sequence[Tensor]) -> Tensor:
    result = torch.empty_like(x)
    kept = pointers(saved) if saved else (ctypes.c_void_p * 4)()
    _bound("limb_layer_forward", x, kinship, heads, parameters, kept, pointer(result))()
    return result


def _saved(x: Tensor, parameters: Sequence[Tensor]) -> list[Tensor]:
    """Memory for what the way back needs."""
    width, hidden = x.shape[-1], parameters[4].shape[-1]
    return [x.new_empty(*x.shape[:3], columns) for columns in (3 * width, width, width, hidden)]


def _bound(
    name: str, x: Tensor, kinship: Kinship, heads: int, parameters: Sequence[Tensor], *arguments: object
) -> Callable[[], None]:
    parameters = [parameter.contiguous() for parameter in parameters]
    members, batch, _, width = x.shape
    robots, kinds = kinship.firsts.shape[0], parameters[8].shape[-1]
    sizes = integers(members, batch * robots, width, heads, parameters[4].shape[-1], kinds, robots)
    starts = sequence_starts(kinship.edges, batch)
    tables = pointer(starts), pointer(kinship.firsts), pointer(kinship.kinds)
    return bound(name, x.dtype, sizes, *tables, torch.get_num_threads(), pointers(parameters), pointer(x), *arguments)
