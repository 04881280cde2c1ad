"""Returns of the random policy: what a score of 0 stands for."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from morphkit.description import Description
from morphkit.errors import ConfigError
from morphkit.morphology import Base
from morphkit_rl.envs.batch_env import BatchEnv
from morphkit_rl.envs.robot import prepare
from morphkit_rl.evaluation.episodes import RobotReturns, play, random_controller


def random_returns(
    descriptions: Sequence[Description],
    episodes: int = 100,
    seed: int = 0,
    *,
    task: str | None = None,
    base: Base | None = None,
) -> Iterator[RobotReturns]:
    """Play random episodes on robots: controls drawn uniformly from their ranges, anew at every control step.

    A robot's episodes run side by side, as many as there are; its result depends on its name, `episodes` and `seed`,
    not on the other robots.

    Args:
        descriptions: The robots.
        episodes: Episodes a robot, each from a start of its own.
        seed: Seeds starts and controls.
        task: Name of the task; default: each robot's own.
        base: How roots are attached to the world; default: each robot's own.

    Yields:
        One result a robot, when it is there.

    Raises:
        ConfigError: `episodes` is less than 1.
    """
    if episodes < 1:
        raise ConfigError(f"episodes is {episodes}; expected at least 1")
    for description in descriptions:
        robot = prepare(description, task=task, base=base, drawn=False)
        env = BatchEnv([robot.simulation], [robot.task], episodes, seed=seed)
        (returns,), (lengths,), _ = play(env, random_controller(env, seed))
        env.close()
        yield RobotReturns(robot.name, tuple(returns.tolist()), tuple(lengths.tolist()), description.info.expert_return)
