"""Actions from limb tokens as one compiled operation; `actuator_heads.cpp` shows its equations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from morphkit_rl.kernels.gradient_rows import GradientRows
from morphkit_rl.kernels.library import STEP, ThreadGradients, bound, integers, pointer, pointers, takes


def available(x: Tensor) -> bool:
    """Whether the kernel can do what `actuator_heads` is asked for."""
    return x.shape[-1] % STEP == 0 and takes(x, "heads_forward")


def actuator_heads(x: Tensor, limb: Tensor, parameters: Sequence[Tensor]) -> Tensor:
    """Actions in [-1, 1].

    Args:
        x: (batch, limbs, d_model) tokens, float32 or bfloat16, which is how precise factors are.
        limb: (actions,) int64 limb that each action reads.
        parameters: Weight (d_model, d_model) and bias that read a token, vectors (actions, d_model), weight
            (d_model, 1) and bias of the head; float32.

    Returns:
        (batch, actions), float32.
    """
    parameters = [parameter.contiguous() for parameter in parameters]
    if torch.is_grad_enabled() and any(tensor.requires_grad for tensor in (x, *parameters)):
        result: Tensor = ActuatorHeads.apply(x.contiguous(), limb, *parameters)
        return result
    return _forward(x.contiguous(), limb, parameters, None)


class ActuatorHeadsPass:
    """`actuator_heads` at tokens that lie in fixed memory, and back, without autograd.

    Args:
        x: As in `actuator_heads`, read anew by each `forward`.
        limb: As in `actuator_heads`.
        parameters: As in `actuator_heads`; contiguous, and read anew as well.
        into: Where `backward` adds gradients of the parameters; None where there is no way back.
        x_gradient: Like `x`: where `backward` writes that of `x`; None where there is no way back.

    Attributes:
        output: (batch, actions) of `forward`.
        gradient: That of `output`, which `backward` starts from.
    """

    def __init__(
        self, x: Tensor, limb: Tensor, parameters: Sequence[Tensor],
        into: GradientRows | None = None, x_gradient: Tensor | None = None,
    ):  # fmt: skip
        self.output = x.new_empty(x.shape[0], limb.shape[0], dtype=torch.float32)
        self.gradient, self._x_gradient = torch.empty_like(self.output), x_gradient
        kept = None if into is None else pointer(x.new_empty(x.shape[0], limb.shape[0], x.shape[-1]))
        self.forward = _bound("heads_forward", x, limb, parameters, kept, pointer(self.output))
        if into is not None and x_gradient is not None:
            gradients = pointer(self.gradient), pointer(x_gradient), into.pointers(parameters)
            self._add = _bound("heads_backward", x, limb, parameters, kept, pointer(self.output), *gradients)

    def backward(self) -> None:
        """From `gradient` to those of `x` and the parameters."""
        assert self._x_gradient is not None
        self._x_gradient.zero_()
        self._add()


class ActuatorHeads(torch.autograd.Function):
    """`actuator_heads` for autograd."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, limb: Tensor, *parameters: Tensor) -> Tensor:
        """The output; keeps what the way back needs."""
        kept = x.new_empty(x.shape[0], limb.shape[0], x.shape[-1])
        result = _forward(x, limb, parameters, kept)
        ctx.save_for_backward(x, limb, kept, result, *parameters)
        return result

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        """Gradients of all arguments; None of those that have none or need none."""
        x, limb, kept, result, *parameters = ctx.saved_tensors
        x_gradient, gradients = torch.zeros_like(x), ThreadGradients(parameters, True)
        _bound(
            "heads_backward", x, limb, parameters,
            pointer(kept), pointer(result), pointer(gradient.contiguous()), pointer(x_gradient), gradients.pointers,
        )()  # fmt: skip
        return x_gradient, None, *gradients.add_up()


def _forward(x: Tensor, limb: Tensor, parameters: Sequence[Tensor], kept: Tensor | None) -> Tensor:
    result = x.new_empty(x.shape[0], limb.shape[0], dtype=torch.float32)
    _bound("heads_forward", x, limb, parameters, None if kept is None else pointer(kept), pointer(result))()
    return result


def _bound(name: str, x: Tensor, limb: Tensor, parameters: Sequence[Tensor], *arguments: object) -> Callable[[], None]:
    sizes = integers(x.shape[0], x.shape[1], limb.shape[0], x.shape[-1])
    places = pointer(limb), pointers(parameters), pointer(x)
    return bound(name, x.dtype, sizes, torch.get_num_threads(), *places, *arguments)
