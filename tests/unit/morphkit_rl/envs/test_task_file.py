from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from morphkit.errors import ConfigError, MorphkitError, UnknownNameError
from morphkit.registry import load
from morphkit.simulation.build import build_simulation
from morphkit_rl.algorithms.actions import ActionScale
from morphkit_rl.envs.batch_env import BatchEnv
from morphkit_rl.envs.reward_terms import TERMS
from morphkit_rl.envs.robot import prepare
from morphkit_rl.envs.task_file import load_task, read_task, shipped_tasks
from morphkit_rl.envs.tasks import TASKS, find_task, task_for
from morphkit_rl.evaluation.episodes import play, random_controller

MINE = """
python = ["my_terms.py"]
control_period = 0.01
episode_seconds = 3

[terms]
alive = 1.0
low = { weight = -2.0, share = 0.9 }

[commands]
x = [0.2, 0.3]
yaw = [-1, 1]

[ends]
height = [0.5, inf]
tilt = 0.7
"""
LOW = """
from morphkit_rl.envs.reward_terms import reward_term

@reward_term
def low(robot, *, share=0.8):
    return (robot.height < share).astype(float)
"""


@pytest.fixture(autouse=True)
def _own_terms() -> Iterator[None]:
    known = TERMS.copy()
    yield
    TERMS.clear()
    TERMS.update(known)


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    (tmp_path / "my_terms.py").write_text(LOW)
    (tmp_path / "mine.toml").write_text(MINE)
    return tmp_path / "mine.toml"


def test_a_task_of_ones_own(mine: Path) -> None:
    robot = prepare(load("quadruped"), task=str(mine))
    task = robot.task
    assert (task.name, task.episode_length, task.healthy_pitch) == ("mine", 300, 0.7)
    assert task.frame_skip == round(0.01 / robot.simulation.model.opt.timestep)
    assert [(term.name, term.weight, term.settings) for term in task.terms][1] == ("low", -2.0, (("share", 0.9),))
    start = robot.simulation.model.qpos0
    assert task.healthy_height == (pytest.approx(0.5 * start[2]), np.inf)
    env = BatchEnv([robot.simulation], [task], 2, specs=[robot.spec], num_threads=1)
    names = [token.name for token in robot.spec.sensors[-15:]]
    assert names[0] == "FL_hip_previous_action"
    assert names[-3:] == ["trunk_command_x", "trunk_command_y", "trunk_command_yaw"]
    assert [token.text for token in robot.spec.sensors[-2:]] == ["trunk command y", "trunk command yaw"]
    obs = env.reset()[0]
    assert (np.abs(obs[:, -1]) <= 1).all()
    assert ((obs[:, -3] >= 0.2) & (obs[:, -3] <= 0.3)).all()
    np.testing.assert_array_equal(obs[:, -15:-3], 0.0)
    qpos = np.tile(start, (2, 1))
    qpos[1, 2] *= 0.7
    env.set_state(0, qpos, np.zeros((2, robot.simulation.model.nv)))
    step = env.step([np.full((2, 12), 0.25)])
    assert step.reward[0].tolist() == [1.0, -1.0]
    np.testing.assert_allclose(step.obs[0][:, -15:-3], 0.5)
    assert set(env.reward_terms(0)) == {"x_velocity", "reward_alive", "reward_low"}


def test_python_files_are_run_for_those_who_give_the_file_only(mine: Path) -> None:
    with pytest.raises(UnknownNameError, match=r"my_terms.py are not run because a run says so"):
        read_task(MINE, "mine", "run/config.json")
    load_task(mine)
    assert read_task(MINE, "mine", "run/config.json") == find_task(str(mine))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"no section \[terms\]"),
        ("terms = 3", r"no section \[terms\]"),
        ("[terms]\nalive = 1\n[command]\nx = [0, 1]", "unknown setting 'command'; did you mean 'commands'"),
        ("[terms]\nalive = 1\n[commands]\nx = [1, 0]", "commands.x is .* expected a pair"),
        ("[terms]\nalive = 1\n[commands]\nx = 1", "commands.x is 1; expected a pair"),
        ("control_period = 0\n[terms]\nalive = 1", "control_period is 0"),
        ("[terms\n", "not valid TOML"),
        ("[terms]\nwaltz = 1", "there is no term 'waltz'"),
        ('python = ["none.py"]\n[terms]\nalive = 1', "there is no file"),
        ('python = ["bad.py"]\n[terms]\nalive = 1', "bad.py: ZeroDivisionError"),
        ("[terms]\nalive = 1\n[randomize]\nmass = [0, 1]", "randomize.mass is .* positive numbers"),
        ("[terms]\nalive = 1\n[commands]\nheading = -1", "commands.heading is -1"),
        ("[terms]\nalive = 1\n[commands]\nheading = 1\nyaw = [-1, 1]", "commands has both heading and yaw"),
        ("[terms]\nalive = 1\n[commands]\ny = [0, inf]", "commands.y is .* finite"),
    ],
)
def test_files_that_make_no_sense(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "bad.py").write_text("1 / 0")
    (tmp_path / "task.toml").write_text(text)
    with pytest.raises(MorphkitError, match=message) as caught:
        load_task(tmp_path / "task.toml")
    assert "task.toml" in str(caught.value)


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read"):
        load_task(tmp_path / "none.toml")
    (tmp_path / "task.toml").write_bytes(b"\xff")
    with pytest.raises(ConfigError, match="cannot be read"):
        load_task(tmp_path / "task.toml")


def test_a_term_must_give_a_number_for_each_environment(tmp_path: Path) -> None:
    (tmp_path / "t.py").write_text(LOW.replace("(robot.height < share).astype(float)", "robot.gravity"))
    (tmp_path / "t.toml").write_text('python = ["t.py"]\n[terms]\nlow = 1\n')
    simulation = build_simulation(load("quadruped"))
    env = BatchEnv([simulation], [task_for(simulation, str(tmp_path / "t.toml"))], 2, num_threads=1)
    env.reset()
    with pytest.raises(ConfigError, match=r"term 'low' gave an array of shape \(2, 3\)"):
        env.step([np.zeros((2, 12))])


def test_shipped_tasks_are_known_by_their_names() -> None:
    assert set(shipped_tasks()) == {"walk", "reach"}
    assert set(shipped_tasks()) < set(TASKS)
    assert not any(task.source for task in TASKS.values())


def test_walk_pays_next_to_nothing_for_standing_still_and_for_random_actions() -> None:
    robot = prepare(load("quadruped"))
    env = BatchEnv([robot.simulation], [replace(robot.task, episode_length=200)], 4, specs=[robot.spec], seed=0)
    middle = ActionScale(robot.spec).to_controls(np.zeros((4, len(robot.spec.actuators))))
    most = 200 * robot.task.most
    still = play(env, lambda _: [middle])
    assert still.lengths[0].min() == 200
    assert -0.1 < still.returns[0].mean() / most < 0.25
    assert play(env, random_controller(env, 0)).returns[0].mean() / most < 0.1
