"""What `import morphkit_rl` offers, and what it costs."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import morphkit_rl
from morphkit.registry import load
from morphkit_rl.runs import run_settings


@pytest.mark.parametrize("name", morphkit_rl.__all__)
def test_every_public_name_exists(name: str) -> None:
    assert getattr(morphkit_rl, name).__name__ == name


def test_type_checkers_see_the_same_names() -> None:
    tree = ast.parse(Path(morphkit_rl.__file__).read_text(encoding="utf-8"))
    checked = next(node for node in tree.body if isinstance(node, ast.If))
    seen = {
        alias.name: node.module for node in checked.body if isinstance(node, ast.ImportFrom) for alias in node.names
    }
    assert seen == morphkit_rl._HOME
    assert sorted(seen) == morphkit_rl.__all__


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'trane'"):
        _ = morphkit_rl.trane


def test_importing_it_loads_neither_torch_nor_the_simulator() -> None:
    heavy = "{'torch', 'mujoco', 'transformers', 'scipy', 'lxml'}"
    code = f"import sys, morphkit_rl; print(*{heavy} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.split() == []


def test_a_run_folder_may_be_a_string(tmp_path: Path) -> None:
    robots, run = [load("hopper_3"), load("hopper_4")], str(tmp_path / "run")
    config = morphkit_rl.load_config(overrides=["model.d_model=16", "model.layers=1", "trainer.num_envs=2"])
    assert morphkit_rl.train(robots, run, config, hold_out=["hopper_4"], steps=8).run == Path(run)
    assert morphkit_rl.resume(run, steps=16).steps == 16
    assert [robot.name for robot in run_settings.load(Path(run)).robots] == ["hopper_3"]
    results = morphkit_rl.evaluate(run, robots, episodes=2)
    assert [(each.robot, each.trained_on, len(each.returns)) for each in results] == [
        ("hopper_3", True, 2),
        ("hopper_4", False, 2),
    ]
