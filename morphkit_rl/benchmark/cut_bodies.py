"""Bodies cut out of training robots, which train with them: every training robot becomes a family."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from morphkit.description import Description
from morphkit.families.enumeration import sub_morphologies
from morphkit.readers import read
from morphkit.simulation.build import build_simulation

TRIED = 200
"""Cuts of a robot that are looked at, those that lose the fewest limbs first."""

Shape = tuple[object, ...]


def cut_bodies(train: Sequence[Description], others: Iterable[Description], number: int) -> list[Description]:
    """Bodies cut out of training robots, from each in turn the next one that loses the fewest limbs.

    None is a training robot or one of `others` under another name, nor the mirror image of one: none has their tree of
    masses and joints.

    Args:
        train: The training robots.
        others: Robots that training must not see.
        number: How many bodies at most.
    """
    if number == 0:
        return []
    taken = {_shape(each) for each in (*train, *others)}
    waiting = [_cuts(each) for each in train]
    found: list[Description] = []
    while waiting and len(found) < number:
        source = waiting.pop(0)
        for cut in source:
            shape = _shape(cut)
            if shape not in taken:
                taken.add(shape)
                found.append(cut)
                waiting.append(source)
                break
    return found


def _cuts(description: Description) -> Iterator[Description]:
    """Parts with an actuator, those that lose the fewest limbs first."""
    cuts = (variant.description for variant in sub_morphologies(description, limit=TRIED))
    return (each for each in cuts if read(each).actuators)


def _shape(description: Description) -> Shape:
    """The tree of a robot's bodies: masses (g), kinds and ranges (0.01 m or rad) of joints, whatever they are called.

    Ranges count by their extent, so that a mirror image has the same shape.
    """
    model = build_simulation(description, drawn=False).model
    parts: list[list[Shape]] = [[] for _ in range(model.nbody)]
    for body in reversed(range(model.nbody)):
        first = model.body_jntadr[body]
        joints = tuple(
            (int(model.jnt_type[joint]), round(100 * float(model.jnt_range[joint] @ (-1, 1))))
            for joint in range(first, first + model.body_jntnum[body])
        )
        own = (round(1000 * float(model.body_mass[body])), joints, tuple(sorted(parts[body])))
        if body == 0:
            return own
        parts[model.body_parentid[body]].append(own)
    raise AssertionError("a model without a world")
