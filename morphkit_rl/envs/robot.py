"""A robot ready for learning: its simulation, its named tokens and its task."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from morphkit.description import Actuation, Description
from morphkit.morphology import Base
from morphkit.simulation.build import Simulation, build_simulation
from morphkit.tokens.names import LimbNames, Naming, TextStyle
from morphkit.tokens.selection import take_quantities
from morphkit.tokens.spec import TokenSpec, token_spec
from morphkit_rl.envs.tasks import Task, task_for


@dataclass(frozen=True)
class Robot:
    """Simulation, tokens and task of one robot; `spec` holds all of the simulation's sensor tokens or some of them."""

    simulation: Simulation
    spec: TokenSpec
    task: Task

    @property
    def name(self) -> str:
        """Name of the robot."""
        return self.simulation.description.name


def prepare(
    description: Description,
    naming: Naming = "raw",
    *,
    task: str | None = None,
    base: Base | None = None,
    sensors: Sequence[str] = (),
    limb_names: LimbNames = "body",
    text_style: TextStyle = "words",
    drawn: bool = True,
    actuation: Actuation | None = None,
    control_frequency: float | None = None,
) -> Robot:
    """Compile a robot, name what it senses and accepts, and choose its task.

    Args:
        description: The robot.
        naming: How its tokens are named.
        task: Name of the task; default: the robot's own.
        base: How the root is attached to the world; default: the robot's own.
        sensors: Quantities that are observed, such as `position`, or `no_ltv`: all but `type`; default: all.
        limb_names: Whether limbs are called by their body or by their joint.
        text_style: Whether texts are words or the names with their underscores.
        drawn: Whether its model is drawn; see `build_simulation`.
        actuation: How its motors are driven, see `simulation.actuation`; default: as suits the robot.
        control_frequency: Control steps per second, Hz; default: the robot's own, else the task's.

    Raises:
        UnknownNameError: There is no such task or quantity.
    """
    simulation = build_simulation(description, base=base, actuation=actuation, drawn=drawn)
    spec = token_spec(
        simulation.morphology,
        naming=naming,
        limb_names=limb_names,
        text_style=text_style,
        canonical=description.info.canonical,
    )
    return Robot(simulation, take_quantities(spec, sensors), task_for(simulation, task, control_frequency))
