"""Whether a model can be simulated when its motors are driven as hard as they can be, and at which time step."""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np

from morphkit.completion import URDF_TIMESTEP_S
from morphkit.errors import DescriptionError
from morphkit.quiet import no_warnings

_TIMESTEPS_S = (URDF_TIMESTEP_S, URDF_TIMESTEP_S / 2, URDF_TIMESTEP_S / 4, URDF_TIMESTEP_S / 8)
_DURATION_S, _HOLD_S, _TRIALS = 2.0, 0.04, 2
_STEPS = 10
_BROKEN = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)


def settle_timestep(spec: mujoco.MjSpec, model: mujoco.MjModel, file: str) -> Iterator[str]:
    """Take the longest time step at which random controls within the motors' bounds let the model stay finite.

    Vendors write effort limits that no motor has, such as 1000 N*m for a finger: no time step that suits the robot
    resolves them.

    Args:
        spec: Its time step is set.
        model: The same, compiled; its time step is set too.
        file: What the robot is called in messages.

    Yields:
        A sentence where that is not the usual time step.

    Raises:
        DescriptionError: The model diverges even if nothing drives it.
    """
    for timestep in _TIMESTEPS_S:
        spec.option.timestep = model.opt.timestep = timestep
        if all(holds(model, seed) for seed in range(_TRIALS)):
            if timestep != URDF_TIMESTEP_S:
                yield (
                    f"the time step is {1000 * timestep:g} ms: with all motors at random within their bounds the robot"
                    f" diverges at {2000 * timestep:g} ms; real effort limits would do more"
                )
            return
    spec.option.timestep = model.opt.timestep = URDF_TIMESTEP_S
    if not holds(model, seed=None, duration=_STEPS * URDF_TIMESTEP_S):
        raise DescriptionError(f"{file}: the converted model diverges in its first steps; see 'morphkit check'")
    yield (
        "with all motors at random within their bounds the robot diverges, at"
        f" {1000 * _TIMESTEPS_S[-1]:g} ms too: its effort limits are far too large for its masses"
    )


def holds(model: mujoco.MjModel, seed: int | None, duration: float = _DURATION_S) -> bool:
    """Whether the model stays finite.

    Args:
        model: The model; it stays as it is.
        seed: Of the controls, which change every 40 ms; None for no control.
        duration: How long, s.
    """
    with no_warnings():
        return _holds(model, seed, duration)


def _holds(model: mujoco.MjModel, seed: int | None, duration: float) -> bool:
    data = mujoco.MjData(model)
    random = np.random.default_rng(seed)
    bounded = model.actuator_ctrllimited.astype(bool)[:, None]
    low, high = np.where(bounded, model.actuator_ctrlrange, [-1.0, 1.0]).T
    every = max(1, round(_HOLD_S / model.opt.timestep))
    for step in range(round(duration / model.opt.timestep)):
        if seed is not None and step % every == 0:
            data.ctrl[:] = random.uniform(low, high)
        mujoco.mj_step(model, data)
        # MuJoCo starts anew after it has warned, so that the state alone tells nothing.
        if any(data.warning[each].number for each in _BROKEN):
            return False
    return bool(np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all())
