"""Gymnasium's interface to many environments of one robot, stepped together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from morphkit.description import Actuation
from morphkit.errors import ConfigError
from morphkit.morphology import Base
from morphkit.registry import load
from morphkit.tokens.names import LimbNames, Naming, TextStyle
from morphkit_rl.envs.gym_env import batch_of, control_rate, pictures, spaces
from morphkit_rl.envs.observation import Observation
from morphkit_rl.envs.robot import prepare
from morphkit_rl.envs.step import Step
from morphkit_rl.envs.tasks import Task


class MorphVectorEnv(gym.vector.VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """Many environments of one robot, stepped together.

    Infos are arrays with a mask each, as in Gymnasium's own vector environments: the forward speed `x_velocity`, m/s,
    and the terms of the reward; at the end of an episode its `return`, its `length`, and whether it ended because it
    `diverged`. With `autoreset_mode` `SAME_STEP`, the next episode starts in the step that ends one, and what the step
    led to is in `infos["final_obs"]` and `infos["final_info"]`; with `NEXT_STEP`, the step after it only starts the
    next episode; with `DISABLED`, `reset(options={"reset_mask": mask})` does.

    Args:
        robot: Shipped robot, recipe or path of a description file.
        num_envs: How many.
        observation: `fixed` or `legacy`.
        sensors: What is observed: quantities or sets of them, as `envs.robot.prepare` takes them; default: all.
        naming: How the tokens in `token_spec` are named; `limb_names` and `text_style` as in `morphkit.token_spec`.
        task: The task, its name or its TOML file; None takes the robot's own.
        base: How to attach a root without joints; None takes what the description says.
        actuation: How its motors are driven: `torque`, `position` or `as-file`; None takes what suits the robot.
        render_mode: `rgb_array` or None.
        num_threads: Threads that step; None: one a usable processor core.
        max_episode_steps: Control steps after which an episode is truncated; None takes the task's.
        autoreset_mode: When an episode that ended is followed by the next: an `AutoresetMode` or its value.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 50}  # noqa: RUF012

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
        task: str | Task | None = None,
        base: Base | None = None,
        actuation: Actuation | None = None,
        render_mode: str | None = None,
        num_threads: int | None = None,
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
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
        self._mode = _mode(autoreset_mode)
        same_step = self._mode == AutoresetMode.SAME_STEP
        self._batch = batch_of(
            own, num_envs, observation, max_episode_steps, autoreset=same_step, num_threads=num_threads
        )
        self.metadata = {**self.metadata, "render_fps": control_rate(own), "autoreset_mode": self._mode}
        self.num_envs = num_envs
        self.single_observation_space, self.single_action_space = spaces(self.token_spec)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.render_mode = render_mode
        self._seeded = False
        self._ended = np.zeros(num_envs, bool)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start all episodes anew, or those of the environments in `options["reset_mask"]`, bool (num_envs,).

        A seed, or a list of them, seeds all of them together; other options are ignored.

        Raises:
            ConfigError: The mask has another shape or type, or chooses no environment.
        """
        if seed is not None or not self._seeded:
            seeds = [seed] if seed is None or isinstance(seed, (int, np.integer)) else list(seed)
            entropy = [np.random.SeedSequence(value).generate_state(4).tolist() for value in seeds]
            self._batch.seed([number for numbers in entropy for number in numbers])
            self._seeded = True
        if options is None or "reset_mask" not in options:
            self._ended[:] = False
            return self._batch.reset()[0], {}
        mask = np.asarray(options["reset_mask"])
        if mask.dtype != bool or mask.shape != (self.num_envs,) or not mask.any():
            raise ConfigError(f"reset_mask must be {self.num_envs} booleans, one of them true")
        self._ended &= ~mask
        return self._batch.restart(0, np.flatnonzero(mask)), {}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Advance all environments by one control step; actions (num_envs, actuators) are clipped to their bounds.

        Raises:
            ValueError: An action of the wrong shape or not finite, or, with `DISABLED`, an episode that is over.
        """
        if not self._ended.any():
            waiting = np.zeros(self.num_envs, bool)
            step = self._batch.step([actions])
        elif self._mode == AutoresetMode.DISABLED:
            over = ", ".join(map(str, np.flatnonzero(self._ended)))
            raise ValueError(f"the episodes of environments {over} are over; reset them with options['reset_mask']")
        else:
            waiting = self._ended.copy()
            step = self._batch.step([np.where(waiting[:, None], 0.0, actions)])
        obs, reward, terminated, truncated = step.obs[0], step.reward[0], step.terminated[0], step.truncated[0]
        if waiting.any():
            obs = self._batch.restart(0, np.flatnonzero(waiting))
            reward, terminated, truncated = (
                np.where(waiting, 0, a).astype(a.dtype) for a in (reward, terminated, truncated)
            )
        ended = terminated | truncated
        infos = self._infos(step, ended, waiting)
        if self._mode != AutoresetMode.SAME_STEP:
            self._ended = ended
        return obs, reward, terminated, truncated, infos

    def _infos(self, step: Step, ended: np.ndarray, waiting: np.ndarray) -> dict[str, Any]:
        """Infos of environments that do not wait for their next episode; final ones where `SAME_STEP` ended one."""
        terms = self._batch.reward_terms(0)
        same_step = self._mode == AutoresetMode.SAME_STEP
        infos = _masked(terms, ~ended if same_step else ~waiting)
        if not ended.any():
            return infos
        over: dict[str, np.ndarray] = {
            "return": np.zeros(self.num_envs),
            "length": np.zeros(self.num_envs, np.int64),
            "diverged": np.zeros(self.num_envs, bool),
        }
        final_obs = np.full(self.num_envs, None, dtype=object)
        for episode in step.episodes:
            if ended[episode.env]:
                final_obs[episode.env] = step.final_obs[0][episode.env]
                over["return"][episode.env] = episode.episode_return
                over["length"][episode.env] = episode.length
                over["diverged"][episode.env] = episode.diverged
        if not same_step:
            return infos | _masked(over, ended)
        final = {"final_obs": final_obs, "final_info": _masked(terms | over, ended)}
        return infos | final | {f"_{key}": ended.copy() for key in final}

    def set_state(self, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
        """Put robots at qpos (num_envs, nq), qvel (num_envs, nv), where new episodes start; the observations there."""
        return self._batch.set_state(0, qpos, qvel)

    def state(self) -> tuple[np.ndarray, np.ndarray]:
        """(qpos (num_envs, nq), qvel (num_envs, nv)), float64."""
        return self._batch.state(0)

    def render(self) -> tuple[np.ndarray, ...] | None:  # type: ignore[override]
        """Pictures (height, width, 3), uint8, one an environment; None without a render mode."""
        return None if self.render_mode is None else tuple(pictures(self.simulation, self._batch))

    def close_extras(self, **kwargs: Any) -> None:
        """Stop the simulator's threads."""
        self._batch.close()


def _masked(values: Mapping[str, np.ndarray], mask: np.ndarray) -> dict[str, np.ndarray]:
    """Values, 0 where they do not hold, with masks of where they do."""
    return {key: np.where(mask, value, 0).astype(value.dtype) for key, value in values.items()} | {
        f"_{key}": mask.copy() for key in values
    }


def _mode(mode: AutoresetMode | str) -> AutoresetMode:
    """The mode of this value or name."""
    for known in AutoresetMode:
        if mode in (known, known.value, known.name, known.name.lower()):
            return known
    raise ConfigError(f"autoreset_mode must be one of {', '.join(m.value for m in AutoresetMode)}, not {mode!r}")
