"""The task in a run's `config.json`: its name, and the text of its TOML file where it does not ship with morphkit."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from morphkit.errors import CheckpointError, ConfigError, UnknownNameError
from morphkit_rl.envs.task_file import load_task, read_task
from morphkit_rl.envs.tasks import TASKS, Task, find_task


def chosen_task(task: str | Task | None) -> str | Task | None:
    """What a run is told to train on: a task from a file as it was read, others by their names.

    Raises:
        UnknownNameError: There is no such task.
        ConfigError: The file makes no sense, or a task was made in Python, so that a run could not keep it.
    """
    if task is None:
        return None
    found = find_task(task)
    if found.source:
        return found
    if TASKS.get(found.name) != found:
        raise ConfigError(f"task {found.name!r} cannot be kept in a run; write it to a TOML file, and give that")
    return found.name


def to_json(task: str | Task | None) -> dict[str, str | None]:
    """The keys of `config.json`."""
    return {"task": task.name, "task_toml": task.source} if isinstance(task, Task) else {"task": task}


def from_json(saved: Mapping[str, Any], origin: str) -> str | Task | None:
    """The task that `to_json` gave the keys of; Python files that it names are not run.

    Raises:
        ConfigError: Terms that it names are unknown.
        CheckpointError: It makes no sense.
    """
    source = saved.get("task_toml")
    if source is None:
        return saved.get("task")
    try:
        return read_task(source, saved["task"] or "task", origin)
    except UnknownNameError as error:
        raise ConfigError(str(error)) from None
    except ConfigError as error:
        raise CheckpointError(str(error)) from None


def run_terms(path: Path, saved: Mapping[str, Any]) -> None:
    """Run the Python files of a run's task, because the user gives the task's file.

    Raises:
        ConfigError: The file is another than that which the run was begun with.
    """
    if load_task(path).source != saved.get("task_toml"):
        raise ConfigError(f"{path}: is not the task that the run was begun with, which it keeps")
