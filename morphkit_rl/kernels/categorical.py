"""Errors and values of critics with categorical values, and their gradients; see `categorical.cpp`."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass

import torch
from torch import Tensor

from morphkit_rl.kernels.library import function, integers, pointer


@dataclass(frozen=True, slots=True)
class Errors:
    """Sums over samples and robots.

    Attributes:
        error: Sum of weighted errors, a scalar.
        value: Sum of weighted values, a scalar.
        gradient: That of `error` with regard to the logits, like them.
    """

    error: Tensor
    value: Tensor
    gradient: Tensor


def available(device: torch.device) -> bool:
    """Whether the kernels can do what is asked for."""
    return device.type == "cpu" and function("categorical_error", torch.float32) is not None


def categorical_error(
    logits: Tensor,
    next_logits: Tensor,
    reward: Tensor,
    discount: Tensor,
    support: float,
    *,
    reward_scale: Tensor,
    weight: Tensor,
    value_weight: Tensor,
) -> Errors:
    """Weighted sum of the errors of twin critics, and of their values.

    Args:
        logits: (2, batch, robots, atoms).
        next_logits: Those of the target critics at the next observation, alike.
        reward: (batch, robots) until there.
        discount: (batch, robots) factor on the value there.
        support: Largest value; the least is its negative.
        reward_scale: (robots,) factors on rewards.
        weight: (robots,) weights of errors.
        value_weight: (robots,) weights of values.
    """
    _, batch, robots, atoms = logits.shape
    gradient, sums = torch.empty_like(logits), torch.zeros(2, dtype=torch.float64)
    inputs = (logits, next_logits, reward, discount, reward_scale, weight, value_weight)
    _call("categorical_error", (batch, robots, atoms), support, *(x.contiguous() for x in inputs), gradient, sums)
    error, value = sums.float()
    return Errors(error, value, gradient)


def categorical_value(logits: Tensor, support: float, weight: Tensor) -> tuple[Tensor, Tensor]:
    """Weighted sum of the values that logits (members, batch, robots, atoms) say, means over members; its gradient."""
    gradient, total = torch.empty_like(logits), torch.zeros(1, dtype=torch.float64)
    _call("categorical_value", tuple(logits.shape), support, logits.contiguous(), weight.contiguous(), gradient, total)
    return total[0].float(), gradient


def _call(name: str, sizes: tuple[int, ...], support: float, *tensors: Tensor) -> None:
    kernel = function(name, torch.float32)
    assert kernel is not None
    kernel(integers(*sizes), ctypes.byref(ctypes.c_float(support)), *map(pointer, tensors))
