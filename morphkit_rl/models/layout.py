"""Where the tokens, limbs and actuators of several robots stand in one row of numbers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from morphkit.tokens import TokenSpec

SELF, PARENT, CHILD, OTHER, FOREIGN = range(5)


@dataclass(frozen=True)
class Slots:
    """The named scalars that each limb reads.

    Attributes:
        column: (limbs, slots) column of each scalar in the input row; the row's width where the slot is empty.
        text: (limbs, slots) index of its text in `Layout.embeddings`.
        mask: (limbs, slots, 1), 1 where the slot holds a scalar.
    """

    column: Tensor
    text: Tensor
    mask: Tensor


@dataclass(frozen=True)
class Layout:
    """Robots of any size side by side: a row holds robot 0's scalars, then robot 1's, ...

    Nothing is padded but the slots of a limb. Limbs of all robots form one sequence, in which `relation` keeps the
    robots apart.

    Attributes:
        specs: The robots.
        tokens: One slice a robot into the columns of an observation row.
        actuators: One slice a robot into the columns of an action row.
        embeddings: (texts, size) embeddings of all distinct token texts.
        observation: What each limb reads of an observation row.
        observation_and_action: What each limb reads of an observation row followed by an action row.
        relation: (limbs, limbs) what limb j is to limb i: itself, parent, child, other or of a foreign robot.
        limb_embeddings: (limbs, size) mean embedding of each limb's sensor texts.
        actuator_text: (actuators,) index of each actuator's text.
        actuator_limb: (actuators,) limb that it drives; the number of limbs where it drives no single one.
        robot_limbs: (robots, limbs) weights that average over a robot's limbs.
        actuator_robot: (actuators,) robot of each actuator.
    """

    specs: tuple[TokenSpec, ...]
    tokens: tuple[slice, ...]
    actuators: tuple[slice, ...]
    embeddings: Tensor
    observation: Slots
    observation_and_action: Slots
    relation: Tensor
    limb_embeddings: Tensor
    actuator_text: Tensor
    actuator_limb: Tensor
    robot_limbs: Tensor
    actuator_robot: Tensor

    @property
    def num_robots(self) -> int:
        """Number of robots in a row."""
        return len(self.specs)

    @property
    def num_tokens(self) -> int:
        """Width of an observation row."""
        return self.tokens[-1].stop

    @property
    def num_actuators(self) -> int:
        """Width of an action row."""
        return self.actuators[-1].stop


def build_layout(
    specs: Sequence[TokenSpec], embed: Callable[[Sequence[str]], np.ndarray], device: torch.device | str = "cpu"
) -> Layout:
    """Lay out `specs` side by side.

    Args:
        specs: Robots, in the order of a row.
        embed: Texts to float32 embeddings (texts, size).
        device: Where the tensors live.
    """
    texts = list(dict.fromkeys(text for spec in specs for text in spec.texts))
    text_index = {text: index for index, text in enumerate(texts)}
    limb_counts = [len(spec.limbs) for spec in specs]
    limb_offset = np.concatenate([[0], np.cumsum(limb_counts)])
    tokens = _slices([len(spec.sensors) for spec in specs])
    actuators = _slices([len(spec.actuators) for spec in specs])
    num_limbs, num_tokens = int(limb_offset[-1]), tokens[-1].stop

    sensed: list[list[tuple[int, int]]] = [[] for _ in range(num_limbs)]
    driven: list[list[tuple[int, int]]] = [[] for _ in range(num_limbs)]
    relation = np.full((num_limbs, num_limbs), FOREIGN)
    actuator_limb, actuator_text = [], []
    for robot, spec in enumerate(specs):
        first, last = int(limb_offset[robot]), int(limb_offset[robot + 1])
        for sensor, limb in zip(spec.sensors, spec.token_limb, strict=True):
            sensed[first + limb].append((tokens[robot].start + sensor.index, text_index[sensor.text]))
        for actuator, limb in zip(spec.actuators, spec.actuator_limb, strict=True):
            entry = (num_tokens + actuators[robot].start + actuator.index, text_index[actuator.text])
            for reader in [first + limb] if limb >= 0 else range(first, last):
                driven[reader].append(entry)
            actuator_limb.append(first + limb if limb >= 0 else num_limbs)
            actuator_text.append(text_index[actuator.text])
        relation[first:last, first:last] = _relations(spec)

    def tensor(values: object, dtype: torch.dtype = torch.long) -> Tensor:
        return torch.as_tensor(np.asarray(values), dtype=dtype, device=device)

    embeddings = embed(texts)
    limb_embeddings = np.stack([embeddings[[text for _, text in entries]].mean(0) for entries in sensed])
    robot_limbs = np.zeros((len(specs), num_limbs), np.float32)
    for robot in range(len(specs)):
        robot_limbs[robot, limb_offset[robot] : limb_offset[robot + 1]] = 1 / limb_counts[robot]

    def slots(entries: list[list[tuple[int, int]]], width: int) -> Slots:
        column, text, mask = _pad(entries, width)
        return Slots(tensor(column), tensor(text), tensor(mask[..., None], torch.float32))

    return Layout(
        specs=tuple(specs),
        tokens=tokens,
        actuators=actuators,
        embeddings=tensor(embeddings, torch.float32),
        observation=slots(sensed, num_tokens),
        observation_and_action=slots(
            [a + b for a, b in zip(sensed, driven, strict=True)], num_tokens + actuators[-1].stop
        ),
        relation=tensor(relation),
        limb_embeddings=tensor(limb_embeddings, torch.float32),
        actuator_text=tensor(np.asarray(actuator_text, dtype=np.int64)),
        actuator_limb=tensor(np.asarray(actuator_limb, dtype=np.int64)),
        robot_limbs=tensor(robot_limbs, torch.float32),
        actuator_robot=tensor(np.repeat(np.arange(len(specs)), [len(spec.actuators) for spec in specs])),
    )


def _slices(lengths: Sequence[int]) -> tuple[slice, ...]:
    ends = np.cumsum(lengths).tolist()
    return tuple(slice(end - length, end) for end, length in zip(ends, lengths, strict=True))


def _relations(spec: TokenSpec) -> np.ndarray:
    """(limbs, limbs) relation of limb j to limb i within one robot."""
    index = {limb.name: number for number, limb in enumerate(spec.limbs)}
    relation = np.full((len(index), len(index)), OTHER)
    np.fill_diagonal(relation, SELF)
    for limb in spec.limbs:
        if limb.parent is not None:
            relation[index[limb.name], index[limb.parent]] = PARENT
            relation[index[limb.parent], index[limb.name]] = CHILD
    return relation


def _pad(entries: list[list[tuple[int, int]]], empty: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    slots = max(map(len, entries))
    column = np.full((len(entries), slots), empty)
    text = np.zeros((len(entries), slots), int)
    for limb, row in enumerate(entries):
        if row:
            column[limb, : len(row)], text[limb, : len(row)] = np.transpose(row)
    return column, text, column != empty
