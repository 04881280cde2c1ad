"""What a batch of environments can be made of."""

from __future__ import annotations

from morphkit.errors import ConfigError
from morphkit.simulation.build import Simulation
from morphkit.tokens.spec import TokenSpec
from morphkit_rl.envs.task_settings import Task


def check_robots(
    simulations: list[Simulation], tasks: list[Task], num_envs: list[int], specs: list[TokenSpec], observation: str
) -> None:
    """Refuse robots, tasks and numbers that do not belong together.

    Raises:
        ConfigError: They do not.
    """
    if not simulations:
        raise ConfigError("there is no robot to simulate")
    if not len(simulations) == len(tasks) == len(num_envs) == len(specs):
        raise ConfigError(
            f"{len(simulations)} robots need as many tasks ({len(tasks)}), num_envs ({len(num_envs)}) and specs "
            f"({len(specs)})"
        )
    if min(num_envs) < 1:
        raise ConfigError(f"every robot needs at least one environment, not {min(num_envs)}")
    if observation not in ("fixed", "legacy"):
        raise ConfigError(f"observation must be 'fixed' or 'legacy', not {observation!r}")
    for simulation, task in zip(simulations, tasks, strict=True):
        if task.frame_skip is None or task.healthy_share is not None:
            raise ConfigError(f"{simulation.name}: task {task.name!r} is incomplete; take it from task_for")
