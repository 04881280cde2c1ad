"""A step of Adam, with what comes before and after it, as one compiled operation; `adam.cpp` shows its equations."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from itertools import chain

import torch
from torch import Tensor

from morphkit_rl.kernels.library import function, integers, pointers

Averages = Sequence[tuple[Sequence[Tensor], float]]


def available(device: torch.device) -> bool:
    """Whether the kernel can do what `adam_step` is asked for."""
    return device.type == "cpu" and function("adam_step", torch.float32) is not None


def adam_step(
    optimizer: torch.optim.Adam,
    parameters: Sequence[Tensor],
    gradients: Sequence[Tensor],
    clip: float,
    averages: Averages = (),
) -> None:
    """Clip the gradient's norm, do a step, and move running averages toward the parameters.

    Args:
        optimizer: Whose step sizes and moments count; its weight decay and other extras are not looked at.
        parameters: All that it optimizes, in the order of the gradients; float32, contiguous.
        gradients: As many numbers each as the parameter has; float32, contiguous.
        clip: Largest norm of all gradients together; 0 for any.
        averages: Tensors like the parameters, and the share of the way that they move toward them.
    """
    states = [_state(optimizer, parameter) for parameter in parameters]
    group = optimizer.param_groups[0]
    numbers = (clip, float(group["lr"]), *group["betas"], group["eps"])
    kernel = function("adam_step", torch.float32)
    assert kernel is not None
    kernel(
        integers(len(parameters), len(averages)),
        integers(*(parameter.numel() for parameter in parameters)),
        torch.get_num_threads(),
        pointers(parameters),
        *(pointers([state[name] for state in states]) for name in ("exp_avg", "exp_avg_sq", "step")),
        pointers(gradients),
        pointers(list(chain.from_iterable(tensors for tensors, _ in averages))),
        (ctypes.c_float * len(averages))(*(share for _, share in averages)),
        (ctypes.c_double * len(numbers))(*numbers),
    )


def _state(optimizer: torch.optim.Adam, parameter: Tensor) -> dict[str, Tensor]:
    """The moments of a parameter, as PyTorch's Adam keeps them."""
    state: dict[str, Tensor] = optimizer.state[parameter]
    if not state:
        state["step"] = torch.zeros((), dtype=torch.float32)
        state["exp_avg"], state["exp_avg_sq"] = torch.zeros_like(parameter), torch.zeros_like(parameter)
    return state
