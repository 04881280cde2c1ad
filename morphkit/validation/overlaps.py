"""Bodies that penetrate each other where a robot starts; runs in the child of `probe`."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from morphkit.simulation.spec import compile_spec
from morphkit.simulation.start_pose import start_pose

_PENETRATION_M = 0.002


def overlaps(model: mujoco.MjModel, start: np.ndarray) -> list[dict[str, Any]]:
    """Pairs of bodies that penetrate each other in a pose, and the world's shapes with them.

    Args:
        model: The model.
        start: The pose, (nq,).

    Returns:
        `bodies`, two names, and `depth`, m, of every pair.
    """
    return [_named(model, *pair) for pair in _deepest(model, start).items()]


def link_overlaps(spec: mujoco.MjSpec, file: str) -> list[dict[str, Any]]:
    """The same of a converted URDF where it starts, as if its links could collide, which they cannot there.

    Links that a joint ties to each other are left out.

    Args:
        spec: The conversion; changed in place.
        file: What the robot is called in messages.
    """
    for geom in spec.geoms:
        in_world = geom.parent.name == "world"  # the floor, which the robot touches
        geom.contype, geom.conaffinity = (0, 0) if in_world else (geom.contype, geom.contype)
    model = compile_spec(spec, file)
    start = start_pose(model, "", file)
    group = model.body_weldid
    tied = {frozenset((int(group[model.body_parentid[each]]), int(each))) for each in group}
    return [
        _named(model, pair, depth)
        for pair, depth in _deepest(model, start).items()
        if frozenset(group[list(pair)].tolist()) not in tied
    ]


def _deepest(model: mujoco.MjModel, start: np.ndarray) -> dict[tuple[int, int], float]:
    """How deep bodies penetrate each other, m, by their ids."""
    data = mujoco.MjData(model)
    data.qpos[:] = start
    mujoco.mj_forward(model, data)
    deepest: dict[tuple[int, int], float] = {}
    for contact in data.contact[: data.ncon]:
        if contact.dist > -_PENETRATION_M:
            continue
        first, second = (int(model.geom_bodyid[geom]) if geom >= 0 else 0 for geom in (contact.geom1, contact.geom2))
        pair = min(first, second), max(first, second)
        deepest[pair] = max(deepest.get(pair, 0.0), -float(contact.dist))
    return deepest


def _named(model: mujoco.MjModel, pair: tuple[int, int], depth: float) -> dict[str, Any]:
    return {"bodies": [model.body(body).name for body in pair], "depth": depth}
