"""Layer norm as one compiled operation; see `norm.cpp`."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from morphkit_rl.kernels.library import STEP, ThreadGradients, function, integers, pointer, takes


def available(x: Tensor) -> bool:
    """Whether the kernel can do what `norm` is asked for."""
    return x.shape[-1] % STEP == 0 and takes(x, "norm_forward")


def norm(x: Tensor, weight: Tensor, bias: Tensor) -> Tensor:
    """Normalize the last axis of `x`.

    Args:
        x: (members, ..., width), float32 or bfloat16.
        weight: (members, width) scale, float32. The first `len(x)` members are used.
        bias: (members, width) shift, float32.
    """
    if torch.is_grad_enabled() and any(tensor.requires_grad for tensor in (x, weight, bias)):
        result: Tensor = _Norm.apply(x.contiguous(), weight, bias)
        return result
    return _forward(x.contiguous(), weight, bias)


class _Norm(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor, weight: Tensor, bias: Tensor) -> Tensor:
        ctx.save_for_backward(x, weight, bias)
        return _forward(x, weight, bias)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        x, weight, bias = ctx.saved_tensors
        x_gradient = torch.empty_like(x)
        gradients = ThreadGradients((weight, bias), any(ctx.needs_input_grad[1:]))
        _call("norm_backward", x, weight, x, gradient.contiguous(), x_gradient, more=gradients.pointers)
        return x_gradient, *gradients.add_up()


def _forward(x: Tensor, weight: Tensor, bias: Tensor) -> Tensor:
    result = torch.empty_like(x)
    _call("norm_forward", x, weight, bias.contiguous(), x, result)
    return result


def _call(name: str, x: Tensor, weight: Tensor, *tensors: Tensor, **more: object) -> None:
    kernel = function(name, x.dtype)
    assert kernel is not None
    sizes = integers(x.shape[0], x[0, ..., 0].numel(), x.shape[-1])
    own = (weight.contiguous(), *tensors)
    kernel(sizes, torch.get_num_threads(), *map(pointer, own), *more.values())
