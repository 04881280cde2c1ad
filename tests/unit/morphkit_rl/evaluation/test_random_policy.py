from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from morphkit.errors import ConfigError
from morphkit.registry import load, recipes
from morphkit_cli.main import run
from morphkit_rl.evaluation.random_policy import random_returns

DOCUMENT = Path(__file__).parents[4] / "docs" / "results" / "random-returns.md"
ROW = re.compile(r"^\| (\w+) \| (-?[\d.]+) \| \S+ to \S+ \| ([\d.]+) \| ([\d.]+) \|", re.MULTILINE)
DOCUMENTED = {name: tuple(map(float, numbers)) for name, *numbers in ROW.findall(DOCUMENT.read_text())}


def test_a_robots_returns_depend_neither_on_the_others_nor_on_the_call() -> None:
    hopper, walker = load("hopper_5"), load("walker_2_main")
    first, _ = random_returns([hopper, walker], 3, seed=1)
    _, again = random_returns([walker, hopper], 3, seed=1)
    (other,) = random_returns([hopper], 3, seed=2)
    assert first == again
    assert first.returns != other.returns
    assert len(set(first.returns)) == 3
    assert first.interval[0] <= first.mean <= first.interval[1]


def test_no_episodes_are_refused() -> None:
    with pytest.raises(ConfigError, match="at least 1"):
        list(random_returns([load("hopper_5")], 0))


def test_the_document_lists_all_bodies() -> None:
    families = ("cheetah", "walker", "humanoid_2d", "hopper")
    assert sorted(DOCUMENTED) == sorted(name for family in families for name in recipes(family))


@pytest.mark.parametrize("body", ["hopper_5", "walker_2_main"])
def test_documented_returns_are_what_the_command_prints(body: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Other processors round otherwise, which parts trajectories: means may move by what chance allows."""
    assert run(["benchmark", "random", body, "--json"]) == 0
    (result,) = json.loads(capsys.readouterr().out)
    mean, std, steps = DOCUMENTED[body]
    error = std / np.sqrt(100)
    assert len(result["returns"]) == 100
    assert result["mean"] == pytest.approx(mean, abs=4 * error)
    assert np.mean(result["lengths"]) == pytest.approx(steps, rel=0.5)


def test_the_command_prints_a_markdown_table(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["benchmark", "random", "hopper_4", "--episodes", "2", "--format", "markdown"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.count("|") for line in lines] == [7, 7, 7]
    assert ROW.match(lines[2])
