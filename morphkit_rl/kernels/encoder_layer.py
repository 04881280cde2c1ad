"""A transformer encoder layer as one compiled operation; `encoder_layer.cpp` shows its equations."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from morphkit_rl.kernels.library import (
    STEP,
    ThreadGradients,
    edges,
    function,
    integers,
    pointer,
    pointers,
    sequence_starts,
    takes,
)


def available(x: Tensor, spans: Sequence[slice], heads: int, hidden: int) -> bool:
    """Whether the kernel can do what `encoder_layer` is asked for."""
    return (
        x.shape[-1] % (heads * STEP) == 0
        and hidden % STEP == 0
        and edges(spans, x.shape[2]) is not None
        and takes(x, "layer_forward")
    )


def encoder_layer(x: Tensor, spans: Sequence[slice], heads: int, parameters: Sequence[Tensor]) -> Tensor:
    """Apply the layer to tokens.

    Args:
        x: (members, batch, tokens, d_model), float32 or bfloat16, which is how precise factors are.
        spans: Each robot's tokens, which attend among themselves.
        heads: Number of attention heads.
        parameters: Weights (members, inputs, outputs) and biases of what makes queries, keys and values, of what
            leaves the attention, and of both feed-forward maps; scales and shifts of both norms. All are float32. The
            first `len(x)` members are used.
    """
    tokens = edges(spans, x.shape[2])
    assert tokens is not None
    starts = sequence_starts(tokens, x.shape[1])
    if torch.is_grad_enabled() and any(tensor.requires_grad for tensor in (x, *parameters)):
        result: Tensor = _EncoderLayer.apply(x.contiguous(), starts, heads, *parameters)
        return result
    return _forward(x.contiguous(), starts, heads, parameters, ())


class _EncoderLayer(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor, starts: Tensor, heads: int, *parameters: Tensor) -> Tensor:
        width, hidden = x.shape[-1], parameters[4].shape[-1]
        saved = [x.new_empty(*x.shape[:3], columns) for columns in (3 * width, width, width, hidden, width)]
        ctx.save_for_backward(x, *saved, *parameters)
        ctx.starts, ctx.heads = starts, heads
        return _forward(x, starts, heads, parameters, saved)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        x, *rest = ctx.saved_tensors
        saved, parameters = rest[:5], rest[5:]
        x_gradient = torch.empty_like(x)
        gradients = ThreadGradients(parameters, any(ctx.needs_input_grad[3:]))
        _call(
            "layer_backward", x, ctx.starts, ctx.heads, parameters,
            pointers(saved), pointer(gradient.contiguous()), pointer(x_gradient), gradients.pointers,
        )  # fmt: skip
        return x_gradient, None, None, *gradients.add_up()


def _forward(x: Tensor, starts: Tensor, heads: int, parameters: Sequence[Tensor], saved: Sequence[Tensor]) -> Tensor:
    result = torch.empty_like(x)
    kept = pointers(saved) if saved else (ctypes.c_void_p * 5)()
    _call("layer_forward", x, starts, heads, parameters, kept, pointer(result))
    return result


def _call(name: str, x: Tensor, starts: Tensor, heads: int, parameters: Sequence[Tensor], *arguments: object) -> None:
    kernel = function(name, x.dtype)
    assert kernel is not None
    parameters = [parameter.contiguous() for parameter in parameters]
    sizes = integers(x.shape[0], len(starts) - 1, x.shape[-1], heads, parameters[4].shape[-1])
    kernel(sizes, pointer(starts), torch.get_num_threads(), pointers(parameters), pointer(x), *arguments)
