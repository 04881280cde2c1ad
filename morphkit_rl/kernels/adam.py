"""A step of Adam, with what comes before and after it, as one compiled operation; `adam.cpp` shows its equations."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from itertools import chain

import torch
from torch import Tensor

from morphkit_rl.kernels.gradient_rows import GradientRows
from morphkit_rl.kernels.library import bound, function, integers, pointer, pointers

Averages = Sequence[tuple[Sequence[Tensor], float]]
_NAMES = ("exp_avg", "exp_avg_sq", "step")


def available(device: torch.device) -> bool:
    """Whether the kernel can do what `AdamStep` is asked for."""
    return device.type == "cpu" and function("adam_step", torch.float32) is not None


class AdamStep:
    """Clip the gradient's norm, do a step, clear the gradients, and move running averages toward the parameters.

    Args:
        optimizer: Whose step sizes and moments count; its weight decay and other extras are not looked at.
        parameters: All that it optimizes, in the order of the gradients; float32, contiguous.
        gradients: Theirs come first in it.
        clip: Largest norm of all gradients together; 0 for any.
        averages: Tensors like the parameters, and the share of the way that they move toward them.
    """

    def __init__(
        self,
        optimizer: torch.optim.Adam,
        parameters: Sequence[Tensor],
        gradients: GradientRows,
        clip: float,
        averages: Averages = (),
    ):
        self._optimizer, self._parameters = optimizer, parameters
        self._states = [_state(optimizer, parameter) for parameter in parameters]
        self._numbers = (ctypes.c_double * 5)(clip)
        rows, stride = gradients.rows.shape
        self._step = bound(
            "adam_step",
            torch.float32,
            integers(len(parameters), len(averages), rows, stride),
            integers(*(parameter.numel() for parameter in parameters)),
            torch.get_num_threads(),
            pointers(parameters),
            *(pointers([state[name] for state in self._states]) for name in _NAMES),
            pointer(gradients.rows),
            pointers(list(chain.from_iterable(tensors for tensors, _ in averages))),
            (ctypes.c_float * len(averages))(*(share for _, share in averages)),
            self._numbers,
        )

    def __call__(self) -> None:
        """Do the step."""
        group = self._optimizer.param_groups[0]
        self._numbers[1:] = [float(group["lr"]), *group["betas"], group["eps"]]
        self._step()

    @property
    def is_current(self) -> bool:
        """Whether the optimizer's moments are still those that were bound."""
        own = self._optimizer.state
        return all(own.get(p) is state for p, state in zip(self._parameters, self._states, strict=True))


def _state(optimizer: torch.optim.Adam, parameter: Tensor) -> dict[str, Tensor]:
    """The moments of a parameter, as PyTorch's Adam keeps them."""
    state: dict[str, Tensor] = optimizer.state[parameter]
    if not state:
        state["step"] = torch.zeros((), dtype=torch.float32)
        state["exp_avg"], state["exp_avg_sq"] = torch.zeros_like(parameter), torch.zeros_like(parameter)
    return state
