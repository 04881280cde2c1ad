"""Tasks in TOML files: those that ship with morphkit, and one's own."""

from __future__ import annotations

import importlib.util
import math
import sys
import tomllib
from dataclasses import replace
from functools import cache
from importlib import resources
from pathlib import Path

from morphkit.errors import ConfigError, UnknownNameError
from morphkit.utils.plain_files import read_plain
from morphkit_rl.config.parsing import fill
from morphkit_rl.envs.reward_terms import read_term
from morphkit_rl.envs.task_settings import Task, TaskFile


def load_task(path: Path) -> Task:
    """Read a task from a TOML file, and run the Python files that it names.

    Raises:
        ConfigError: It cannot be read, or says what makes no sense.
        UnknownNameError: It names a term that does not exist.
    """
    try:
        source = read_plain(path).decode()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    return read_task(source, path.stem, str(path), folder=path.parent)


def read_task(source: str, name: str, origin: str, *, folder: Path | None = None) -> Task:
    """A task from TOML text; otherwise as `load_task`.

    Args:
        source: The text.
        name: Name of the task.
        origin: Where the text comes from, for messages.
        folder: Where its Python files are; None where nothing may be run.
    """
    try:
        values = tomllib.loads(source)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{origin}: not valid TOML: {error}") from None
    terms = values.pop("terms", None)
    if not isinstance(terms, dict) or not terms:
        raise ConfigError(f"{origin}: has no section [terms], such as alive = 1.0")
    file: TaskFile = fill(TaskFile, values, origin)
    for each in file.python if folder is not None else ():
        _run(folder / each, origin)  # type: ignore[operator]
    try:
        read = tuple(read_term(term, value, origin) for term, value in terms.items())
    except UnknownNameError as error:
        if not file.python or folder is not None:
            raise
        raise UnknownNameError(
            f"{error}\n  terms of {', '.join(file.python)} are not run because a run says so; give the file of the"
            " task: --task FILE.toml"
        ) from None
    _check_ranges(file, origin)
    low, high = file.ends.height
    return Task(
        name=name,
        frame_skip=None,
        control_period=file.control_period,
        episode_length=max(1, round(file.episode_seconds / file.control_period)),
        forward_weight=0.0,
        healthy_share=(low, high) if high > low else None,
        height_in_world=True,
        healthy_pitch=file.ends.tilt or None,
        qpos_noise=file.start.pose,
        qvel_noise=file.start.velocity,
        terms=read,
        commands=file.commands if "commands" in values else None,
        reach=file.reach,
        reach_seconds=file.reach_seconds,
        pushes=file.pushes,
        randomize=file.randomize,
        source=source,
    )


def _check_ranges(file: TaskFile, origin: str) -> None:
    if file.commands.heading and file.commands.yaw != (0.0, 0.0):
        raise ConfigError(f"{origin}: commands has both heading and yaw; the first takes the place of the second")
    for section, expected in (("commands", "finite"), ("randomize", "finite, positive")):
        part = getattr(file, section)
        for name in ("x", "y", "yaw") if section == "commands" else ("friction", "mass", "gain"):
            low, high = getattr(part, name)
            if not math.isfinite(high) or (section == "randomize" and low <= 0):
                raise ConfigError(
                    f"{origin}: {section}.{name} is {[low, high]}; expected a pair [low, high] of {expected} numbers"
                )


@cache
def shipped_tasks() -> dict[str, Task]:
    """The tasks that ship as TOML files, by name."""
    found = {}
    for entry in sorted((resources.files("morphkit_rl.envs") / "task_files").iterdir(), key=lambda each: each.name):
        name, dot, kind = entry.name.rpartition(".")
        if dot and kind == "toml":
            found[name] = replace(read_task(entry.read_text("utf-8"), name, f"task {name}"), source="")
    return found


def _run(path: Path, origin: str) -> None:
    """Run a Python file, whose functions become terms by the decorator `reward_term`."""
    if not path.is_file():
        raise ConfigError(f"{origin}: python: there is no file {path}")
    spec = importlib.util.spec_from_file_location(f"morphkit_task_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise ConfigError(f"{origin}: python: {path} is no Python file; its name must end in .py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    try:
        spec.loader.exec_module(module)
    except ConfigError:
        raise
    except Exception as error:
        raise ConfigError(f"{origin}: python: {path}: {type(error).__name__}: {error}") from error
