"""Whether a model can be simulated when its motors are driven as hard as they can be, and at which time step."""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np

from morphkit.errors import DescriptionError
from morphkit.simulation.completion import URDF_TIMESTEP_S
from morphkit.simulation.mujoco_warnings import no_warnings

_TIMESTEPS_S = tuple(URDF_TIMESTEP_S / 2**times for times in range(5))
_DURATION_S = 8.0
_HOLDS_S = (0.01, 0.02, 0.04, 0.16, 0.64)
_STEPS = 10
_BROKEN = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)


def settle_timestep(spec: mujoco.MjSpec, model: mujoco.MjModel, start: np.ndarray, file: str) -> Iterator[str]:
    """Take the longest time step at which the model stays finite whatever its motors do.

    Vendors write effort limits that no motor has, such as 1000 N*m for a finger: no time step that suits the robot
    resolves them.

    Args:
        spec: Its time step is set.
        model: The same, compiled; its time step is set too.
        start: Coordinates of the start pose, (nq,).
        file: What the robot is called in messages.

    Yields:
        A sentence where that is not the usual time step.

    Raises:
        DescriptionError: The model diverges even if nothing drives it.
    """
    for timestep in _TIMESTEPS_S:
        model.opt.timestep = timestep
        if all(holds(model, start, hold) for hold in _HOLDS_S):
            break
    else:
        timestep = model.opt.timestep = URDF_TIMESTEP_S
        if not stays_finite(model, start):
            raise DescriptionError(f"{file}: the model diverges in its first steps; see 'morphkit check'")
        yield (
            "with all motors at full effort to and fro the robot diverges, at a time step of"
            f" {1000 * _TIMESTEPS_S[-1]:g} ms too: its effort limits are far too large for its masses"
        )
    if timestep != URDF_TIMESTEP_S:
        timestep = max(timestep / 2, _TIMESTEPS_S[-1])  # what just holds may not hold under other controls
        yield (
            f"the time step is {1000 * timestep:g} ms: at {1000 * URDF_TIMESTEP_S:g} ms the robot diverges with all"
            " motors at full effort to and fro; real effort limits would do more"
        )
    spec.option.timestep = model.opt.timestep = timestep


def stays_finite(model: mujoco.MjModel, start: np.ndarray) -> bool:
    """Whether the model stays finite in its first steps if nothing drives it."""
    return holds(model, start, None, duration=_STEPS * URDF_TIMESTEP_S)


def holds(model: mujoco.MjModel, start: np.ndarray, hold: float | None, duration: float = _DURATION_S) -> bool:
    """Whether the model stays finite with every control at one of its bounds, at random which.

    Args:
        model: The model; it stays as it is.
        start: Coordinates of the start pose, (nq,).
        hold: How long until the controls are drawn anew, s; None for no control.
        duration: How long to try, s.
    """
    flags = model.opt.disableflags
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_SENSOR  # they cost time and change nothing
    try:
        with no_warnings():
            return _holds(model, start, hold, duration)
    finally:
        model.opt.disableflags = flags


def _holds(model: mujoco.MjModel, start: np.ndarray, hold: float | None, duration: float) -> bool:
    data = mujoco.MjData(model)
    data.qpos[:] = start
    random = np.random.default_rng(0)
    bounded = model.actuator_ctrllimited.astype(bool)[:, None]
    low, high = np.where(bounded, model.actuator_ctrlrange, [-1.0, 1.0]).T
    every = max(1, round((hold or duration) / model.opt.timestep))
    for step in range(round(duration / model.opt.timestep)):
        if hold is not None and step % every == 0:
            data.ctrl[:] = np.where(random.random(model.nu) < 0.5, low, high)
        mujoco.mj_step(model, data)
        # MuJoCo starts anew after it has warned, so that the state alone tells nothing.
        if any(data.warning[each].number for each in _BROKEN):
            return False
    return bool(np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all())
