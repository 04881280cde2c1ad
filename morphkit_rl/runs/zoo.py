"""The policies that ship with morphkit: each folder of `morphkit_zoo` is one, and `zoo:NAME` stands for it."""

from __future__ import annotations

import importlib.resources
from pathlib import Path

from morphkit.errors import UnknownNameError
from morphkit.utils.suggest import did_you_mean_or_list
from morphkit_rl.runs.run_folder import POLICY

PREFIX = "zoo:"


def names() -> list[str]:
    """Names of the shipped policies, sorted."""
    return sorted(file.parent.name for file in _folder().glob(f"*/{POLICY}"))


def find(target: str | Path) -> Path:
    """The folder that `target` stands for: a shipped policy's for `zoo:NAME`, else itself.

    Raises:
        UnknownNameError: No policy of that name ships.
    """
    if not is_name(target):
        return Path(target)
    name = str(target).removeprefix(PREFIX)
    if name not in names():
        hint = did_you_mean_or_list(name, names()) if names() else "; none ships"
        raise UnknownNameError(f"{target}: no such policy ships with morphkit{hint}")
    return _folder() / name


def is_name(target: str | Path) -> bool:
    """Whether `target` is the name of a shipped policy, not a folder."""
    return str(target).startswith(PREFIX)


def _folder() -> Path:
    return Path(str(importlib.resources.files("morphkit_zoo")))
