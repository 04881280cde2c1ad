"""A perceptron with two hidden relu layers as one compiled operation; `mlp.cpp` shows its equations."""

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
    function,
    integers,
    pointer,
    pointers,
    takes,
)


def available(x: Tensor, precision: torch.dtype) -> bool:
    """Whether the kernel can do what `mlp` is asked for."""
    return x.dtype == torch.float32 and takes(x, "mlp_forward", precision)


def mlp(x: Tensor, parameters: Sequence[Tensor], precision: torch.dtype) -> Tensor:
    """Map rows.

    Args:
        x: (members, rows, inputs), float32.
        parameters: Weight (members, inputs, outputs) and bias of each of the three layers, float32. The first `len(x)`
            members are used.
        precision: float32 or bfloat16: how precise the factors of products are.

    Returns:
        (members, rows, outputs), float32.
    """
    if torch.is_grad_enabled() and any(tensor.requires_grad for tensor in (x, *parameters)):
        result: Tensor = _MLP.apply(x, precision, *parameters)
        return result
    return _forward(x, parameters, precision, ())


class _MLP(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor, precision: torch.dtype, *parameters: Tensor) -> Tensor:
        widths = [-(-bias.shape[-1] // STEP) * STEP for bias in parameters[1:5:2]]
        saved = [x.new_empty(*x.shape[:2], width, dtype=precision) for width in widths]
        ctx.save_for_backward(x, *saved, *parameters)
        ctx.precision = precision
        return _forward(x, parameters, precision, saved)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        x, *rest = ctx.saved_tensors
        saved, parameters = rest[:2], rest[2:]
        x_gradient = x.new_empty(x.shape)
        gradients = ThreadGradients(parameters, any(ctx.needs_input_grad[2:]))
        _call(
            "mlp_backward", x, parameters, ctx.precision,
            pointers(saved), pointer(gradient.contiguous()), pointer(x_gradient), gradients.pointers,
        )  # fmt: skip
        return x_gradient, None, *gradients.add_up()


def _forward(x: Tensor, parameters: Sequence[Tensor], precision: torch.dtype, saved: Sequence[Tensor]) -> Tensor:
    result = x.new_empty(*x.shape[:2], parameters[-1].shape[-1])
    kept = pointers(saved) if saved else (ctypes.c_void_p * 2)()
    _call("mlp_forward", x, parameters, precision, kept, pointer(result))
    return result


def _call(name: str, x: Tensor, parameters: Sequence[Tensor], precision: torch.dtype, *arguments: object) -> None:
    kernel = function(name, precision)
    assert kernel is not None
    members, rows, inputs = x.shape
    shared = members > 1 and x.stride(0) == 0
    x = x[:1].contiguous() if shared else x.contiguous()
    parameters = [parameter.contiguous() for parameter in parameters]
    sizes = integers(members, rows, shared, inputs, *(bias.shape[-1] for bias in parameters[1::2]))
    kernel(sizes, torch.get_num_threads(), pointers(parameters), pointer(x), *arguments)
