"""`robot.toml`: what is known of a robot besides its file, read and checked."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any, get_args

from morphkit.description import Actuation, RobotInfo
from morphkit.errors import DescriptionError
from morphkit.morphology import Base
from morphkit.utils.suggest import did_you_mean

FILE_NAME = "robot.toml"

MAX_TYPES = 4
"""A limb has four `type_*` tokens, so a family has at most four groups of type words."""


@dataclass(frozen=True, slots=True)
class Recipe:
    """A variant of a robot that `robot.toml` names.

    Attributes:
        remove: Limbs to prune, each with what hangs below it.
        splice: Limbs to take out of their chain; their children move up.
        root_height: Height of the root body, m; None leaves it.
        healthy_height: Healthy height of the root, m; None takes the robot's.
        expert_return: Return of a single-robot expert on the variant.
    """

    remove: tuple[str, ...] = ()
    splice: tuple[str, ...] = ()
    root_height: float | None = None
    healthy_height: tuple[float, float] | None = None
    expert_return: float | None = None


@dataclass(frozen=True, slots=True)
class RobotToml:
    """A `robot.toml`: the basename of the robot's file (relative to its folder), its info and its recipes."""

    path: Path
    file: str
    info: RobotInfo
    recipes: dict[str, Recipe] = field(default_factory=dict)


def read_robot_toml(path: Path) -> RobotToml:
    """Read a `robot.toml`.

    Raises:
        DescriptionError: It is no TOML, has an unknown key, lacks `file`, or a value makes no sense.
    """
    try:
        table = tomllib.loads(path.read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise DescriptionError(f"{path}: cannot be read as TOML: {error}") from error
    values = _values(table, _INFO_KEYS, str(path))
    if "file" not in values:
        raise DescriptionError(f'{path}: the key "file" is missing; give the name of the robot\'s .urdf or .xml file')
    recipes = {
        name: Recipe(**_values(_table(recipe, f"{path}: [recipes.{name}]"), _RECIPE_KEYS, f"{path}: [recipes.{name}]"))
        for name, recipe in values.pop("recipes", {}).items()
    }
    return RobotToml(path, values.pop("file"), RobotInfo(**values), recipes)


def _values(table: Mapping[str, Any], keys: Mapping[str, Callable[[Any, str], Any]], where: str) -> dict[str, Any]:
    """Check every value of `table`; a key that is not among `keys` is refused."""
    for key in table:
        if key not in keys:
            raise DescriptionError(
                f"{where}: unknown key {key!r}{did_you_mean(key, keys)}; known keys: {', '.join(keys)}"
            )
    return {key: keys[key](value, f"{where}: {key}") for key, value in table.items()}


def _expect(good: bool, where: str, expected: str, value: Any) -> None:
    if not good:
        raise DescriptionError(f"{where} must be {expected}, not {value!r}")


def _text(value: Any, where: str) -> str:
    _expect(isinstance(value, str), where, "a string", value)
    return str(value)


def _one_of(*choices: str) -> Callable[[Any, str], str]:
    def check(value: Any, where: str) -> str:
        _expect(value in choices, where, "one of " + ", ".join(choices), value)
        return str(value)

    return check


def _file(value: Any, where: str) -> str:
    path = PurePosixPath(_text(value, where))
    inside = not path.is_absolute() and ".." not in path.parts and path.suffix in (".urdf", ".xml")
    _expect(inside, where, "a .urdf or .xml file in the folder of robot.toml", value)
    return str(path)


def _number(value: Any, where: str) -> float:
    _expect(isinstance(value, int | float) and not isinstance(value, bool) and value == value, where, "a number", value)
    return float(value)


def _positive(value: Any, where: str) -> float:
    number = _number(value, where)
    _expect(0 < number < math.inf, where, "a positive number", value)
    return number


def _gains(value: Any, where: str) -> dict[str, tuple[float, float]]:
    gains = {}
    for joint, pair in _table(value, where).items():
        at = f"{where}.{joint}"
        _expect(isinstance(pair, list) and len(pair) == 2, at, "a pair [stiffness, damping]", pair)
        stiffness, damping = _positive(pair[0], at), _number(pair[1], at)
        _expect(0 <= damping < math.inf, at, "a pair [stiffness, damping], the damping not negative", pair)
        gains[joint] = stiffness, damping
    return gains


def _range(value: Any, where: str) -> tuple[float, float]:
    _expect(isinstance(value, list) and len(value) == 2, where, "a pair [low, high]", value)
    low, high = _number(value[0], where), _number(value[1], where)
    _expect(low < high, where, "a pair [low, high] with low < high", value)
    return low, high


def _names(value: Any, where: str) -> tuple[str, ...]:
    _expect(isinstance(value, list) and all(isinstance(v, str) and v for v in value), where, "a list of names", value)
    return tuple(value)


def _type_words(value: Any, where: str) -> tuple[tuple[str, ...], ...]:
    _expect(isinstance(value, list), where, "a list of lists of words", value)
    _expect(len(value) <= MAX_TYPES, where, f"at most {MAX_TYPES} groups of words", value)
    groups = tuple(_names(group, where) for group in value)
    words = [word for group in groups for word in group]
    _expect(all(groups) and len(set(words)) == len(words), where, "groups of distinct words, none empty", value)
    return groups


def _canonical(value: Any, where: str) -> dict[str, str]:
    table = {limb: _text(name, f"{where}.{limb}") for limb, name in _table(value, where).items()}
    names = [" ".join(name.split()).casefold() for name in table.values()]
    twice = next((name for name in names if names.count(name) > 1 or not name), None)
    _expect(twice is None, where, "plain words that no two limbs share", twice)
    return table


def _start(value: Any, where: str) -> str | dict[str, float]:
    if isinstance(value, dict):
        return {joint: _coordinate(number, f"{where}.{joint}") for joint, number in value.items()}
    _expect(isinstance(value, str) and value != "", where, "a table of joints, 'zero', 'middle' or a keyframe", value)
    return str(value)


def _coordinate(value: Any, where: str) -> float:
    number = _number(value, where)
    _expect(math.isfinite(number), where, "finite", value)
    return number


def _table(value: Any, where: str) -> dict[str, Any]:
    _expect(isinstance(value, dict), where, "a table", value)
    return dict(value)


_RECIPE_KEYS: dict[str, Callable[[Any, str], Any]] = {
    "remove": _names,
    "splice": _names,
    "root_height": _number,
    "healthy_height": _range,
    "expert_return": _number,
}
_INFO_KEYS: dict[str, Callable[[Any, str], Any]] = {
    "description": _text,
    "license": _text,
    "source": _text,
    "file": _file,
    "family": _text,
    "type_words": _type_words,
    "type_matched_in": _one_of("body", "joint"),
    "task": _text,
    "base": _one_of(*get_args(Base)),
    "start": _start,
    "healthy_height": _range,
    "expert_return": _number,
    "actuation": _one_of(*get_args(Actuation)),
    "gains": _gains,
    "action_scale": _positive,
    "control_frequency": _positive,
    "canonical": _canonical,
    "recipes": _table,
}
