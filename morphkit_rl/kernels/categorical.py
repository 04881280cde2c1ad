"""Errors and values of critics with categorical values, and their gradients; see `categorical.cpp`."""

from __future__ import annotations

import ctypes

import torch
from torch import Tensor

from morphkit_rl.kernels.library import bound, function, integers, pointer


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
    gradient: Tensor,
) -> tuple[Tensor, Tensor]:
    """Weighted sum of the errors of twin critics, and that of their values.

    Args:
        logits: (2, batch, robots, atoms).
        next_logits: Those of the target critics at the next observation, alike.
        reward: (batch, robots) until there.
        discount: (batch, robots) factor on the value there.
        support: Largest value; the least is its negative.
        reward_scale: (robots,) factors on rewards.
        weight: (robots,) weights of errors.
        value_weight: (robots,) weights of values.
        gradient: Like `logits`: where that of the sum of errors is written.
    """
    _, batch, robots, atoms = logits.shape
    sums = torch.zeros(2, dtype=torch.float64)
    inputs = (logits, next_logits, reward, discount, reward_scale, weight, value_weight)
    _call("categorical_error", (batch, robots, atoms), support, *(x.contiguous() for x in inputs), gradient, sums)
    error, value = sums.float()
    return error, value


def categorical_value(logits: Tensor, support: float, weight: Tensor, gradient: Tensor) -> Tensor:
    """Weighted sum of the values that logits (members, batch, robots, atoms) say, means over members.

    Its gradient is written to `gradient`, which is like the logits.
    """
    total = torch.zeros(1, dtype=torch.float64)
    _call("categorical_value", tuple(logits.shape), support, logits.contiguous(), weight.contiguous(), gradient, total)
    return total[0].float()


def _call(name: str, sizes: tuple[int, ...], support: float, *tensors: Tensor) -> None:
    fixed = integers(*sizes), ctypes.byref(ctypes.c_float(support)), torch.get_num_threads()
    bound(name, torch.float32, *fixed, *map(pointer, tensors))()
