"""Limb tokens from named scalars as one compiled operation; `limb_tokens.cpp` shows their equations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from morphkit_rl.kernels.library import STEP, ThreadGradients, function, integers, pointer, takes


@dataclass(frozen=True, eq=False)
class Scalars:
    """The scalars of each limb, limb by limb.

    Attributes:
        firsts: (limbs + 1,) int64 place of a limb's first scalar in the other two; their length.
        columns: int64 column of each scalar in a row.
        texts: int64 row of its vector.
    """

    firsts: Tensor
    columns: Tensor
    texts: Tensor

    @classmethod
    def of(cls, column: Tensor, text: Tensor, used: Tensor) -> Scalars:
        """Those of (limbs, slots) columns and texts, where the slot is used."""
        used = used.bool()
        firsts = torch.cat([torch.zeros(1, dtype=torch.long), used.sum(1).cpu().cumsum(0)])
        return cls(firsts, column[used].cpu().contiguous(), text[used].cpu().contiguous())


def available(row: Tensor, width: int, precision: torch.dtype) -> bool:
    """Whether the kernel can do what `limb_tokens` is asked for; rows get no gradient."""
    suits = width % STEP == 0 and row.dtype == torch.float32 and takes(row, "limb_tokens_forward", precision)
    return suits and not (row.requires_grad and torch.is_grad_enabled())


def limb_tokens(row: Tensor, scalars: Scalars, table: Tensor, names: Tensor, precision: torch.dtype) -> Tensor:
    """Normalized sums of a limb's scalars times their vectors, and its name's vector.

    Args:
        row: (batch, width) scalars.
        scalars: Which of them each limb has.
        table: (members, vectors, d_model) vectors, float32.
        names: (members, limbs, d_model), float32.
        precision: float32 or bfloat16: how precise factors and the result are.

    Returns:
        (members, batch, limbs, d_model).
    """
    if torch.is_grad_enabled() and (table.requires_grad or names.requires_grad):
        result: Tensor = LimbTokens.apply(row.contiguous(), scalars, precision, table.contiguous(), names.contiguous())
        return result
    return _forward(row.contiguous(), scalars, precision, table.contiguous(), names.contiguous(), None)


class LimbTokens(torch.autograd.Function):
    """`limb_tokens` for autograd, and for `Call`."""

    @staticmethod
    def forward(
        ctx: Any, row: Tensor, scalars: Scalars, precision: torch.dtype, table: Tensor, names: Tensor
    ) -> Tensor:
        """The output; keeps what the way back needs."""
        members, limbs, width = names.shape
        kept = row.new_empty(members, row.shape[0], limbs, width, dtype=precision)
        ctx.save_for_backward(row, table, names, kept)
        ctx.scalars, ctx.precision = scalars, precision
        return _forward(row, scalars, precision, table, names, kept)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        """Gradients of all arguments; None of those that have none or need none."""
        row, table, names, kept = ctx.saved_tensors
        gradients = ThreadGradients((table, names), True)
        _call(
            "limb_tokens_backward", row, ctx.scalars, ctx.precision, table, names,
            pointer(kept), pointer(gradient.contiguous()), gradients.pointers,
        )  # fmt: skip
        return None, None, None, *gradients.add_up()


def _forward(
    row: Tensor, scalars: Scalars, precision: torch.dtype, table: Tensor, names: Tensor, kept: Tensor | None
) -> Tensor:
    members, limbs, width = names.shape
    result = row.new_empty(members, row.shape[0], limbs, width, dtype=precision)
    saved = None if kept is None else pointer(kept)
    _call("limb_tokens_forward", row, scalars, precision, table, names, saved, pointer(result))
    return result


def _call(
    name: str, row: Tensor, scalars: Scalars, precision: torch.dtype, table: Tensor, names: Tensor, *arguments: object
) -> None:
    kernel = function(name, precision)
    assert kernel is not None
    members, limbs, width = names.shape
    sizes = integers(members, row.shape[0], limbs, width, row.shape[1], table.shape[1])
    places = map(pointer, (scalars.firsts, scalars.columns, scalars.texts, row, table, names))
    kernel(sizes, torch.get_num_threads(), *places, *arguments)
