"""What was mended of the robots of a run, as `morphkit convert` mends it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from morphkit.errors import ConfigError
from morphkit_rl.envs.robot import Robot


def mended(robots: Iterable[Robot], *, strict: bool) -> dict[str, tuple[str, ...]]:
    """A sentence for each thing that was mended, by the name of the robot; nothing of robots that are sound.

    Raises:
        ConfigError: There is one, and `strict` is True.
    """
    found = {robot.name: robot.simulation.mended for robot in robots if robot.simulation.mended}
    for name, sentences in found.items() if strict else ():
        more = f"; {len(sentences) - 1} more" if len(sentences) > 1 else ""
        raise ConfigError(f"{name}: {sentences[0]}{more}. --strict refuses what has to be mended; see 'morphkit check'")
    return found


def said_once(found: Mapping[str, Sequence[str]]) -> Iterator[str]:
    """Each sentence of `mended` once, with the robots that it is about."""
    robots: dict[str, list[str]] = {}
    for robot, sentences in found.items():
        for sentence in sentences:
            robots.setdefault(sentence, []).append(robot)
    for sentence, names in robots.items():
        others = f" and {len(names) - 1} more" if len(names) > 1 else ""
        yield f"{names[0]}{others}: {sentence}"
