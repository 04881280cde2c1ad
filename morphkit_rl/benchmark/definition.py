"""Tasks and splits: which robots are trained together and which are held out, read from TOML."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from morphkit.errors import ConfigError, UnknownNameError
from morphkit.utils.suggest import did_you_mean

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")
_FILE_SUFFIXES = (".urdf", ".xml", ".json", ".toml")


@dataclass(frozen=True, slots=True)
class Sets:
    """Training and held-out robots of a group: names of shipped robots and recipes, or absolute paths."""

    train: tuple[str, ...]
    test: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Benchmark:
    """Tasks and splits.

    Attributes:
        tasks: Groups of robots that a task trains together.
        splits: Sets of each group, by split.
    """

    tasks: Mapping[str, tuple[str, ...]]
    splits: Mapping[str, Mapping[str, Sets]]

    def groups(self, task: str, split: str) -> dict[str, Sets]:
        """The groups of a task in a split, in the task's order.

        Raises:
            UnknownNameError: There is no such task or split, or the split leaves out one of the task's groups.
        """
        for kind, name, known in (("task", task, self.tasks), ("split", split, self.splits)):
            if name not in known:
                raise UnknownNameError(
                    f"the benchmark has no {kind} {name!r}{did_you_mean(name, known)}; {kind}s: {', '.join(known)}"
                )
        sets = self.splits[split]
        missing = [group for group in self.tasks[task] if group not in sets]
        if missing:
            raise UnknownNameError(f"split {split!r} has no {missing[0]}, which task {task!r} needs")
        return {group: sets[group] for group in self.tasks[task]}


def load_benchmark(file: Path | None = None) -> Benchmark:
    """Read the published tasks and splits, and those of a file of one's own next to them.

    Args:
        file: A TOML file with `[tasks]` and `[splits.NAME.GROUP]` tables; robots in it are names, or paths relative to
            the file.

    Raises:
        ConfigError: The file cannot be read, something in it makes no sense, or it changes what is published.
    """
    text = (resources.files("morphkit_rl.benchmark") / "benchmark.toml").read_text("utf-8")
    published = _parse(tomllib.loads(text), "benchmark.toml", Path(), {})
    if file is None:
        return published
    try:
        values = tomllib.loads(file.read_text("utf-8"))
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else f"not valid TOML: {error}"
        raise ConfigError(f"{file}: cannot be read: {reason}") from None
    own = _parse(values, str(file), file.resolve().parent, published.splits)
    for kind, new, known in (("task", own.tasks, published.tasks), ("split", own.splits, published.splits)):
        for name in sorted(set(new) & set(known)):
            raise ConfigError(f"{file}: {kind} {name!r} is published and cannot be changed; give yours another name")
    return Benchmark({**published.tasks, **own.tasks}, {**published.splits, **own.splits})


def _parse(values: Mapping[str, Any], origin: str, folder: Path, known: Mapping[str, Mapping[str, Sets]]) -> Benchmark:
    _only(values, ("tasks", "splits"), origin)
    splits = {
        _name(name, f"{origin}: split"): {
            _name(group, f"{origin}: group"): _sets(sets, f"{origin}: splits.{name}.{group}", folder)
            for group, sets in _table(groups, f"{origin}: splits.{name}").items()
        }
        for name, groups in _table(values.get("splits", {}), f"{origin}: splits").items()
    }
    tasks = {
        _name(name, f"{origin}: task"): _strings(groups, f"{origin}: tasks.{name}")
        for name, groups in _table(values.get("tasks", {}), f"{origin}: tasks").items()
    }
    all_groups = {group for sets in (*splits.values(), *known.values()) for group in sets}
    for task, groups in tasks.items():
        if not groups:
            raise ConfigError(f"{origin}: task {task!r} names no group")
        for group in groups:
            if group not in all_groups:
                raise ConfigError(
                    f"{origin}: task {task!r}: no split has a group {group!r}{did_you_mean(group, all_groups)}"
                )
    return Benchmark(tasks, splits)


def _sets(values: Any, where: str, folder: Path) -> Sets:
    table = _table(values, where)
    _only(table, ("train", "test"), where)
    train, test = (
        tuple(_target(name, folder) for name in _strings(table.get(key, []), f"{where}.{key}"))
        for key in ("train", "test")
    )
    if not train:
        raise ConfigError(f"{where}: train is empty; a group needs a robot to train on")
    for name in (*train, *test):
        if (*train, *test).count(name) > 1:
            both = "in train and in test" if name in train and name in test else "twice"
            raise ConfigError(f"{where}: {name!r} is listed {both}")
    return Sets(train, test)


def _target(name: str, folder: Path) -> str:
    """A path relative to `folder` made absolute; a plain name as it is."""
    is_path = len(Path(name).parts) > 1 or Path(name).suffix in _FILE_SUFFIXES or (folder / name).is_dir()
    return str((folder / name).resolve()) if folder != Path() and is_path else name


def _name(name: str, what: str) -> str:
    """Names of tasks, splits and groups become names of folders."""
    if not _NAME.fullmatch(name):
        raise ConfigError(
            f"{what} {name!r}: names have letters, digits, '.', '_' and '-', and begin with none of those three"
        )
    return name


def _table(value: Any, where: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise ConfigError(f"{where} is {value!r}; expected a table")
    return value


def _strings(value: Any, where: str) -> tuple[str, ...]:
    if not isinstance(value, list) or not all(isinstance(item, str) and item for item in value):
        raise ConfigError(f"{where} is {value!r}; expected a list of names")
    return tuple(value)


def _only(values: Mapping[str, Any], allowed: Iterable[str], where: str) -> None:
    for key in values:
        if key not in allowed:
            raise ConfigError(f"{where}: unknown key {key!r}; there is {', '.join(allowed)}")
