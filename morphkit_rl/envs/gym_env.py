"""Gymnasium's interfaces to one robot: a single environment and a batched one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from morphkit.morphology import Base
from morphkit.registry import load
from morphkit.simulation.build import Simulation
from morphkit.tokens.names import LimbNames, Naming, TextStyle
from morphkit.tokens.spec import TokenSpec
from morphkit_rl.envs.batch_env import BatchEnv
from morphkit_rl.envs.observation import Observation
from morphkit_rl.envs.robot import Robot, prepare

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
        sensors: Quantities that are observed, such as `position`, or `no_ltv`: all but `type`; default: all.
        naming: How the tokens in `token_spec` are named; `limb_names` and `text_style` as in `morphkit.token_spec`.
        task: Name of the task; None takes the robot's own.
        base: How to attach a root without joints; None takes what the description says.
        render_mode: `rgb_array` or None.
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
        task: str | None = None,
        base: Base | None = None,
        render_mode: str | None = None,
    ) -> None:
        own = prepare(
            load(robot), naming, task=task, base=base, sensors=sensors, limb_names=limb_names, text_style=text_style
        )
        self.simulation, self.token_spec = own.simulation, own.spec
        self._batch = _batch(own, 1, observation, autoreset=False, num_threads=1)
        self.metadata = {**self.metadata, "render_fps": _control_rate(own)}
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

        The info of an episode's last step has its `return`, its `length`, and whether it ended because it `diverged`.
        """
        step = self._batch.step([np.asarray(action)[None]])
        info = {}
        for episode in step.episodes:
            info = {"return": episode.episode_return, "length": episode.length, "diverged": episode.diverged}
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
        return None if self.render_mode is None else _pictures(self.simulation, self._batch)[0]

    def close(self) -> None:
        """Stop the simulator's threads."""
        self._batch.close()


class MorphVectorEnv(gym.vector.VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """Many environments of one robot, stepped together; an episode that ends restarts in the same step.

    `infos["final_obs"]` and `infos["final_info"]` then hold what the step led to, with the masks `_final_obs` and
    `_final_info`, as in Gymnasium's own vector environments; `final_info` has the episode's `return`, its `length`, and
    whether it ended because it `diverged`.

    Args:
        robot: Shipped robot, recipe or path of a description file.
        num_envs: How many.
        observation: `fixed` or `legacy`.
        sensors: Quantities that are observed, such as `position`, or `no_ltv`: all but `type`; default: all.
        naming: How the tokens in `token_spec` are named; `limb_names` and `text_style` as in `morphkit.token_spec`.
        task: Name of the task; None takes the robot's own.
        base: How to attach a root without joints; None takes what the description says.
        render_mode: `rgb_array` or None.
        num_threads: Threads that step; None: one a usable processor core.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": ["rgb_array"],
        "render_fps": 50,
        "autoreset_mode": AutoresetMode.SAME_STEP,
    }

    def __init__(
        self,
        robot: str | Path,
        num_envs: int = 1,
        *,
        observation: Observation = "fixed",
        sensors: Sequence[str] = (),
        naming: Naming = "raw",
        limb_names: LimbNames = "body",
        text_style: TextStyle = "words",
        task: str | None = None,
        base: Base | None = None,
        render_mode: str | None = None,
        num_threads: int | None = None,
    ) -> None:
        own = prepare(
            load(robot), naming, task=task, base=base, sensors=sensors, limb_names=limb_names, text_style=text_style
        )
        self.simulation, self.token_spec = own.simulation, own.spec
        self._batch = _batch(own, num_envs, observation, autoreset=True, num_threads=num_threads)
        self.metadata = {**self.metadata, "render_fps": _control_rate(own)}
        self.num_envs = num_envs
        self.single_observation_space, self.single_action_space = spaces(self.token_spec)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.render_mode = render_mode
        self._seeded = False

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start all episodes anew; `options` are ignored. A seed, or a list of them, seeds all of them together."""
        if seed is not None or not self._seeded:
            seeds = [seed] if seed is None or isinstance(seed, (int, np.integer)) else list(seed)
            entropy = [np.random.SeedSequence(value).generate_state(4).tolist() for value in seeds]
            self._batch.seed([number for numbers in entropy for number in numbers])
            self._seeded = True
        return self._batch.reset()[0], {}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Advance all environments by one control step; actions (num_envs, actuators) are clipped to their bounds."""
        step = self._batch.step([actions])
        infos: dict[str, Any] = {}
        if step.episodes:
            ended = step.terminated[0] | step.truncated[0]
            final_obs = np.full(self.num_envs, None, dtype=object)
            final_info: dict[str, np.ndarray] = {
                "return": np.zeros(self.num_envs),
                "length": np.zeros(self.num_envs, np.int64),
                "diverged": np.zeros(self.num_envs, bool),
            }
            for episode in step.episodes:
                final_obs[episode.env] = step.final_obs[0][episode.env]
                final_info["return"][episode.env] = episode.episode_return
                final_info["length"][episode.env] = episode.length
                final_info["diverged"][episode.env] = episode.diverged
            final_info |= {f"_{key}": ended.copy() for key in final_info}
            infos = {
                "final_obs": final_obs,
                "_final_obs": ended.copy(),
                "final_info": final_info,
                "_final_info": ended.copy(),
            }
        return step.obs[0], step.reward[0], step.terminated[0], step.truncated[0], infos

    def set_state(self, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
        """Put robots at qpos (num_envs, nq), qvel (num_envs, nv), where new episodes start; the observations there."""
        return self._batch.set_state(0, qpos, qvel)

    def state(self) -> tuple[np.ndarray, np.ndarray]:
        """(qpos (num_envs, nq), qvel (num_envs, nv)), float64."""
        return self._batch.state(0)

    def render(self) -> tuple[np.ndarray, ...] | None:  # type: ignore[override]
        """Pictures (height, width, 3), uint8, one an environment; None without a render mode."""
        return None if self.render_mode is None else tuple(_pictures(self.simulation, self._batch))

    def close_extras(self, **kwargs: Any) -> None:
        """Stop the simulator's threads."""
        self._batch.close()


def _batch(
    robot: Robot, num_envs: int, observation: Observation, *, autoreset: bool, num_threads: int | None
) -> BatchEnv:
    return BatchEnv(
        [robot.simulation],
        [robot.task],
        num_envs,
        specs=[robot.spec],
        observation=observation,
        num_threads=num_threads,
        autoreset=autoreset,
    )


def _control_rate(robot: Robot) -> int:
    """Control steps per second."""
    return round(1 / ((robot.task.frame_skip or 1) * robot.simulation.model.opt.timestep))


def _pictures(simulation: Simulation, batch: BatchEnv) -> np.ndarray:
    from morphkit.viewer.render import render

    return render(simulation, batch.state(0)[0], **RENDER_SIZE)
