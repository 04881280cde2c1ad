"""Reading of few probes in many tokens as one compiled operation; see `cross_attention.cpp`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from morphkit_rl.kernels.library import STEP, edges, function, integers, pointer, takes


def available(probes: Tensor, tokens: Tensor, spans: Sequence[slice], token_spans: Sequence[slice]) -> bool:
    """Whether the kernel can do what `read` is asked for."""
    return (
        tokens.shape[-1] % STEP == 0
        and probes.dtype == tokens.dtype
        and edges(spans, probes.shape[2]) is not None
        and edges(token_spans, tokens.shape[1]) is not None
        and takes(probes, "read_forward")
        and takes(tokens, "read_forward")
    )


def read(probes: Tensor, tokens: Tensor, spans: Sequence[slice], token_spans: Sequence[slice]) -> Tensor:
    """softmax(probes tokens^T) tokens, robot by robot.

    Args:
        probes: (batch, heads, queries, d_model), float32 or bfloat16.
        tokens: (batch, tokens, d_model), as precise.
        spans: Each robot's queries.
        token_spans: Each robot's tokens.

    Returns:
        What each probe reads (batch, heads, queries, d_model).
    """
    own, memory = edges(spans, probes.shape[2]), edges(token_spans, tokens.shape[1])
    assert own is not None
    assert memory is not None
    result: Tensor = _Read.apply(probes.contiguous(), tokens.contiguous(), own, memory)
    return result


class _Read(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, probes: Tensor, tokens: Tensor, own: tuple[int, ...], memory: tuple[int, ...]) -> Tensor:
        ctx.save_for_backward(probes, tokens)
        ctx.edges = own, memory
        result = torch.empty_like(probes)
        _call("read_forward", ctx.edges, probes, tokens, result)
        return result

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        probes, tokens = ctx.saved_tensors
        gradients = torch.empty_like(probes), torch.empty_like(tokens)
        _call("read_backward", ctx.edges, probes, tokens, gradient.contiguous(), *gradients)
        return *gradients, None, None


def _call(name: str, edges: tuple[tuple[int, ...], tuple[int, ...]], probes: Tensor, *tensors: Tensor) -> None:
    kernel = function(name, probes.dtype)
    assert kernel is not None
    batch, heads, _, width = probes.shape
    own, memory = edges
    sizes = integers(batch, len(own) - 1, heads, width)
    kernel(sizes, integers(*own), integers(*memory), torch.get_num_threads(), *map(pointer, (probes, *tensors)))
