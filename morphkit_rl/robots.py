"""A robot ready for learning: its simulation, its named tokens and its task."""

from __future__ import annotations

from dataclasses import dataclass

from morphkit.description import Description
from morphkit.morphology import Base
from morphkit.simulation import Simulation, build
from morphkit.tokens import Naming, TokenSpec, tokens
from morphkit_rl.envs.tasks import Task, task_for


@dataclass(frozen=True)
class Robot:
    """Simulation, token specification and task of one robot."""

    simulation: Simulation
    spec: TokenSpec
    task: Task

    @property
    def name(self) -> str:
        """Name of the robot."""
        return self.simulation.description.name


def prepare(description: Description, naming: Naming, *, task: str | None = None, base: Base | None = None) -> Robot:
    """Compile a robot and choose its task.

    Args:
        description: The robot.
        naming: How its tokens are named.
        task: Name of the task; default: the robot's own.
        base: How the root is attached to the world; default: the robot's own.
    """
    simulation = build(description, base=base)
    spec = tokens(simulation.morphology, naming=naming, canonical=description.info.canonical)
    return Robot(simulation, spec, task_for(simulation, task))
