"""Environments whose simulation has diverged: found, and put back to where they were."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from morphkit_rl.envs.stepping import SteppedRobot

STATE_BOUND = 1e6
"""Bound of coordinates and velocities, m, rad, m/s, rad/s: a simulator step of 0.1 ms at an acceleration that MuJoCo
calls bad, 1e10, leads here."""


class Divergence:
    """Watches all environments of all robots.

    An environment diverges where a coordinate or velocity is beyond `STATE_BOUND`, where anything is not finite, or
    where simulator steps are missing: `mujoco.rollout` leaves out the rest of a control step once MuJoCo warns, such as
    for lack of memory for contacts. Activations may be large, such as a filtered force in N.

    Args:
        robots: Robots whose `state` is set.
        state_start: Where in the flat state vector each environment of each robot starts, one int (n,) a robot; there
            is its time.
    """

    def __init__(self, robots: Sequence[SteppedRobot], state_start: Sequence[np.ndarray]) -> None:
        self._robots = robots
        self._time = np.concatenate(state_start)
        durations = [(robot.frame_skip - 0.5) * robot.model.opt.timestep for robot in robots]
        self._most_of_step = np.repeat(durations, [len(start) for start in state_start])

    def undo(self, state: np.ndarray, before: np.ndarray) -> np.ndarray | None:
        """Put diverged environments back to `before`.

        Args:
            state: Flat states after a control step, of which the robots' are views; changed in place.
            before: Flat states before it.

        Returns:
            Which environments had diverged, bool (environments,); None where none had.
        """
        diverged = state.take(self._time) - before.take(self._time) < self._most_of_step
        if np.abs(state).max(initial=0.0) < STATE_BOUND and not diverged.any():  # False for NaN
            return None
        env = first = 0
        for robot in self._robots:
            n, size = robot.state.shape
            moving = robot.state[:, 1 : 1 + robot.nq + robot.nv]
            mine = diverged[env : env + n]
            mine |= ~((np.abs(moving) < STATE_BOUND).all(axis=1) & np.isfinite(robot.state).all(axis=1))
            robot.state[mine] = before[first : first + n * size].reshape(n, size)[mine]
            env, first = env + n, first + n * size
        return diverged if diverged.any() else None
