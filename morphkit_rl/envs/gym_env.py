"""Gymnasium's interface to one environment of one robot."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box

from morphkit.description import Actuation
from morphkit.errors import ConfigError
from morphkit.morphology import Base
from morphkit.registry import load
from morphkit.simulation.build import Simulation
from morphkit.tokens.names import LimbNames, Naming, TextStyle
from morphkit.tokens.spec import TokenSpec
from morphkit_rl.envs.batch_env import BatchEnv
from morphkit_rl.envs.observation import Observation
from morphkit_rl.envs.robot import Robot, prepare
from morphkit_rl.envs.tasks import Task

RENDER_SIZE = {"width": 480, "height": 360}


def spaces(spec: TokenSpec) -> tuple[Box, Box]:
    """Observation space (tokens,) and action space (actuators,) of a robot, float32.

    Observations are unbounded: joint angles leave their range a little. An action without bounds gets -1 to 1.
    """
    bounds = [(-1.0 if a.low is None else a.low, 1.0 if a.high is None else a.high) for a in spec.actuators]
    low, high = np.array(bounds, np.float32).reshape(-1, 2).T
    return Box(-np.inf, np.inf, (len(spec.sensors),), np.float32), Box(low, high, dtype=np.float32)


class MorphEnv(gym.Env[np.ndarray, np.ndarray]):
    """One robot: observation (tokens,) in token order, action (actuators,) in actuator order.

    >>> import gymnasium, morphkit_rl
    >>> env = gymnasium.make("morphkit/cheetah-v0")
    >>> obs, info = env.reset(seed=0)
    >>> env.action_space.shape
    (6,)

    Args:
        robot: Shipped robot, recipe or path of a description file.
        observation: `fixed` or `legacy`.
        sensors: What is observed: quantities or sets of them, as `envs.robot.prepare` takes them; default: all.
        naming: How the tokens in `token_spec` are named; `limb_names` and `text_style` as in `morphkit.token_spec`.
        task: The task, its name or its TOML file; None takes the robot's own.
        base: How to attach a root without joints; None takes what the description says.
        actuation: How its motors are driven: `torque`, `position` or `as-file`; None takes what suits the robot.
        render_mode: `rgb_array` or None.
        max_episode_steps: Control steps after which an episode is truncated; None takes the task's.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 50}  # noqa: RUF012

    def __init__(
        self,
        robot: str | Path,
        *,
        observation: Observation = "fixed",
        sensors: Sequence[str] = (),
        naming: Naming = "raw",
        limb_names: LimbNames = "body",
        text_style: TextStyle = "words",
        task: str | Task | None = None,
        base: Base | None = None,
        actuation: Actuation | None = None,
        render_mode: str | None = None,
        max_episode_steps: int | None = None,
    ) -> None:
        own = prepare(
            load(robot),
            naming,
            task=task,
            base=base,
            sensors=sensors,
            limb_names=limb_names,
            text_style=text_style,
            actuation=actuation,
        )
        self.simulation, self.token_spec = own.simulation, own.spec
        self._batch = batch_of(own, 1, observation, max_episode_steps, autoreset=False, num_threads=1)
        self.metadata = {**self.metadata, "render_fps": control_rate(own)}
        self.observation_space, self.action_space = spaces(self.token_spec)
        self.render_mode = render_mode
        self._seeded = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an episode; `options` are ignored."""
        super().reset(seed=seed)
        if seed is not None or not self._seeded:
            self._batch.seed(self.np_random.integers(2**32, size=4).tolist())
            self._seeded = True
        return self._batch.reset()[0][0], {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Advance by one control step; the action is clipped to its bounds.

        The info has the forward speed `x_velocity`, m/s, and the terms of the reward (`reward_forward`, `reward_alive`,
        `reward_control`, `reward_tip`); in an episode's last step also its `return`, its `length`, and whether it ended
        because it `diverged`.
        """
        step = self._batch.step([np.asarray(action)[None]])
        info: dict[str, Any] = {name: float(value[0]) for name, value in self._batch.reward_terms(0).items()}
        for episode in step.episodes:
            info |= {"return": episode.episode_return, "length": episode.length, "diverged": episode.diverged}
        return (
            step.final_obs[0][0],
            float(step.reward[0][0]),
            bool(step.terminated[0][0]),
            bool(step.truncated[0][0]),
            info,
        )

    def set_state(self, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
        """Put the robot at qpos (nq,), qvel (nv,), where a new episode starts; the observation there."""
        return self._batch.set_state(0, np.asarray(qpos)[None], np.asarray(qvel)[None])[0]

    def state(self) -> tuple[np.ndarray, np.ndarray]:
        """(qpos (nq,), qvel (nv,)), float64."""
        qpos, qvel = self._batch.state(0)
        return qpos[0], qvel[0]

    def render(self) -> np.ndarray | None:  # type: ignore[override]
        """A picture (height, width, 3), uint8; None without a render mode."""
        return None if self.render_mode is None else pictures(self.simulation, self._batch)[0]

    def close(self) -> None:
        """Stop the simulator's threads."""
        self._batch.close()


def unlimited(robot: str | Path, **settings: Any) -> MorphEnv:
    """A `MorphEnv` that never truncates an episode: `gymnasium.make` puts its own time limit around it."""
    return MorphEnv(robot, **settings, max_episode_steps=sys.maxsize)


def batch_of(
    robot: Robot,
    num_envs: int,
    observation: Observation,
    max_episode_steps: int | None,
    *,
    autoreset: bool,
    num_threads: int | None,
) -> BatchEnv:
    """Environments of one robot, with episodes of the task's length unless another is given.

    Raises:
        ConfigError: `max_episode_steps` is below 1.
    """
    if max_episode_steps is not None and max_episode_steps < 1:
        raise ConfigError(f"max_episode_steps must be at least 1, not {max_episode_steps}")
    task = robot.task if max_episode_steps is None else replace(robot.task, episode_length=max_episode_steps)
    return BatchEnv(
        [robot.simulation],
        [task],
        num_envs,
        specs=[robot.spec],
        observation=observation,
        num_threads=num_threads,
        autoreset=autoreset,
    )


def control_rate(robot: Robot) -> int:
    """Control steps per second."""
    return round(1 / ((robot.task.frame_skip or 1) * robot.simulation.model.opt.timestep))


def pictures(simulation: Simulation, batch: BatchEnv) -> np.ndarray:
    """Pictures of all environments, uint8 (n, height, width, 3)."""
    from morphkit.viewer.render import render

    return render(simulation, batch.state(0)[0], **RENDER_SIZE)
