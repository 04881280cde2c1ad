"""Many environments of many robots, stepped together on MuJoCo's thread pool."""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from morphkit.errors import ConfigError
from morphkit.simulation.build import Simulation
from morphkit.tokens.spec import TokenSpec
from morphkit_rl.envs.batch_checks import check_robots
from morphkit_rl.envs.divergence import Divergence
from morphkit_rl.envs.episode_counters import EpisodeCounters
from morphkit_rl.envs.observation import Observation, ObservationPass
from morphkit_rl.envs.reward import RewardPass
from morphkit_rl.envs.step import Step
from morphkit_rl.envs.stepping import SteppedRobot, Stepper
from morphkit_rl.envs.task_pass import TaskPass
from morphkit_rl.envs.task_settings import Task


class BatchEnv:
    """Environments of several robots with different numbers of tokens and actuators.

    A step is `mujoco.rollout` for the physics and once more for the sensors, shared between threads, and one numpy pass
    over all robots for observations, rewards and endings. Robots share nothing: each draws its resets from a generator
    of its own, seeded by `seed` and its name, so what happens to it depends neither on the others nor on threads.

    Args:
        simulations: The robots.
        tasks: The task of each, from `task_for`.
        num_envs: Environments of each robot, or one number for all.
        specs: What to observe of each robot: its tokens or some of them, under any names; default: all of them.
        observation: `fixed`, or `legacy` with the published code's defects.
        seed: Seeds the start states.
        num_threads: Threads that step; None: one a usable processor core.
        autoreset: Whether a new episode starts in the step that ends one. Without, environments stay where they ended.

    Attributes:
        specs: TokenSpec of each robot.
        diverged: Episodes that ended because the simulation diverged (see `Divergence`), int64 (robots,).

    Raises:
        ConfigError: No robots, lists of different lengths, a task that `task_for` has not filled in, or a specification
            that is not its robot's.
    """

    def __init__(
        self,
        simulations: Sequence[Simulation],
        tasks: Sequence[Task],
        num_envs: int | Sequence[int],
        *,
        specs: Sequence[TokenSpec] | None = None,
        observation: Observation = "fixed",
        seed: int = 0,
        num_threads: int | None = None,
        autoreset: bool = True,
    ) -> None:
        self.autoreset = autoreset
        self.num_envs = [num_envs] * len(simulations) if isinstance(num_envs, int) else list(num_envs)
        self.simulations, self.tasks = list(simulations), list(tasks)
        self.specs = [simulation.tokens for simulation in simulations] if specs is None else list(specs)
        check_robots(self.simulations, self.tasks, self.num_envs, self.specs, observation)
        self.diverged = np.zeros(len(simulations), np.int64)
        self._robots = [SteppedRobot(*robot) for robot in zip(simulations, tasks, self.num_envs, strict=True)]
        sizes = [robot.start.size for robot in self._robots]
        states = _slices([n * size for n, size in zip(self.num_envs, sizes, strict=True)])
        self._state = np.concatenate([np.tile(robot.start, len(robot.ctrl)) for robot in self._robots])
        starts = [np.arange(part.start, part.stop, size) for part, size in zip(states, sizes, strict=True)]
        self._divergence = Divergence(self._robots, starts)
        self._observe_all = ObservationPass(simulations, self.specs, starts, observation)
        rows = _slices([n * len(s.limb_body) for n, s in zip(self.num_envs, simulations, strict=True)])
        for robot, part, mine, n in zip(self._robots, states, rows, self.num_envs, strict=True):
            robot.state = self._state[part].reshape(n, -1)
            robot.sensors = self._observe_all.sensors[mine].reshape(n, 1, -1)
        self._tasks = TaskPass(simulations, tasks, self.specs, self._robots, self._observe_all.others)
        self._reward = RewardPass(simulations, tasks, starts, self._observe_all.roots, self._observe_all.sensors)
        self._envs = _slices(self.num_envs)
        self._obs = _slices([n * len(spec.sensors) for n, spec in zip(self.num_envs, self.specs, strict=True)])
        self._ctrl = _slices([n * len(spec.actuators) for n, spec in zip(self.num_envs, self.specs, strict=True)])
        bounds = [np.tile(robot.bounds, len(robot.ctrl)) for robot in self._robots]
        self._ctrl_low, self._ctrl_high = np.concatenate(bounds, axis=1)
        self._counters = EpisodeCounters(self._envs, [task.episode_length for task in tasks])
        self._stepper = Stepper(self._robots, num_threads or len(os.sched_getaffinity(0)))
        self._stepper.sense()
        self.seed(seed)

    @property
    def num_robots(self) -> int:
        """How many robots there are."""
        return len(self._robots)

    def seed(self, seed: int | Sequence[int]) -> None:
        """Seed the start states anew; takes effect at the next reset."""
        entropy = [seed] if isinstance(seed, (int, np.integer)) else list(seed)
        names = [simulation.name for simulation in self.simulations]
        self._rngs = [
            np.random.default_rng([*entropy, zlib.crc32(name.encode()), names[:i].count(name)])
            for i, name in enumerate(names)
        ]

    def reset(self, elapsed: np.ndarray | Sequence[np.ndarray] | None = None) -> list[np.ndarray]:
        """Start all episodes anew.

        Args:
            elapsed: For each robot, control steps (n,) that count as done already, so that episodes are truncated
                sooner; default: none.

        Returns:
            Observations, one float32 (n, tokens) a robot.
        """
        for i, n in enumerate(self.num_envs):
            self._draw_start(i, np.arange(n))
        self._counters.restart(slice(None), 0 if elapsed is None else np.concatenate(elapsed))
        return self.observe()

    def observe(self) -> list[np.ndarray]:
        """Observations of the current states, one float32 (n, tokens) a robot."""
        self._stepper.sense()
        return self._split_obs(self._observe())

    def step(self, actions: Sequence[np.ndarray]) -> Step:
        """Advance every environment by one control step; where an episode ends, the next one starts at once.

        Args:
            actions: One (n, actuators) a robot, in the actuators' own units; clipped to their bounds.

        Raises:
            ValueError: An action of the wrong shape or not finite.
            DescriptionError: MuJoCo cannot go on at all, such as for lack of memory.
        """
        ctrl = self._controls(actions)
        self._tasks.before(self._rngs)
        before, forward = self._state.copy(), self._reward.forward(self._state)
        for robot, mine in zip(self._robots, self._ctrl, strict=True):
            robot.ctrl[:] = ctrl[mine].reshape(len(robot.ctrl), 1, -1)
        self._stepper.advance_and_sense()
        diverged = self._divergence.undo(self._state, before)
        if diverged is not None:
            self._stepper.sense()
        reward, terminated = self._reward(forward, self._state, ctrl)
        rewards, ended = ([values[mine] for mine in self._envs] for values in (reward, terminated))
        self._tasks.add(rewards, ended, [ctrl[mine] for mine in self._ctrl], self._rngs)
        final = self._observe()
        if diverged is not None:
            reward[diverged], terminated[diverged] = 0.0, True
            self.diverged += [int(diverged[mine].sum()) for mine in self._envs]
        truncated = self._counters.add(reward) & ~terminated
        done = terminated | truncated
        episodes = self._counters.end(done, diverged)
        obs = self._restart(done) if episodes and self.autoreset else final
        final_obs = self._split_obs(final)
        return Step(
            obs=final_obs if obs is final else self._split_obs(obs),
            final_obs=final_obs,
            reward=[reward[mine] for mine in self._envs],
            terminated=[terminated[mine] for mine in self._envs],
            truncated=[truncated[mine] for mine in self._envs],
            episodes=episodes,
        )

    def restart(self, robot: int, which: np.ndarray) -> np.ndarray:
        """Start new episodes in a robot's environments `which`, int (k,); all its observations, float32 (n, tokens)."""
        self._draw(robot, which)
        self._counters.restart(self._envs[robot].start + which)
        return self._split_obs(self._observe())[robot]

    def reward_terms(self, robot: int) -> dict[str, np.ndarray]:
        """What a robot's latest rewards are sums of, float64 (n,) each, and its forward speed `x_velocity`, m/s.

        Where the simulation diverged, the reward is 0, whatever the terms are.
        """
        mine, terms, own = self._envs[robot], self._reward.terms(), self._tasks.terms(robot)
        if own is not None:
            return {"x_velocity": terms["x_velocity"][mine], **own}
        return {name: values[mine] for name, values in terms.items()}

    def set_state(self, robot: int, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
        """Put a robot's environments into given states; episodes start anew there.

        Args:
            robot: Index of the robot.
            qpos: (n, nq), m and rad.
            qvel: (n, nv), m/s and rad/s.

        Returns:
            The observations there, float32 (n, tokens).
        """
        own = self._robots[robot]
        for name, value, target in (("qpos", qpos, own.qpos), ("qvel", qvel, own.qvel)):
            if np.shape(value) != target.shape:
                raise ValueError(f"{name} must have shape {target.shape}, not {np.shape(value)}")
            if not np.isfinite(value).all():
                raise ValueError(f"{name} must be finite")
        own.state[:] = own.start
        own.qpos[:], own.qvel[:] = qpos, qvel
        self._tasks.restart(robot, self._rngs[robot], np.arange(len(own.state)))
        self._counters.restart(self._envs[robot])
        return self.observe()[robot]

    def state(self, robot: int) -> tuple[np.ndarray, np.ndarray]:
        """Copies of a robot's (qpos (n, nq), qvel (n, nv)), float64."""
        return self._robots[robot].qpos.copy(), self._robots[robot].qvel.copy()

    def state_dict(self) -> dict[str, np.ndarray]:
        """Everything that an exact continuation needs, as arrays; `observe` gives the observations back."""
        generators = [[s.name, rng.bit_generator.state] for s, rng in zip(self.simulations, self._rngs, strict=True)]
        return {
            **self._tasks.memory(),
            "state": self._state.copy(),
            "return": self._counters.returns.copy(),
            "length": self._counters.lengths.copy(),
            "diverged": self.diverged.copy(),
            "generators": np.frombuffer(json.dumps(generators).encode(), np.uint8).copy(),
        }

    def load_state_dict(self, state: dict[str, np.ndarray]) -> None:
        """Continue exactly where `state_dict` was taken, by the same robots and numbers of environments.

        Raises:
            ConfigError: It was taken from other robots or numbers of environments.
        """
        returns, lengths = self._counters.returns, self._counters.lengths
        own = {"state": self._state, "return": returns, "length": lengths, "diverged": self.diverged}
        own |= (memory := self._tasks.memory())
        for key, target in own.items():
            if key not in state or np.shape(state[key]) != target.shape:
                raise ConfigError(f"environment state {key!r} does not fit these robots and numbers of environments")
        generators = json.loads(bytes(np.asarray(state["generators"], np.uint8)).decode())
        if [name for name, _ in generators] != [simulation.name for simulation in self.simulations]:
            names = ", ".join(name for name, _ in generators)
            raise ConfigError(f"environment state does not fit these robots: it belongs to {names}")
        for key, target in own.items():
            target[:] = state[key]
        for rng, (_, generator) in zip(self._rngs, generators, strict=True):
            rng.bit_generator.state = generator
        self._tasks.restore(memory)
        self._stepper.sense()

    def close(self) -> None:
        """Stop the threads."""
        self._stepper.close()

    def _controls(self, actions: Sequence[np.ndarray]) -> np.ndarray:
        """All controls, clipped, flat."""
        for robot, action, spec in zip(self._robots, actions, self.specs, strict=True):
            shape = (len(robot.state), robot.ctrl.shape[2])
            if np.shape(action) != shape:
                raise ValueError(f"{spec.morphology}: actions must have shape {shape}, not {np.shape(action)}")
        flat = np.concatenate([np.asarray(action, np.float64).reshape(-1) for action in actions])
        if not np.isfinite(flat).all():
            raise ValueError("actions must be finite")
        return np.clip(flat, self._ctrl_low, self._ctrl_high, out=flat)

    def _restart(self, done: np.ndarray) -> np.ndarray:
        """Draw new start states where `done`; flat observations with theirs in place."""
        for i, mine in enumerate(self._envs):
            which = np.flatnonzero(done[mine])
            if len(which):
                self._draw(i, which)
        return self._observe()

    def _draw(self, robot: int, which: np.ndarray) -> None:
        self._draw_start(robot, which)
        self._stepper.sense_some(self._robots[robot], which)

    def _draw_start(self, robot: int, which: np.ndarray) -> None:
        own = self._robots[robot]
        own.state[which] = own.draw_start(self._rngs[robot], self.tasks[robot], len(which))
        self._tasks.restart(robot, self._rngs[robot], which)

    def _observe(self) -> np.ndarray:
        """Flat observations of the current states."""
        self._tasks.observe()
        return self._observe_all(self._state)

    def _split_obs(self, flat: np.ndarray) -> list[np.ndarray]:
        return [flat[mine].reshape(n, -1) for mine, n in zip(self._obs, self.num_envs, strict=True)]


def _slices(sizes: Sequence[int]) -> list[slice]:
    """Where parts of these sizes lie, one behind the other."""
    ends = np.cumsum([0, *sizes]).tolist()
    return [slice(first, last) for first, last in pairwise(ends)]
