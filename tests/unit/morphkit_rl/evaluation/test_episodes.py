from __future__ import annotations

from dataclasses import replace

import numpy as np

from morphkit.registry import load
from morphkit_rl.envs.batch_env import BatchEnv
from morphkit_rl.envs.robot import prepare
from morphkit_rl.evaluation.episodes import play


def test_only_the_first_episode_of_an_environment_counts() -> None:
    robots = [prepare(load("hopper_5")), prepare(load("cheetah_2_back"))]
    tasks = [replace(robot.task, episode_length=length) for robot, length in zip(robots, (7, 11), strict=True)]
    env = BatchEnv([robot.simulation for robot in robots], tasks, [2, 3])
    played = play(env, lambda obs: [np.zeros((len(rows), 4 if i == 0 else 1)) for i, rows in enumerate(obs)])
    np.testing.assert_array_equal(np.concatenate(played.lengths), [7, 7, 11, 11, 11])
    assert played.diverged == [0, 0]


def test_diverged_first_episodes_are_counted() -> None:
    robot = prepare(load("cheetah_2_back"))
    task = replace(robot.task, episode_length=5, qvel_noise=1e7)
    env = BatchEnv([robot.simulation, robot.simulation], [task, robot.task], [3, 1])
    played = play(env, lambda obs: [np.zeros((len(rows), 1)) for rows in obs])
    assert played.diverged == [3, 0]
    assert env.diverged[0] > 3  # later episodes go on diverging while the other robot plays
    np.testing.assert_array_equal(played.returns[0], 0)
