"""Perceptron critics of many robots as one compiled operation; `perceptron_critic.cpp` shows their equations."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from morphkit_rl.kernels.library import STEP, ThreadGradients, function, integers, pointer, pointers, takes


@dataclass(frozen=True, eq=False)
class Readings:
    """What the critics read of a row of observations and a row of actions, robot by robot.

    Attributes:
        robots: (robots, 6) int64: first column and number of observations, first column and number of actions, row of
            the robot's vector, place of its first text in `texts`.
        texts: int64 rows of the vectors of all scalars: a robot's observations, then its actions, then the next robot.
    """

    robots: Tensor
    texts: Tensor


def available(x: Tensor, width: int, precision: torch.dtype) -> bool:
    """Whether the kernel can do what `perceptron_critic` is asked for."""
    return width % STEP == 0 and x.dtype == torch.float32 and takes(x, "critic_forward", precision)


def perceptron_critic(
    obs: Tensor, action: Tensor, readings: Readings, members: int, parameters: Sequence[Tensor], precision: torch.dtype
) -> Tensor:
    """Outputs of the first `members` critics.

    Args:
        obs: (batch, tokens), float32.
        action: (batch, actions), float32.
        readings: What the robots read.
        members: Number of critics.
        parameters: Vectors of tokens (members, texts, width) and robots (members, robots, width), weight and bias of
            the head, scale and shift of the first norm, then weight, bias, scale and shift of every hidden layer. All
            are float32.
        precision: float32 or bfloat16: how precise the factors of products are.

    Returns:
        (members, batch, robots, outputs), float32.
    """
    obs, action = obs.contiguous(), action.contiguous()
    if torch.is_grad_enabled() and any(tensor.requires_grad for tensor in (obs, action, *parameters)):
        result: Tensor = Critic.apply(obs, action, readings, members, precision, *parameters)
        return result
    return _forward(obs, action, readings, members, precision, parameters, ())


class Critic(torch.autograd.Function):
    """`perceptron_critic` for autograd, and for `Call`."""

    @staticmethod
    def forward(
        ctx: Any,
        obs: Tensor,
        action: Tensor,
        readings: Readings,
        members: int,
        precision: torch.dtype,
        *parameters: Tensor,
    ) -> Tensor:
        """The output; keeps what the way back needs."""
        rows, width = obs.shape[0] * readings.robots.shape[0], parameters[0].shape[-1]
        saved = [obs.new_empty(members, rows, width, dtype=precision) for _ in range(1 + _layers(parameters))]
        ctx.save_for_backward(obs, action, *saved, *parameters)
        ctx.readings, ctx.members, ctx.precision, ctx.saved = readings, members, precision, len(saved)
        return _forward(obs, action, readings, members, precision, parameters, saved)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        """Gradients of all arguments; None of those that have none or need none."""
        obs, action, *rest = ctx.saved_tensors
        saved, parameters = rest[: ctx.saved], rest[ctx.saved :]
        inputs = [
            x.new_empty(ctx.members, *x.shape) if wanted else None
            for x, wanted in zip((obs, action), ctx.needs_input_grad[:2], strict=True)
        ]
        gradients = ThreadGradients(parameters, any(ctx.needs_input_grad[5:]))
        _call(
            "critic_backward", obs, action, ctx.readings, ctx.members, ctx.precision, parameters,
            pointers(saved), pointer(gradient.contiguous()), *(x if x is None else pointer(x) for x in inputs),
            gradients.pointers,
        )  # fmt: skip
        return *(x if x is None else x.sum(0) for x in inputs), None, None, None, *gradients.add_up()


def _forward(
    obs: Tensor,
    action: Tensor,
    readings: Readings,
    members: int,
    precision: torch.dtype,
    parameters: Sequence[Tensor],
    saved: Sequence[Tensor],
) -> Tensor:
    result = obs.new_empty(members, obs.shape[0], readings.robots.shape[0], parameters[2].shape[-1])
    kept = pointers(saved) if saved else (ctypes.c_void_p * (1 + _layers(parameters)))()
    _call("critic_forward", obs, action, readings, members, precision, parameters, kept, pointer(result))
    return result


def _layers(parameters: Sequence[Tensor]) -> int:
    return (len(parameters) - 6) // 4


def _call(
    name: str,
    obs: Tensor,
    action: Tensor,
    readings: Readings,
    members: int,
    precision: torch.dtype,
    parameters: Sequence[Tensor],
    *arguments: object,
) -> None:
    kernel = function(name, precision)
    assert kernel is not None
    token, robot, head = parameters[:3]
    sizes = integers(
        members, obs.shape[0], readings.robots.shape[0], token.shape[-1], _layers(parameters), head.shape[-1],
        obs.shape[1], action.shape[1], token.shape[1], robot.shape[1],
    )  # fmt: skip
    parameters = [parameter.contiguous() for parameter in parameters]
    kernel(
        sizes, torch.get_num_threads(), pointer(readings.robots), pointer(readings.texts), pointers(parameters),
        pointer(obs), pointer(action), *arguments,
    )  # fmt: skip
