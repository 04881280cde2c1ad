"""States, rewards, endings and observations of eight benchmark robots against stored reference numbers.

`tests/data/trajectories.npz` holds float64 numbers measured with MuJoCo 4.0.0 on the published robots:
`<robot>/<start|probe|fast_probe|turned_probe>/<qpos|qvel|fixed|legacy>`, 25 steps in
`<robot>/<ctrl|qpos|qvel|reward|terminated>`, and `<robot>/fall/...`: a tilted start with zero controls until the step
that terminates.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import morphkit_rl  # noqa: F401  (registers the ids)
from morphkit.registry import load
from morphkit.simulation.build import Simulation, build_simulation
from morphkit_rl.envs.batch_env import BatchEnv
from morphkit_rl.envs.tasks import task_for

DATA = Path(__file__).parents[3] / "data" / "trajectories.npz"
NUMBERS = dict(np.load(DATA))
ROBOTS = sorted({key.split("/")[0] for key in NUMBERS})
PROBES = ("start", "probe", "fast_probe", "turned_probe")


@cache
def simulation(robot: str) -> Simulation:
    return build_simulation(load(robot))


def reference(robot: str, *keys: str) -> np.ndarray:
    return NUMBERS["/".join((robot, *keys))]


def repeated(robot: str, *keys: str, n: int = 3) -> np.ndarray:
    return np.tile(reference(robot, *keys), (n, 1))


def test_the_reference_covers_eight_robots() -> None:
    assert len(ROBOTS) == 8


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("observation", ["fixed", "legacy"])
def test_observations_of_a_batch(robot: str, observation: str) -> None:
    own = simulation(robot)
    other = simulation("cheetah_3_balanced")
    env = BatchEnv([other, own], [task_for(other), task_for(own)], [2, 3], observation=observation)
    for probe in PROBES:
        obs = env.set_state(1, repeated(robot, probe, "qpos"), repeated(robot, probe, "qvel"))
        np.testing.assert_allclose(obs, repeated(robot, probe, observation), atol=1e-5, err_msg=probe)
    env.close()


def test_observation_modes_differ() -> None:
    for robot in ROBOTS:
        assert np.abs(reference(robot, "probe", "fixed") - reference(robot, "probe", "legacy")).max() > 1


@pytest.mark.parametrize("robot", ROBOTS)
def test_trajectory_of_a_batch_next_to_another_robot(robot: str) -> None:
    own = simulation(robot)
    other = simulation("walker_4_main")
    env = BatchEnv([own, other], [task_for(own), task_for(other)], [3, 2], num_threads=2)
    env.reset()
    env.set_state(0, repeated(robot, "start", "qpos"), repeated(robot, "start", "qvel"))
    idle = np.zeros((2, other.model.nu))
    for step, ctrl in enumerate(reference(robot, "ctrl")):
        result = env.step([np.tile(ctrl, (3, 1)), idle])
        np.testing.assert_allclose(result.reward[0], reference(robot, "reward")[step], atol=1e-4)
        assert (result.terminated[0] == reference(robot, "terminated")[step]).all()
        qpos, qvel = env.state(0)
        np.testing.assert_allclose(qpos, np.tile(reference(robot, "qpos")[step], (3, 1)), atol=1e-6)
        np.testing.assert_allclose(qvel, np.tile(reference(robot, "qvel")[step], (3, 1)), atol=1e-6)
    env.close()


@pytest.mark.parametrize("robot", ROBOTS)
def test_trajectory_of_the_single_environment(robot: str) -> None:
    env = gymnasium.make(f"morphkit/{robot}-v0")
    env.reset(seed=0)
    obs = env.unwrapped.set_state(reference(robot, "start", "qpos"), reference(robot, "start", "qvel"))
    np.testing.assert_allclose(obs, reference(robot, "start", "fixed"), atol=1e-5)
    for step, ctrl in enumerate(reference(robot, "ctrl")):
        obs, reward, terminated, truncated, _ = env.step(ctrl)
        assert reward == pytest.approx(reference(robot, "reward")[step], abs=1e-4)
        assert (terminated, truncated) == (bool(reference(robot, "terminated")[step]), False)
    qpos, qvel = env.unwrapped.state()
    np.testing.assert_allclose(qpos, reference(robot, "qpos")[-1], atol=1e-6)
    np.testing.assert_allclose(qvel, reference(robot, "qvel")[-1], atol=1e-6)
    env.close()


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("observation", ["fixed", "legacy"])
def test_fall_in_the_vector_environment(robot: str, observation: str) -> None:
    env = gymnasium.make_vec(f"morphkit/{robot}-v0", num_envs=3, observation=observation)
    env.reset(seed=0)
    env.unwrapped.set_state(repeated(robot, "fall", "start_qpos"), repeated(robot, "fall", "start_qvel"))
    expected = reference(robot, "fall", "terminated")
    for step, reward in enumerate(reference(robot, "fall", "reward")):
        qpos, _ = env.unwrapped.state()
        if step:
            np.testing.assert_allclose(qpos, np.tile(reference(robot, "fall", "qpos")[step - 1], (3, 1)), atol=1e-6)
        _, rewards, terminated, truncated, infos = env.step(np.zeros(env.action_space.shape, np.float32))
        np.testing.assert_allclose(rewards, reward, atol=1e-4)
        assert (terminated == expected[step]).all()
        assert not truncated.any()
        assert ("final_obs" in infos) == bool(expected[step])
    env.close()
