"""Autograd functions without autograd, whose bookkeeping would cost more than the functions themselves."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor


class Call:
    """A function of the kernels, applied once, and what it kept for its way back.

    Args:
        function: A subclass of `torch.autograd.Function` whose forward and backward need no more of their context than
            saved tensors, attributes and which gradients are wanted.
        arguments: What its forward takes.
        wanted: For each argument, whether its gradient is wanted.

    Attributes:
        output: What the function gave.
    """

    output: Tensor

    def __init__(self, function: type[torch.autograd.Function], *arguments: Any, wanted: tuple[bool, ...]):
        self._function, self.needs_input_grad = function, wanted
        self.saved_tensors: tuple[Tensor, ...] = ()
        self.output = function.forward(self, *arguments)

    def save_for_backward(self, *tensors: Tensor) -> None:
        """Keep tensors, as autograd's context does."""
        self.saved_tensors = tensors

    def backward(self, gradient: Tensor) -> tuple[Any, ...]:
        """Gradients of the arguments from that of the output; None where there is none."""
        found: tuple[Any, ...] = self._function.backward(self, gradient)  # type: ignore[arg-type]
        return found
