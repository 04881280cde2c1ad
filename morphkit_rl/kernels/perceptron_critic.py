"""Perceptron critics of many robots as one compiled operation; `perceptron_critic.cpp` shows their equations."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from morphkit_rl.kernels.gradient_rows import GradientRows
from morphkit_rl.kernels.library import STEP, ThreadGradients, bound, integers, pointer, pointers, takes

_BATCH, _PACKING = 256, 60
"""Rows of all robots together that groups are made for, and rows whose products cost what packing does."""


@dataclass(frozen=True, eq=False)
class Readings:
    """What the critics read of a row of observations and a row of actions, robot by robot.

    Attributes:
        robots: (robots, 7) int64: first column and number of observations, first column and number of actions, row of
            the robot's vector, where its part of `places` begins, its group.
        places: int64 place of every scalar's text among those of its group: a robot's observations, then its actions,
            then the next robot.
        groups: (groups, 2) int64: where a group's part of `texts` begins, and how many texts are its own.
        texts: int64 rows of the texts' vectors, group by group.
    """

    robots: Tensor
    places: Tensor
    groups: Tensor
    texts: Tensor

    @classmethod
    def of(cls, robots: Sequence[Sequence[int]], texts: Sequence[Sequence[int]]) -> Readings:
        """Those of robots that each read scalars of some texts.

        Args:
            robots: For each robot the first five numbers of `robots`.
            texts: For each robot the rows of its scalars' vectors.
        """
        rows: list[list[int]] = []
        groups: list[list[int]] = []
        places: list[int] = []
        listed: list[int] = []
        for members in _grouped(texts):
            own = list(dict.fromkeys(text for robot in members for text in texts[robot]))
            place = {text: number for number, text in enumerate(own)}
            for robot in members:
                rows.append([*robots[robot], len(places), len(groups)])
                places += [place[text] for text in texts[robot]]
            groups.append([len(listed), len(own)])
            listed += own
        return cls(*(torch.tensor(numbers, dtype=torch.int64) for numbers in (rows, places, groups, listed)))


def _grouped(texts: Sequence[Sequence[int]]) -> list[list[int]]:
    """Neighboring robots in groups, where one product over all texts of a group costs less than one a robot.

    A product costs a text so much for each row and, where its vector is packed, as much as for `_PACKING` rows.
    """
    rows = max(_BATCH // len(texts), 1)
    found: list[list[int]] = []
    union: set[int] = set()
    for robot, own in enumerate(texts):
        both = union | set(own)
        together = len(both) * (rows * (len(found[-1]) + 1) + _PACKING) if found else math.inf
        apart = len(union) * (rows * len(found[-1]) + _PACKING) + len(set(own)) * (rows + _PACKING) if found else 0
        if together <= apart:
            found[-1].append(robot)
            union = both
        else:
            found.append([robot])
            union = set(own)
    return found


def available(x: Tensor, width: int, precision: torch.dtype) -> bool:
    """Whether the kernel can do what `perceptron_critic` is asked for."""
    return width % STEP == 0 and x.dtype == torch.float32 and takes(x, "critic_forward", precision)


def perceptron_critic(
    obs: Tensor, action: Tensor, readings: Readings, members: int, parameters: Sequence[Tensor], precision: torch.dtype
) -> Tensor:
    """Outputs of the first `members` critics.

    Args:
        obs: (batch, tokens), float32.
        action: (batch, actions), float32.
        readings: What the robots read.
        members: Number of critics.
        parameters: Vectors of tokens (members, texts, width) and robots (members, robots, width), weight and bias of
            the head, scale and shift of the first norm, then weight, bias, scale and shift of every hidden layer. All
            are float32.
        precision: float32 or bfloat16: how precise the factors of products are.

    Returns:
        (members, batch, robots, outputs), float32.
    """
    obs, action = obs.contiguous(), action.contiguous()
    if torch.is_grad_enabled() and any(tensor.requires_grad for tensor in (obs, action, *parameters)):
        result: Tensor = Critic.apply(obs, action, readings, members, precision, *parameters)
        return result
    return _forward(obs, action, readings, members, precision, parameters, ())


class CriticPass:
    """`perceptron_critic` at rows that lie in fixed memory, and back, without autograd.

    Args:
        obs: (batch, tokens), float32, read anew by each `forward`, as `action` is.
        action: (batch, actions), float32.
        readings: As in `perceptron_critic`.
        members: As in `perceptron_critic`.
        parameters: As in `perceptron_critic`; contiguous.
        precision: As in `perceptron_critic`.
        into: Where `backward` adds gradients of the parameters, in their order, or, (members, batch, actions), writes
            those of the actions; None where there is no way back.

    Attributes:
        output: (members, batch, robots, outputs) of `forward`.
        gradient: That of `output`, which `backward` starts from.
    """

    def __init__(
        self, obs: Tensor, action: Tensor, readings: Readings, members: int, parameters: Sequence[Tensor],
        precision: torch.dtype, *, into: GradientRows | Tensor | None = None,
    ):  # fmt: skip
        outputs = parameters[2].shape[-1]
        self.output = obs.new_empty(members, obs.shape[0], readings.robots.shape[0], outputs)
        saved = [] if into is None else _saved(obs, readings, members, parameters, precision)
        common = (obs, action, readings, members, precision, parameters, _kept(saved, parameters))
        self.forward = _bound("critic_forward", *common, pointer(self.output))
        if into is not None:
            self.gradient = torch.empty_like(self.output)
            wanted = (pointer(into), None) if isinstance(into, Tensor) else (None, into.pointers(parameters))
            self.backward = _bound("critic_backward", *common, pointer(self.gradient), None, *wanted)


class Critic(torch.autograd.Function):
    """`perceptron_critic` for autograd."""

    @staticmethod
    def forward(
        ctx: Any,
        obs: Tensor,
        action: Tensor,
        readings: Readings,
        members: int,
        precision: torch.dtype,
        *parameters: Tensor,
    ) -> Tensor:
        """The output; keeps what the way back needs."""
        saved = _saved(obs, readings, members, parameters, precision)
        ctx.save_for_backward(obs, action, *saved, *parameters)
        ctx.readings, ctx.members, ctx.precision, ctx.saved = readings, members, precision, len(saved)
        return _forward(obs, action, readings, members, precision, parameters, saved)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        """Gradients of all arguments; None of those that have none or need none."""
        obs, action, *rest = ctx.saved_tensors
        saved, parameters = rest[: ctx.saved], rest[ctx.saved :]
        inputs = [
            x.new_empty(ctx.members, *x.shape) if wanted else None
            for x, wanted in zip((obs, action), ctx.needs_input_grad[:2], strict=True)
        ]
        gradients = ThreadGradients(parameters, any(ctx.needs_input_grad[5:]))
        _bound(
            "critic_backward", obs, action, ctx.readings, ctx.members, ctx.precision, parameters,
            pointers(saved), pointer(gradient.contiguous()), *(x if x is None else pointer(x) for x in inputs),
            gradients.pointers,
        )()  # fmt: skip
        return *(x if x is None else x.sum(0) for x in inputs), None, None, None, *gradients.add_up()


def _forward(
    obs: Tensor,
    action: Tensor,
    readings: Readings,
    members: int,
    precision: torch.dtype,
    parameters: Sequence[Tensor],
    saved: Sequence[Tensor],
) -> Tensor:
    result = obs.new_empty(members, obs.shape[0], readings.robots.shape[0], parameters[2].shape[-1])
    kept = _kept(saved, parameters)
    _bound("critic_forward", obs, action, readings, members, precision, parameters, kept, pointer(result))()
    return result


def _layers(parameters: Sequence[Tensor]) -> int:
    return (len(parameters) - 6) // 4


def _saved(
    obs: Tensor, readings: Readings, members: int, parameters: Sequence[Tensor], precision: torch.dtype
) -> list[Tensor]:
    """Memory for what the way back needs."""
    shape = members, obs.shape[0] * readings.robots.shape[0], parameters[0].shape[-1]
    return [obs.new_empty(shape, dtype=precision) for _ in range(1 + _layers(parameters))]


def _kept(saved: Sequence[Tensor], parameters: Sequence[Tensor]) -> ctypes.Array[ctypes.c_void_p]:
    return pointers(saved) if saved else (ctypes.c_void_p * (1 + _layers(parameters)))()


def _bound(
    name: str,
    obs: Tensor,
    action: Tensor,
    readings: Readings,
    members: int,
    precision: torch.dtype,
    parameters: Sequence[Tensor],
    *arguments: object,
) -> Callable[[], None]:
    token, robot, head = parameters[:3]
    sizes = integers(
        members, obs.shape[0], readings.robots.shape[0], token.shape[-1], _layers(parameters), head.shape[-1],
        obs.shape[1], action.shape[1], token.shape[1], robot.shape[1], readings.groups.shape[0],
    )  # fmt: skip
    parameters = [parameter.contiguous() for parameter in parameters]
    tables = pointers((readings.robots, readings.places, readings.groups, readings.texts))
    rows = pointers(parameters), pointer(obs), pointer(action)
    return bound(name, precision, sizes, torch.get_num_threads(), tables, *rows, *arguments)
