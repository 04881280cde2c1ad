"""Methods by name: those of morphkit_rl, and those that other packages add.

A package adds a method by an entry point of the group `morphkit.methods`, which leads to a `Method`:

    [project.entry-points."morphkit.methods"]
    my-method = "my_package.my_method:METHOD"
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Literal

from morphkit.errors import ConfigError

GROUP = "morphkit.methods"
DEFAULT = "limb-former"
_MODULES = "morphkit_rl.models."
_OWN = {
    "limb-former": "limb_former",
    "ma-bert": "ma_bert",
    "anymorph": "anymorph",
    "amorpheus": "amorpheus",
    "smp": "smp",
}


@dataclass(frozen=True, slots=True)
class ModelSettings:
    """The section `[model]` of a run's settings: the sizes of a method's networks.

    Each method has settings of its own, which add fields to these.

    Attributes:
        method: Name of the method.
    """

    method: str


@dataclass(frozen=True)
class Method:
    """A way to build policies and critics.

    Attributes:
        name: Its name in `model.method`.
        summary: What it is, in a sentence.
        actions: Whether an action row has one column an actuator or one a limb.
        settings: Its settings, a dataclass derived from `ModelSettings`, every field with a default.
        build: `build(settings, embedding_size, vocabulary)` makes actor and twin critics; see `models`.
        check: `check(spec, settings, vocabulary=None)` raises ConfigError where the method cannot express a robot.
        reads_names: Which of its networks read text embeddings.
        preset: The preset that it is trained with in the benchmark.
        label: Its name in figures and tables.
        color: Its color in figures, `#rrggbb`; empty for one of those that are free.
    """

    name: str
    summary: str
    actions: Literal["actuators", "limbs"]
    settings: type[ModelSettings]
    build: Callable[..., tuple[Any, Any]]
    check: Callable[..., None]
    reads_names: Literal["none", "actor", "both"] = "none"
    preset: str = "default"
    label: str = ""
    color: str = ""


def method_names() -> tuple[str, ...]:
    """Names of all methods: morphkit_rl's own first, then those of other packages, sorted."""
    return (*_OWN, *sorted(_others()))


@cache
def find_method(name: str) -> Method:
    """The method of a name.

    Raises:
        ConfigError: There is no such method, or the package that offers it cannot be used.
    """
    if name in _OWN:
        method: Method = EntryPoint(name, f"{_MODULES}{_OWN[name]}:METHOD", GROUP).load()
        return method
    if name not in _others():
        raise ConfigError(f"unknown method {name!r}; there is {', '.join(method_names())}")
    point = _others()[name]
    try:
        found = point.load()
    except Exception as error:  # whatever the other package raises
        raise ConfigError(f"method {name!r}: {point.value} cannot be imported: {error}") from error
    if not isinstance(found, Method) or found.name != name or not _settings_fit(found):
        raise ConfigError(
            f"method {name!r}: {point.value} is no Method of that name whose settings derive from ModelSettings and"
            " have defaults"
        )
    return found


def settings_of(section: Mapping[str, Any], where: str) -> type[ModelSettings]:
    """The settings class of the method that a section `[model]` names.

    Args:
        section: The section.
        where: What it is called in messages.

    Raises:
        ConfigError: There is no such method, or a setting is one of other methods only.
    """
    name = section.get("method", DEFAULT)
    if not isinstance(name, str):
        raise ConfigError(f"{where}.method is {name!r}; expected the name of a method")
    own = _fields(name)
    for key in section:
        if key not in own and (others := _methods_with(key)):
            raise ConfigError(f"{where}.{key} is a setting of {', '.join(others)}, not of {name}")
    return find_method(name).settings


def _fields(name: str) -> set[str]:
    return {field.name for field in dataclasses.fields(find_method(name).settings)}


def _methods_with(setting: str) -> list[str]:
    """Methods that have a setting; packages that cannot be used have none."""
    found = []
    for name in method_names():
        with suppress(ConfigError):
            found += [name] if setting in _fields(name) else []
    return found


def _others() -> dict[str, EntryPoint]:
    return {point.name: point for point in entry_points(group=GROUP) if point.name not in _OWN}


def _settings_fit(method: Method) -> bool:
    if not (isinstance(method.settings, type) and issubclass(method.settings, ModelSettings)):
        return False
    fields = dataclasses.fields(method.settings)
    return not any(
        each.default is each.default_factory is dataclasses.MISSING for each in fields if each.name != "method"
    )
