"""What `import morphkit` offers, and what it costs."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import morphkit


@pytest.mark.parametrize("name", morphkit.__all__)
def test_every_public_name_exists(name: str) -> None:
    value = getattr(morphkit, name)
    assert getattr(value, "__name__", name).rpartition(".")[2] == name


def test_type_checkers_see_the_same_names() -> None:
    tree = ast.parse(Path(morphkit.__file__).read_text(encoding="utf-8"))
    checked = next(node for node in tree.body if isinstance(node, ast.If))
    seen = {
        (f"{node.module}.{alias.name}" if node.module == "morphkit" else node.module, alias.name)
        for node in checked.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    homes = {(module, name) for name, module in morphkit._HOME.items()}
    assert seen == homes | {("morphkit.families", "families")}
    assert {name for _, name in seen} | {"__version__"} == set(morphkit.__all__)


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'lode'"):
        _ = morphkit.lode


def test_importing_it_loads_nothing_heavy() -> None:
    code = "import sys, morphkit; print(*{'numpy', 'mujoco', 'lxml', 'yourdfpy', 'torch', 'rich'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.split() == []
