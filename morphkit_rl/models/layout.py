"""Where the tokens, limbs and actuators of several robots are in one row of numbers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch
from torch import Tensor

from morphkit.tokens.spec import TokenSpec
from morphkit_rl.kernels.limb_layer import Kinship
from morphkit_rl.kernels.limb_tokens import Scalars

SELF, PARENT, CHILD, OTHER, FOREIGN = range(5)

GROUP_LIMBS = 96
"""Limbs of small robots that are attended over together; one long sequence is quicker than many short ones."""

Actions = Literal["actuators", "limbs"]


@dataclass(frozen=True)
class Slots:
    """The named scalars that each limb reads.

    Attributes:
        column: (limbs, slots) column of each scalar in the input row; the row's width where the slot is empty.
        text: (limbs, slots) index of its text in `Layout.embeddings`.
        mask: (limbs, slots, 1), 1 where the slot holds a scalar.
        scalars: The same limb by limb, for the compiled kernel.
    """

    column: Tensor
    text: Tensor
    mask: Tensor
    scalars: Scalars


@dataclass(frozen=True, eq=False)
class Layout:
    """Robots of any size side by side: a row holds robot 0's scalars, then robot 1's, ...

    Nothing is padded but the slots of a limb. Limbs of all robots form one sequence, in which `relation` keeps the
    robots apart. An action row has a column for each actuator, or, for methods that act by limb, one for each limb;
    those of limbs without an actuator move nothing.

    Attributes:
        specs: The robots.
        tokens: One slice a robot into the columns of an observation row.
        actions: One slice a robot into the columns of an action row.
        limbs: One slice a robot into the sequence of limbs.
        groups: Slices into the sequence of limbs that hold whole robots, as many as fit into `GROUP_LIMBS`.
        actuator_columns: For each robot, the column of each actuator within that robot's slice of an action row.
        texts: All distinct token texts.
        embeddings: (texts, size) their embeddings.
        observation: What each limb reads of an observation row.
        observation_and_action: What each limb reads of an observation row followed by an action row.
        relation: (limbs, limbs) what limb j is to limb i: itself, parent, child, other or of a foreign robot.
        kinship: The relations within each robot, for the compiled kernel.
        parents: For each limb, the place of its parent in the sequence of limbs; -1 for roots.
        limb_embeddings: (limbs, size) mean embedding of each limb's sensor texts.
        token_text: (tokens,) index of the text of each observation column.
        action_names: Name of the token of each action column.
        action_text: (actions,) index of the text of each action column.
        action_limb: (actions,) limb that it drives; the number of limbs where it drives no single one.
        each_action_has_a_limb: Whether every action drives a single limb.
        robot_limbs: (robots, limbs) weights that average over a robot's limbs.
        action_robot: (actions,) robot of each action column.
        hides_limbs: Whether limbs of a robot are foreign to others of it.
        whole: The same robots with more tokens, of which this layout has a part; None where this is all there is.
        columns: (tokens,) column of each token in an observation row of `whole`; None without one.
    """

    specs: tuple[TokenSpec, ...]
    tokens: tuple[slice, ...]
    actions: tuple[slice, ...]
    limbs: tuple[slice, ...]
    groups: tuple[slice, ...]
    actuator_columns: tuple[np.ndarray, ...]
    texts: tuple[str, ...]
    embeddings: Tensor
    observation: Slots
    observation_and_action: Slots
    relation: Tensor
    parents: tuple[int, ...]
    limb_embeddings: Tensor
    token_text: Tensor
    action_names: tuple[str, ...]
    action_text: Tensor
    action_limb: Tensor
    kinship: Kinship
    each_action_has_a_limb: bool
    robot_limbs: Tensor
    action_robot: Tensor
    hides_limbs: bool = False
    whole: Layout | None = None
    columns: Tensor | None = None

    @property
    def stored(self) -> Layout:
        """The layout of observation rows in replay, which critics see."""
        return self.whole or self

    def part(self, rows: Tensor) -> Tensor:
        """What this layout has of rows of `stored`, (..., tokens)."""
        return rows if self.columns is None else rows.index_select(-1, self.columns)

    @property
    def num_robots(self) -> int:
        """Number of robots in a row."""
        return len(self.specs)

    @property
    def num_tokens(self) -> int:
        """Width of an observation row."""
        return self.tokens[-1].stop

    @property
    def num_actions(self) -> int:
        """Width of an action row."""
        return self.actions[-1].stop

    def with_embeddings(self, embeddings: Tensor) -> Layout:
        """The same robots with other embeddings (texts, size)."""
        slots = self.observation
        limbs = (embeddings[slots.text] * slots.mask).sum(1) / slots.mask.sum(1).clamp(min=1)
        return replace(self, embeddings=embeddings, limb_embeddings=limbs)

    def with_relation(self, relation: Tensor) -> Layout:
        """The same robots, some of whose limbs are `FOREIGN` to others of theirs by `relation` (limbs, limbs)."""
        return replace(self, relation=relation, kinship=Kinship.of(relation, self.limbs), hides_limbs=True)


def build_layout(
    specs: Sequence[TokenSpec],
    embed: Callable[[Sequence[str]], np.ndarray],
    device: torch.device | str = "cpu",
    actions: Actions = "actuators",
) -> Layout:
    """Lay out `specs` side by side.

    Args:
        specs: Robots, in the order of a row.
        embed: Texts to float32 embeddings (texts, size).
        device: Where the tensors live.
        actions: Whether an action row has one column an actuator or one a limb.
    """
    controls = [_controls(spec, actions) for spec in specs]
    texts = list(
        dict.fromkeys(
            text
            for spec, own in zip(specs, controls, strict=True)
            for text in (*(sensor.text for sensor in spec.sensors), *(control.text for control in own))
        )
    )
    text_index = {text: index for index, text in enumerate(texts)}
    limbs = _slices([len(spec.limbs) for spec in specs])
    tokens = _slices([len(spec.sensors) for spec in specs])
    columns = _slices([len(own) for own in controls])
    num_limbs, num_tokens = limbs[-1].stop, tokens[-1].stop

    sensed: list[list[tuple[int, int]]] = [[] for _ in range(num_limbs)]
    driven: list[list[tuple[int, int]]] = [[] for _ in range(num_limbs)]
    relation = np.full((num_limbs, num_limbs), FOREIGN)
    action_limb, action_text, parents = [], [], []
    for robot, spec in enumerate(specs):
        first, last = limbs[robot].start, limbs[robot].stop
        for sensor, limb in zip(spec.sensors, spec.token_limb.clip(min=0), strict=True):  # of no single limb: the root
            sensed[first + limb].append((tokens[robot].start + sensor.index, text_index[sensor.text]))
        for column, control in enumerate(controls[robot], columns[robot].start):
            entry = (num_tokens + column, text_index[control.text])
            for reader in [first + control.limb] if control.limb >= 0 else range(first, last):
                driven[reader].append(entry)
            action_limb.append(first + control.limb if control.limb >= 0 else num_limbs)
            action_text.append(text_index[control.text])
        relation[first:last, first:last] = _relations(spec)
        parents += [first + parent if parent >= 0 else -1 for parent in parent_indices(spec)]

    def tensor(values: object, dtype: torch.dtype = torch.long) -> Tensor:
        return torch.as_tensor(np.asarray(values), dtype=dtype, device=device)

    embeddings = embed(texts)
    silent = np.zeros_like(embeddings[:1])
    limb_embeddings = np.stack([(embeddings[[t for _, t in own]] if own else silent).mean(0) for own in sensed])
    robot_limbs = np.zeros((len(specs), num_limbs), np.float32)
    for robot, own_limbs in enumerate(limbs):
        robot_limbs[robot, own_limbs] = 1 / (own_limbs.stop - own_limbs.start)

    def slots(entries: list[list[tuple[int, int]]], width: int) -> Slots:
        column, text, mask = _pad(entries, width)
        scalars = Scalars.of(*map(torch.from_numpy, (column, text, mask)))
        return Slots(tensor(column), tensor(text), tensor(mask[..., None], torch.float32), scalars)

    return Layout(
        specs=tuple(specs),
        tokens=tokens,
        actions=columns,
        limbs=limbs,
        groups=_groups(limbs),
        actuator_columns=tuple(
            spec.actuator_limb if actions == "limbs" else np.arange(len(spec.actuators)) for spec in specs
        ),
        texts=tuple(texts),
        embeddings=tensor(embeddings, torch.float32),
        observation=slots(sensed, num_tokens),
        observation_and_action=slots(
            [a + b for a, b in zip(sensed, driven, strict=True)], num_tokens + columns[-1].stop
        ),
        relation=tensor(relation),
        parents=tuple(parents),
        limb_embeddings=tensor(limb_embeddings, torch.float32),
        token_text=tensor([text_index[sensor.text] for spec in specs for sensor in spec.sensors]),
        action_names=tuple(control.name for own in controls for control in own),
        action_text=tensor(np.asarray(action_text, dtype=np.int64)),
        action_limb=tensor(np.asarray(action_limb, dtype=np.int64)),
        kinship=Kinship.of(torch.from_numpy(relation), limbs),
        each_action_has_a_limb=num_limbs not in action_limb,
        robot_limbs=tensor(robot_limbs, torch.float32),
        action_robot=tensor(np.repeat(np.arange(len(specs)), [len(own) for own in controls])),
    )


@dataclass(frozen=True, slots=True)
class _Control:
    """A column of an action row: its token and the index of its limb, -1 where it drives no single one."""

    name: str
    text: str
    limb: int


def _controls(spec: TokenSpec, actions: Actions) -> list[_Control]:
    own = [_Control(a.name, a.text, int(limb)) for a, limb in zip(spec.actuators, spec.actuator_limb, strict=True)]
    if actions == "actuators":
        return own
    driven = {control.limb: control for control in own}
    return [driven.get(limb) or _Control(*limb_action(spec, limb), limb) for limb in range(len(spec.limbs))]


def limb_action(spec: TokenSpec, limb: int) -> tuple[str, str]:
    """Name and text that the action of a limb without actuator would have, such as `torso_ctrl` and `torso ctrl`."""
    name = spec.limbs[limb].name
    first = next((sensor for sensor in spec.sensors if sensor.limb == name), None)
    if first is None:
        return f"{name}_ctrl", f"{name} ctrl"
    ending = "_".join(part for part in (first.quantity, first.component) if part)
    label = first.name.removesuffix(f"_{ending}") if first.name.endswith(f"_{ending}") else name
    control = f"{label}_ctrl"
    return control, control if "_" in first.text else control.replace("_", " ")


def parent_indices(spec: TokenSpec) -> list[int]:
    """Index of each limb's parent among the robot's limbs, -1 for the root."""
    index: dict[str | None, int] = {limb.name: number for number, limb in enumerate(spec.limbs)}
    return [index.get(limb.parent, -1) for limb in spec.limbs]


def _slices(lengths: Sequence[int]) -> tuple[slice, ...]:
    ends = np.cumsum(lengths).tolist()
    return tuple(slice(end - length, end) for end, length in zip(ends, lengths, strict=True))


def _groups(limbs: Sequence[slice]) -> tuple[slice, ...]:
    """Neighboring robots together, up to `GROUP_LIMBS` limbs or one robot."""
    groups = [limbs[0]]
    for own in limbs[1:]:
        if own.stop - groups[-1].start <= GROUP_LIMBS:
            groups[-1] = slice(groups[-1].start, own.stop)
        else:
            groups.append(own)
    return tuple(groups)


def _relations(spec: TokenSpec) -> np.ndarray:
    """(limbs, limbs) relation of limb j to limb i within one robot."""
    relation = np.full((len(spec.limbs), len(spec.limbs)), OTHER)
    np.fill_diagonal(relation, SELF)
    for limb, parent in enumerate(parent_indices(spec)):
        if parent >= 0:
            relation[limb, parent] = PARENT
            relation[parent, limb] = CHILD
    return relation


def _pad(entries: list[list[tuple[int, int]]], empty: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    slots = max(map(len, entries))
    column = np.full((len(entries), slots), empty)
    text = np.zeros((len(entries), slots), int)
    for limb, row in enumerate(entries):
        if row:
            column[limb, : len(row)], text[limb, : len(row)] = np.transpose(row)
    return column, text, column != empty
