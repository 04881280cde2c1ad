"""What tasks with terms do in every step: pushes, rewards, commands, targets, and what of them is observed."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

import numpy as np

from morphkit.errors import ConfigError
from morphkit.simulation.build import Simulation
from morphkit.tokens.proprioception import DECLARED
from morphkit.tokens.quantities import quantity_names
from morphkit.tokens.records import SensorToken
from morphkit.tokens.spec import TokenSpec
from morphkit_rl.envs.randomization import Variants, draw_factors
from morphkit_rl.envs.reward_terms import TERMS
from morphkit_rl.envs.robot_arrays import RobotArrays
from morphkit_rl.envs.stepping import SteppedRobot
from morphkit_rl.envs.task_settings import Task
from morphkit_rl.envs.tip import Targets


class RobotPass:
    """One robot's part, over all its environments.

    Args:
        simulation: The robot.
        task: Its task.
        spec: What is observed of it.
        stepped: Its states and models.
        out: Where observations that are no limb's sensors go, float32 (n, tokens).

    Attributes:
        arrays: What terms see.
        terms: Latest value of each term times its weight, float64 (n,) each.
    """

    def __init__(
        self, simulation: Simulation, task: Task, spec: TokenSpec, stepped: SteppedRobot, out: np.ndarray
    ) -> None:
        self.task, self._stepped, self._out = task, stepped, out
        sensors = stepped.sensors.reshape(-1, stepped.sensors.shape[-1])
        self.arrays = RobotArrays(simulation, task, stepped, sensors)
        self.terms: dict[str, np.ndarray] = {term.name: np.zeros(len(stepped.state)) for term in task.terms}
        self._functions = [(TERMS[term.name], term, dict(term.settings)) for term in task.terms]
        self._targets = Targets(simulation) if task.reach else None
        self._variants = Variants(stepped, int(simulation.limb_body[0])) if task.randomize.any else None
        self._groups = [(q, len(list(each))) for q, each in groupby(spec.sensors, _source) if q is not None]
        declared = {token.quantity for token in spec.sensors if _source(token) == DECLARED}
        if declared:
            stepped.sense_declared(simulation, declared)
        rate = 1 / self.arrays.dt
        self._push_steps = round(task.pushes.seconds * rate)
        self._command_steps = round(task.commands.seconds * rate) if task.commands else 0
        self._target_steps = round(task.reach_seconds * rate)
        self._can_be_pushed = simulation.base != "fixed"
        first = int(simulation.model.jnt_dofadr[simulation.base_joints[0]]) if simulation.base_joints else 0
        self._pushed = slice(first, first + (1 if simulation.base == "planar" else 2))

    def before(self, rng: np.random.Generator) -> None:
        """Push whoever is due before a step."""
        if not (self._push_steps and self._can_be_pushed):
            return
        age = self.arrays.age[:, 0].astype(np.int64)
        which = np.flatnonzero((age > 0) & (age % self._push_steps == 0))
        if len(which):
            speed = self.task.pushes.speed
            width = self._pushed.stop - self._pushed.start
            self._stepped.qvel[which, self._pushed] += rng.uniform(-speed, speed, (len(which), width))

    def reward(self, ctrl: np.ndarray, ended: np.ndarray) -> np.ndarray:
        """Sum of the weighted terms, float64 (n,), after a step with flat controls; who fell in it, bool (n,)."""
        self.arrays.remember(ctrl.reshape(len(ended), -1), ended)
        total = np.zeros(len(ended))
        for function, term, settings in self._functions:
            value = np.asarray(function(self.arrays, **settings), float)
            if value.shape != total.shape:
                raise ConfigError(
                    f"term {term.name!r} gave an array of shape {value.shape}; expected one number for each of"
                    f" {len(total)} environments"
                )
            self.terms[term.name] = term.weight * value
            total += self.terms[term.name]
        self.arrays.settle()
        return total

    def command_anew(self, rng: np.random.Generator) -> None:
        """Draw commands and targets that are due to change within an episode."""
        age = self.arrays.age[:, 0]
        if self._command_steps:
            self._draw_commands(rng, np.flatnonzero(age % self._command_steps == 0))
        if self._target_steps:
            self._draw_targets(rng, np.flatnonzero(age % self._target_steps == 0))

    def restart(self, rng: np.random.Generator, which: np.ndarray) -> None:
        """Begin episodes in environments `which`, int (k,), whose start states are drawn."""
        self.arrays.forget(which)
        self._draw_commands(rng, which)
        self._draw_targets(rng, which)
        if self._variants is not None:
            self.arrays.factors[which] = draw_factors(rng, self.task.randomize, len(which))
            self._variants.apply(which, self.arrays.factors[which])

    def observe(self) -> None:
        """Write what is observed besides the limbs' sensors."""
        self.arrays.refresh()
        if self.task.commands is not None and self.task.commands.heading:
            self.arrays.command[:, 2] = (-self.task.commands.heading * self.arrays.heading).clip(-1, 1)
        column = 0
        for quantity, width in self._groups:
            self._out[:, column : column + width] = _SOURCES[quantity](self.arrays)
            column += width

    def restore(self, memory: np.ndarray) -> None:
        """Go on from where `arrays.memory` was `memory`."""
        self.arrays.memory[:] = memory
        if self._variants is not None:
            self._variants.apply(np.arange(len(memory)), self.arrays.factors)

    def _draw_targets(self, rng: np.random.Generator, which: np.ndarray) -> None:
        if self._targets is not None and len(which):
            self.arrays.target[which] = self._targets.draw(rng, self._stepped.qpos[which])

    def _draw_commands(self, rng: np.random.Generator, which: np.ndarray) -> None:
        commands = self.task.commands
        if commands is not None and len(which):
            low, high = np.array([commands.x, commands.y, commands.yaw]).T
            self.arrays.command[which] = rng.uniform(low, high, (len(which), 3))


_SOURCES = {
    "gravity": lambda robot: robot.gravity,
    "body_rotational_velocity": lambda robot: robot.rotational_velocity,
    "joint_velocity": lambda robot: robot.joint_speed,
    "previous_action": lambda robot: robot.action,
    "command": lambda robot: robot.command,
    "target": lambda robot: robot.to_target,
    DECLARED: lambda robot: robot.declared,
}
"""Where the values of quantities come from that no limb senses."""


def _source(token: SensorToken) -> str | None:
    """Where the value of a token comes from; None for what limbs and joints sense."""
    if token.quantity in quantity_names():
        return None
    return token.quantity if token.quantity in _SOURCES else DECLARED


class TaskPass:
    """The parts of all robots; those without terms whose limbs' sensors alone are observed have none.

    Args:
        simulations: The robots.
        tasks: Their tasks.
        specs: What is observed of each.
        stepped: Their states and models.
        outs: Where observations that are no limb's sensors go, one float32 (n, tokens) a robot.
    """

    def __init__(
        self,
        simulations: Sequence[Simulation],
        tasks: Sequence[Task],
        specs: Sequence[TokenSpec],
        stepped: Sequence[SteppedRobot],
        outs: Sequence[np.ndarray],
    ) -> None:
        robots = zip(simulations, tasks, specs, stepped, outs, strict=True)
        self._parts = {i: RobotPass(*each) for i, each in enumerate(robots) if each[1].terms or each[4].shape[1]}

    def before(self, rngs: Sequence[np.random.Generator]) -> None:
        """Push whoever is due before a step."""
        for i, part in self._parts.items():
            part.before(rngs[i])

    def add(
        self,
        reward: Sequence[np.ndarray],
        ended: Sequence[np.ndarray],
        ctrl: Sequence[np.ndarray],
        rngs: Sequence[np.random.Generator],
    ) -> None:
        """Add terms to rewards, in place, and draw the commands that change.

        Args:
            reward: Rewards of a step, float64 (n,) each.
            ended: Who fell in it, bool (n,) each.
            ctrl: Flat controls.
            rngs: Random generators.
        """
        for i, part in self._parts.items():
            reward[i][:] += part.reward(ctrl[i], ended[i])
            part.command_anew(rngs[i])

    def restart(self, robot: int, rng: np.random.Generator, which: np.ndarray) -> None:
        """Begin episodes in a robot's environments `which`, int (k,), whose start states are drawn."""
        if robot in self._parts:
            self._parts[robot].restart(rng, which)

    def observe(self) -> None:
        """Write what is observed besides the limbs' sensors."""
        for part in self._parts.values():
            part.observe()

    def terms(self, robot: int) -> dict[str, np.ndarray] | None:
        """Latest terms of a robot's rewards, `reward_<name>`; None where its task has none."""
        part = self._parts.get(robot)
        return {f"reward_{name}": v.copy() for name, v in part.terms.items()} if part and part.terms else None

    def memory(self) -> dict[str, np.ndarray]:
        """What the next step depends on, as one array; no array where there is nothing."""
        memories = [part.arrays.memory.ravel() for part in self._parts.values()]
        return {"tasks": np.concatenate(memories)} if memories else {}

    def restore(self, memory: dict[str, np.ndarray]) -> None:
        """Go on from where `memory` was taken."""
        first = 0
        for part in self._parts.values():
            own = part.arrays.memory
            part.restore(memory["tasks"][first : first + own.size].reshape(own.shape))
            first += own.size
