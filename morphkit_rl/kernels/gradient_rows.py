"""Gradients of a network in fixed memory, to which the threads of one kernel after the other add theirs."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from itertools import accumulate, pairwise

import torch
from torch import Tensor


class GradientRows:
    """Gradients of some tensors, one after the other, in a row a thread; `AdamStep` adds the rows up and clears them.

    Args:
        tensors: Parameters of a network, and behind them what is computed from these before anything else.

    Attributes:
        rows: float32 (threads, numbers).
    """

    def __init__(self, tensors: Sequence[Tensor]):
        ends = list(accumulate((tensor.numel() for tensor in tensors), initial=0))
        self._tensors = tuple(tensors)  # kept, so that no other has their identity
        self._spans = {id(tensor): slice(*span) for tensor, span in zip(tensors, pairwise(ends), strict=True)}
        self.rows = torch.zeros(torch.get_num_threads(), ends[-1])

    def pointers(self, tensors: Sequence[Tensor]) -> ctypes.Array[ctypes.c_void_p]:
        """Where each thread adds the gradients of these tensors; lasts as long as this object."""
        firsts = [self._spans[id(tensor)].start for tensor in tensors]
        places = [row + first for row in range(0, self.rows.numel(), self.rows.shape[1]) for first in firsts]
        return (ctypes.c_void_p * len(places))(*[self.rows.data_ptr() + 4 * place for place in places])

    def part(self, tensor: Tensor) -> Tensor:
        """The first thread's gradient of a tensor, shaped like it, to write to."""
        return self.rows[0, self._spans[id(tensor)]].view(tensor.shape)

    def take(self, tensor: Tensor) -> Tensor:
        """The gradient of a tensor, which is cleared."""
        own = self.rows[:, self._spans[id(tensor)]]
        total = own.sum(0).view(tensor.shape)
        own.zero_()
        return total
