"""A transformer encoder layer as one compiled operation; `encoder_layer.cpp` shows its equations."""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Sequence

import torch
from torch import Tensor
from torch.autograd.function import FunctionCtx, once_differentiable

from morphkit_rl.kernels import library

STEP = 16
"""Widths of heads and hidden layers that the kernel can do are multiples of this."""


def available(x: Tensor, spans: Sequence[slice], heads: int, hidden: int) -> bool:
    """Whether the kernel can take (members, batch, tokens, d_model) `x`, whose robots lie at `spans`."""
    if x.device.type != "cpu" or x.dtype not in (torch.float32, torch.bfloat16) or not x.numel():
        return False
    if x.shape[-1] % (heads * STEP) or hidden % STEP:
        return False
    edges = [0, *(span.stop for span in spans)]
    if edges[-1] != x.shape[2] or edges[:-1] != [span.start for span in spans] or sorted(set(edges)) != edges:
        return False
    return _function("forward", x.dtype) is not None


def encoder_layer(x: Tensor, spans: Sequence[slice], heads: int, parameters: Sequence[Tensor]) -> Tensor:
    """Apply the layer to (members, batch, tokens, d_model) `x`.

    Args:
        x: Tokens, float32 or bfloat16, which is the precision of the products.
        spans: Consecutive slices of the tokens that attend among themselves.
        heads: Number of attention heads.
        parameters: Weights (members, inputs, outputs) and biases of queries, keys and values, of what leaves the
            attention, and of both feed-forward maps; weights and biases of both norms. All float32; the first
            `len(x)` members are used.
    """
    starts = _starts(tuple(span.stop for span in spans), x.shape[1])
    if torch.is_grad_enabled() and any(tensor.requires_grad for tensor in (x, *parameters)):
        return _EncoderLayer.apply(x, starts, heads, *parameters)
    return _forward(x.contiguous(), starts, heads, parameters, ())


class _EncoderLayer(torch.autograd.Function):
    @staticmethod
    def forward(ctx: FunctionCtx, x: Tensor, starts: Tensor, heads: int, *parameters: Tensor) -> Tensor:
        x = x.contiguous()
        width, hidden = x.shape[-1], parameters[4].shape[-1]
        saved = [x.new_empty(*x.shape[:3], columns) for columns in (3 * width, width, width, hidden, width)]
        ctx.save_for_backward(x, *saved, *parameters)
        ctx.starts, ctx.heads = starts, heads
        return _forward(x, starts, heads, parameters, saved)

    @staticmethod
    @once_differentiable
    def backward(ctx: FunctionCtx, gradient: Tensor) -> tuple[Tensor | None, ...]:
        x, *rest = ctx.saved_tensors
        saved, parameters = rest[:5], rest[5:]
        x_gradient, threads = torch.empty_like(x), torch.get_num_threads()
        sums, gradients = None, [None] * len(parameters)
        if any(ctx.needs_input_grad[3:]):
            sizes = [parameter.numel() for parameter in parameters]
            sums = x.new_zeros(threads, sum(sizes), dtype=torch.float32)
            shares = [share for thread in sums for share in thread.split(sizes)]
        function = _function("backward", x.dtype)
        function(
            _sizes(x, ctx.starts, ctx.heads, parameters), _pointer(ctx.starts), threads, _pointers(parameters),
            _pointer(x), _pointers(saved), _pointer(gradient.contiguous()), _pointer(x_gradient),
            None if sums is None else _pointers(shares),
        )  # fmt: skip
        if sums is not None:
            flats = sums.sum(0).split(sizes)
            gradients = [flat.view_as(parameter) for flat, parameter in zip(flats, parameters, strict=True)]
        return x_gradient, None, None, *gradients


def _forward(x: Tensor, starts: Tensor, heads: int, parameters: Sequence[Tensor], saved: Sequence[Tensor]) -> Tensor:
    result = torch.empty_like(x)
    function = _function("forward", x.dtype)
    function(
        _sizes(x, starts, heads, parameters), _pointer(starts), torch.get_num_threads(), _pointers(parameters),
        _pointer(x), _pointers(saved) if saved else (ctypes.c_void_p * 5)(), _pointer(result),
    )  # fmt: skip
    return result


@functools.cache
def _function(name: str, dtype: torch.dtype) -> ctypes._CFuncPtr | None:
    kernels = library.load()
    return getattr(kernels, f"{name}_{str(dtype).removeprefix('torch.')}", None)


@functools.lru_cache(maxsize=64)
def _starts(stops: tuple[int, ...], batch: int) -> Tensor:
    """Row of the first token of every robot in every sample, and the number of rows."""
    edges = torch.tensor([0, *stops])
    starts = torch.arange(batch)[:, None] * edges[-1] + edges[:-1]
    return torch.cat([starts.ravel(), batch * edges[-1:]])


def _sizes(x: Tensor, starts: Tensor, heads: int, parameters: Sequence[Tensor]) -> ctypes.Array:
    return (ctypes.c_int64 * 5)(len(x), len(starts) - 1, x.shape[-1], heads, parameters[4].shape[-1])


def _pointer(tensor: Tensor) -> ctypes.c_void_p:
    return ctypes.c_void_p(tensor.data_ptr())


def _pointers(tensors: Sequence[Tensor]) -> ctypes.Array:
    return (ctypes.c_void_p * len(tensors))(*[tensor.data_ptr() for tensor in tensors])
