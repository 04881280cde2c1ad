"""A robot ready for learning: its simulation, its named tokens and its task."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from morphkit.description import Actuation, Description
from morphkit.morphology import Base
from morphkit.simulation.build import Simulation, build_simulation
from morphkit.tokens.names import LimbNames, Naming, TextStyle
from morphkit.tokens.proprioception import ALL, needs_declared, observed
from morphkit.tokens.spec import TokenSpec, token_spec
from morphkit_rl.envs.tasks import Task, task_for


@dataclass(frozen=True)
class Robot:
    """A robot for learning.

    Attributes:
        simulation: Its simulation.
        spec: All of the simulation's sensor tokens or some of them, for policies.
        task: Its task.
        critic_spec: The same for critics, which holds all tokens of `spec`; None where they see the same.
    """

    simulation: Simulation
    spec: TokenSpec
    task: Task
    critic_spec: TokenSpec | None = None

    @property
    def seen(self) -> TokenSpec:
        """Everything that policy or critics see."""
        return self.critic_spec or self.spec

    @property
    def name(self) -> str:
        """Name of the robot."""
        return self.simulation.description.name


def prepare(
    description: Description,
    naming: Naming = "raw",
    *,
    task: str | Task | None = None,
    base: Base | None = None,
    sensors: Sequence[str] = (),
    limb_names: LimbNames = "body",
    text_style: TextStyle = "words",
    drawn: bool = True,
    actuation: Actuation | None = None,
    control_frequency: float | None = None,
    critic_sensors: Sequence[str] = (),
) -> Robot:
    """Compile a robot, name what it senses and accepts, and choose its task.

    Args:
        description: The robot.
        naming: How its tokens are named.
        task: The task, its name or its TOML file; default: the robot's own, or what suits its base.
        base: How the root is attached to the world; default: the robot's own.
        sensors: What is observed: quantities, such as `position`, or `no_ltv`: all of limbs and joints but `type`; or
            the sets `all` (default), `proprioceptive` and `declared`.
        limb_names: Whether limbs are called by their body or by their joint.
        text_style: Whether texts are words or the names with their underscores.
        drawn: Whether its model is drawn; see `build_simulation`.
        actuation: How its motors are driven, see `simulation.actuation`; default: as suits the robot.
        control_frequency: Control steps per second, Hz; default: the robot's own, else the task's.
        critic_sensors: What critics see besides `sensors`, named alike; none: the same.

    Raises:
        UnknownNameError: There is no such task or quantity.
    """
    simulation = build_simulation(description, base=base, actuation=actuation, drawn=drawn)
    chosen = task_for(simulation, task, control_frequency)
    own = ["previous_action"] if chosen.terms else []
    own += [name for name, has in (("command", chosen.commands), ("target", chosen.reach)) if has]

    def spec(names: Sequence[str]) -> TokenSpec:
        tokens = token_spec(
            simulation.morphology,
            naming=naming,
            limb_names=limb_names,
            text_style=text_style,
            canonical=description.info.canonical,
            source="all" if needs_declared(names) else "limb",
        )
        return observed(tokens, names, own)

    seen = spec([*(sensors or (ALL,)), *critic_sensors]) if critic_sensors else None
    return Robot(simulation, spec(sensors), chosen, seen)
