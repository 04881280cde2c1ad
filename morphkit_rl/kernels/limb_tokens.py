"""Limb tokens from named scalars as one compiled operation; `limb_tokens.cpp` shows their equations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from morphkit_rl.kernels.gradient_rows import GradientRows
from morphkit_rl.kernels.library import STEP, ThreadGradients, bound, integers, pointer, takes


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


class LimbTokensPass:
    """`limb_tokens` of scalars and vectors that lie in fixed memory, and back, without autograd.

    Args:
        row: As in `limb_tokens`, read anew by each `forward`, as `table` and `names` are.
        scalars: As in `limb_tokens`.
        table: As in `limb_tokens`.
        names: As in `limb_tokens`.
        precision: As in `limb_tokens`.
        into: Where `backward` adds gradients of `table` and `names`; None where there is no way back.

    Attributes:
        output: (members, batch, limbs, d_model) of `forward`.
        gradient: That of `output`, which `backward` starts from.
    """

    def __init__(
        self, row: Tensor, scalars: Scalars, table: Tensor, names: Tensor, precision: torch.dtype,
        into: GradientRows | None = None,
    ):  # fmt: skip
        members, limbs, width = names.shape
        shape = members, row.shape[0], limbs, width
        self.output, self.gradient = (row.new_empty(shape, dtype=precision) for _ in range(2))
        kept = None if into is None else pointer(torch.empty_like(self.output))
        common = (row, scalars, precision, table, names, kept)
        self.forward = _bound("limb_tokens_forward", *common, pointer(self.output))
        if into is not None:
            own = pointer(self.gradient), into.pointers((table, names))
            self.backward = _bound("limb_tokens_backward", *common, *own)


class LimbTokens(torch.autograd.Function):
    """`limb_tokens` for autograd."""

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
        _bound(
            "limb_tokens_backward", row, ctx.scalars, ctx.precision, table, names,
            pointer(kept), pointer(gradient.contiguous()), gradients.pointers,
        )()  # fmt: skip
        return None, None, None, *gradients.add_up()


def _forward(
    row: Tensor, scalars: Scalars, precision: torch.dtype, table: Tensor, names: Tensor, kept: Tensor | None
) -> Tensor:
    members, limbs, width = names.shape
    result = row.new_empty(members, row.shape[0], limbs, width, dtype=precision)
    saved = None if kept is None else pointer(kept)
    _bound("limb_tokens_forward", row, scalars, precision, table, names, saved, pointer(result))()
    return result


def _bound(
    name: str, row: Tensor, scalars: Scalars, precision: torch.dtype, table: Tensor, names: Tensor, *arguments: object
) -> Callable[[], None]:
    members, limbs, width = names.shape
    sizes = integers(members, row.shape[0], limbs, width, row.shape[1], table.shape[1])
    places = map(pointer, (scalars.firsts, scalars.columns, scalars.texts, row, table, names))
    return bound(name, precision, sizes, torch.get_num_threads(), *places, *arguments)
