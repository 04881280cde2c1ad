"""Settings in dataclasses: filled from nested mappings, checked, changed by `section.name=value`."""

from __future__ import annotations

import dataclasses
import math
import tomllib
import types
import typing
from collections.abc import Mapping
from typing import Any, Literal

from morphkit.errors import ConfigError
from morphkit.utils.suggest import did_you_mean_or_list


def bounded(default: Any, *, at_least: float = 0, at_most: float = math.inf) -> Any:
    """A number in a settings dataclass, with the bounds that it is checked against; others must be at least 0."""
    return dataclasses.field(default=default, metadata={"at_least": at_least, "at_most": at_most})


def override(values: dict[str, Any], text: str) -> None:
    """Change one setting of `values` (sections of settings) by `section.name=value`; the value is TOML, or a bare word.

    Raises:
        ConfigError: `text` has another form.
    """
    key, equals, written = text.partition("=")
    section, dot, name = key.strip().partition(".")
    if not (equals and dot and name):
        raise ConfigError(f"--set {text!r}: expected section.name=value, such as td3.tau=0.01")
    try:
        value = tomllib.loads(f"value = {written}")["value"]
    except tomllib.TOMLDecodeError:
        value = written.strip()
    if not isinstance(values.setdefault(section, {}), dict):
        raise ConfigError(f"--set {text!r}: {section!r} is no section")
    values[section][name] = value


def fill(kind: type[Any], values: Mapping[str, Any], origin: str, section: str = "") -> Any:
    """Fill a dataclass, and those that are its fields, from nested settings.

    A field whose metadata has `choose` is filled into the dataclass that this gives for its values and their name.

    Args:
        kind: The dataclass.
        values: Settings by name; those that are missing keep their defaults.
        origin: Where they come from, for messages.
        section: Where `kind` is, such as `td3`; empty for the whole.

    Raises:
        ConfigError: A setting does not exist, or has the wrong type or range.
    """
    hints = typing.get_type_hints(kind)
    about = {each.name: each.metadata for each in dataclasses.fields(kind)}
    arguments: dict[str, Any] = {}
    for key, value in values.items():
        where = f"{section}.{key}" if section else key
        if key not in hints:
            raise ConfigError(f"{origin}: unknown setting {where!r}{did_you_mean_or_list(key, hints)}")
        hint = hints[key]
        if dataclasses.is_dataclass(hint):
            if not isinstance(value, Mapping):
                raise ConfigError(f"{origin}: {where} is a section, not a value")
            if choose := about[key].get("choose"):
                hint = choose(value, f"{origin}: {where}")
            arguments[key] = fill(typing.cast("type[Any]", hint), value, origin, where)
        else:
            arguments[key] = _check(hint, value, f"{origin}: {where}", about[key])
    return kind(**arguments)


def _check(hint: Any, value: Any, where: str, bounds: Mapping[str, Any]) -> Any:
    if typing.get_origin(hint) is Literal:
        choices = typing.get_args(hint)
        if value not in choices:
            raise ConfigError(f"{where} is {value!r}; expected one of {', '.join(choices)}")
        return value
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        return _check_word_or_number(hint, value, where, bounds)
    if hint == tuple[str, ...]:
        return _words(value, where)
    if hint == tuple[float, float]:
        return _range(value, where)
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if not isinstance(value, hint) or (isinstance(value, bool) and hint is not bool):
        raise ConfigError(f"{where} is {value!r}; expected {hint.__name__}")
    if hint in (int, float):
        low, high = bounds.get("at_least", 0), bounds.get("at_most", math.inf)
        if not low <= value <= high or math.isinf(value):
            expected = f"of at least {low}" if math.isinf(high) else f"from {low} to {high}"
            raise ConfigError(f"{where} is {value!r}; expected a number {expected}")
    return value


def _check_word_or_number(hint: Any, value: Any, where: str, bounds: Mapping[str, Any]) -> Any:
    """A setting that is one of some words, or a number."""
    words, number = typing.get_args(hint)
    if typing.get_origin(words) is not Literal or number not in (int, float):
        raise TypeError(f"{where}: a setting has one type, or is one of some words or a number")
    choices = typing.get_args(words)
    if value in choices:
        return value
    if isinstance(value, str):
        expected = f"one of {', '.join(choices)}, or a number of at least {bounds.get('at_least', 0)}"
        raise ConfigError(f"{where} is {value!r}; expected {expected}")
    return _check(number, value, where, bounds)


def _words(value: Any, where: str) -> tuple[str, ...]:
    """A list of strings; a string stands for its parts between commas."""
    words = [part.strip() for part in value.split(",") if part.strip()] if isinstance(value, str) else value
    if not isinstance(words, list | tuple) or not all(isinstance(word, str) for word in words):
        raise ConfigError(f"{where} is {value!r}; expected a list of strings")
    return tuple(words)


def _range(value: Any, where: str) -> tuple[float, float]:
    """A pair of numbers, the first not above the second."""
    numbers = value if isinstance(value, list | tuple) else ()
    good = len(numbers) == 2 and all(isinstance(n, int | float) and not isinstance(n, bool) for n in numbers)
    if not good or not -math.inf < numbers[0] <= numbers[1]:
        raise ConfigError(f"{where} is {value!r}; expected a pair [low, high] of numbers")
    return float(numbers[0]), float(numbers[1])


def lists_for_tuples(items: list[tuple[str, Any]]) -> dict[str, Any]:
    """A `dict_factory` for `dataclasses.asdict` whose values JSON and TOML give back as they are."""
    return {key: list(value) if isinstance(value, tuple) else value for key, value in items}
