"""The start pose: the one from which a robot is shown, converted, checked and simulated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from morphkit.errors import DescriptionError
from morphkit.simulation.ground import ground_height, lowest_point
from morphkit.utils.suggest import did_you_mean

KEYFRAMES = ("home", "stand")
MIDDLE, ZERO = "middle", "zero"
_SINGLE = (mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE)
_VERTICAL = 1 - 1e-9


Keyframes = Sequence[tuple[str, np.ndarray]]
"""Name and coordinates, (nq,), of keyframes in their order."""


def start_pose(
    model: mujoco.MjModel, start: str | Mapping[str, float], file: str, keyframes: Keyframes | None = None
) -> np.ndarray:
    """The coordinates in which a robot starts, but for the height of its root.

    What counts, in this order: `start`; the keyframe `home`, then `stand`, then the first; the zero pose. Hinges and
    slides lie within their limits: what is outside is put at the nearest limit. Joints that follow others follow.

    Args:
        model: The model.
        start: What `robot.toml` says, see `RobotInfo.start`; empty for nothing. Names of joints that the model lacks do
            not matter, so that a variant can be given what its source is.
        file: What the robot is called in messages.
        keyframes: The keyframes of the file; None takes those of the model.

    Returns:
        Coordinates, (nq,).

    Raises:
        DescriptionError: `start` names a keyframe that is not there, or a value outside of its joint's limits.
    """
    if start == ZERO:
        return np.array(model.qpos0)
    known = _keyframes(model) if keyframes is None else keyframes
    key = _keyframe(known, start, file)
    qpos = np.array(model.qpos0 if key is None else key)
    if key is not None:
        mujoco.mj_normalizeQuat(model, qpos)
    given = {} if isinstance(start, str) else start
    for joint in np.flatnonzero(np.isin(model.jnt_type, _SINGLE)):
        name, address = model.joint(joint).name, model.jnt_qposadr[joint]
        low, high = model.jnt_range[joint] if model.jnt_limited[joint] else (-np.inf, np.inf)
        value = given.get(name, qpos[address])
        if name in given and not low <= value <= high:
            raise DescriptionError(
                f"{file}: joint {name!r} cannot start at {value:g}: its limits are {low:g} to {high:g}"
            )
        if not low <= value <= high:
            value = (low + high) / 2 if start == MIDDLE else np.clip(value, low, high)
        qpos[address] = value
    if key is None and not np.array_equal(qpos, model.qpos0):
        _let_follow(model, qpos, given)
    return qpos


def stand(model: mujoco.MjModel, qpos: np.ndarray, root: int, touching: np.ndarray | None = None) -> np.ndarray:
    """The pose with the root at the height at which the robot's lowest point touches the ground.

    A free root is put there where the ground is known. A root on a vertical slide keeps the height that its file gives,
    unless the start pose is another than the file's zero pose.

    Args:
        model: The model.
        qpos: The pose, (nq,).
        root: Body id of the root.
        touching: Which geoms can touch something, bool (ngeom,); None takes what the model says.

    Returns:
        The pose, (nq,).
    """
    above, ground = upward(model, root, posed=not np.array_equal(qpos, model.qpos0)), ground_height(model, touching)
    if above is None or ground is None:
        return qpos
    address, sign = above
    qpos = qpos.copy()
    qpos[address] += sign * (ground - lowest_point(model, root, qpos, touching))
    return qpos


def outside_limits(model: mujoco.MjModel, qpos: np.ndarray | None = None) -> list[str]:
    """Names of the hinges and slides that lie outside of their limits in a pose, (nq,); None for the zero pose."""
    values = (model.qpos0 if qpos is None else qpos)[model.jnt_qposadr]
    outside = (values < model.jnt_range[:, 0]) | (values > model.jnt_range[:, 1])
    single = np.isin(model.jnt_type, _SINGLE) & (model.jnt_limited > 0)
    return [model.joint(joint).name for joint in np.flatnonzero(single & outside)]


def couplings(model: mujoco.MjModel) -> list[tuple[int, int, np.ndarray]]:
    """Joints that follow another (a mimic joint): ids of follower and leader, coefficients (5,) of their polynomial."""
    found = []
    for number in range(model.neq):
        follower, leader = int(model.eq_obj1id[number]), int(model.eq_obj2id[number])
        joint = model.eq_type[number] == mujoco.mjtEq.mjEQ_JOINT
        if joint and model.eq_active0[number] and leader >= 0 and follower >= 0:
            found.append((follower, leader, np.array(model.eq_data[number, :5])))
    return found


def follow(model: mujoco.MjModel, qpos: np.ndarray, coupled: Sequence[tuple[int, int, np.ndarray]]) -> None:
    """Put joints that follow another where these put them, in place; `coupled` is some of `couplings`."""
    for follower, leader, coefficients in coupled:
        there, here = model.jnt_qposadr[leader], model.jnt_qposadr[follower]
        away = qpos[there] - model.qpos0[there]
        qpos[here] = model.qpos0[here] + np.polynomial.polynomial.polyval(away, coefficients)


def _let_follow(model: mujoco.MjModel, qpos: np.ndarray, given: Mapping[str, float]) -> None:
    coupled = [each for each in couplings(model) if model.joint(each[0]).name not in given]
    for _ in coupled:  # one may follow another that follows
        follow(model, qpos, coupled)


def _keyframes(model: mujoco.MjModel) -> Keyframes:
    return [(model.key(number).name, model.key_qpos[number]) for number in range(model.nkey)]


def _keyframe(keyframes: Keyframes, start: str | Mapping[str, float], file: str) -> np.ndarray | None:
    """Coordinates of the keyframe that counts."""
    if start == MIDDLE:
        return None
    usable = [(name, qpos) for name, qpos in keyframes if np.isfinite(qpos).all()]
    wanted = (start,) if isinstance(start, str) and start else KEYFRAMES
    named = [qpos for each in wanted for name, qpos in usable if name == each]
    if wanted != KEYFRAMES and not named:
        hint = did_you_mean(wanted[0], [name for name, _ in usable])
        raise DescriptionError(f"{file}: 'start' names keyframe {wanted[0]!r}, which is not there{hint}")
    return next(iter([*named, *(qpos for _, qpos in usable)]), None)


def upward(model: mujoco.MjModel, root: int, *, posed: bool = True) -> tuple[int, float] | None:
    """The coordinate of the root that lifts it, and the sign with which it does; a slide's only if `posed`."""
    first = int(model.body_jntadr[root])
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for joint in range(first, first + int(model.body_jntnum[root])):
        if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE:
            return int(model.jnt_qposadr[joint]) + 2, 1.0
        up = float(data.xaxis[joint, 2])
        if posed and model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE and abs(up) > _VERTICAL:
            return int(model.jnt_qposadr[joint]), float(np.sign(up))
    return None
