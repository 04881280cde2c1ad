from __future__ import annotations

import re
import subprocess
import sys
import warnings
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

import morphkit_rl  # noqa: F401  (registers the ids)
from morphkit.errors import UnknownNameError
from morphkit.registry import recipes, shipped

EXPECTED_WARNINGS = ("observation space m", "recommend using a symmetric and normalized space")
"""Observation boxes are unbounded, and torques are in N*m: Gymnasium advises against both."""


def test_every_shipped_robot_and_recipe_has_an_id() -> None:
    names = [robot.name for robot in shipped()]
    names += [recipe for robot in shipped() for recipe in recipes(robot.name)]
    assert len(names) >= 7 + 32
    assert {f"morphkit/{name}-v0" for name in names} <= set(gymnasium.registry)


@pytest.mark.parametrize("robot", ["cheetah", "walker_4_main", "arm", "quadruped", "planar_cheetah"])
def test_check_env(robot: str) -> None:
    env = gymnasium.make(f"morphkit/{robot}-v0")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(env.unwrapped, skip_render_check=True)
    unexpected = [str(w.message) for w in caught if not any(known in str(w.message) for known in EXPECTED_WARNINGS)]
    assert unexpected == []
    env.close()


def test_spaces_are_those_of_the_tokens() -> None:
    env = gymnasium.make("morphkit/quadruped-v0")
    spec = env.unwrapped.token_spec
    assert env.observation_space.shape == (len(spec.sensors),)
    assert env.observation_space.dtype == env.action_space.dtype == np.float32
    np.testing.assert_array_equal(env.action_space.low, [token.low for token in spec.actuators])
    np.testing.assert_array_equal(env.action_space.high, [token.high for token in spec.actuators])


def test_vector_environment_restarts_in_the_same_step() -> None:
    env = gymnasium.make_vec("morphkit/walker-v0", num_envs=4)
    assert env.metadata["autoreset_mode"] == AutoresetMode.SAME_STEP
    env.reset(seed=3)
    env.action_space.seed(0)
    for _ in range(300):
        obs, _, terminated, truncated, infos = env.step(env.action_space.sample())
        assert obs.shape == (4, 133)
        ended = terminated | truncated
        if not ended.any():
            assert not [key for key in infos if "final" in key]
            continue
        np.testing.assert_array_equal(infos["_final_obs"], ended)
        np.testing.assert_array_equal(infos["_final_info"], ended)
        for i in range(4):
            if ended[i]:
                assert infos["final_obs"][i].shape == (133,)
                assert np.abs(infos["final_obs"][i] - obs[i]).max() > 0.01
                assert infos["final_info"]["length"][i] > 0
            else:
                assert infos["final_obs"][i] is None
        return
    pytest.fail("no walker fell")


def test_infos_look_like_gymnasiums_own() -> None:
    theirs = gymnasium.make_vec(
        "CartPole-v1",
        num_envs=3,
        vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": AutoresetMode.SAME_STEP},
    )
    ours = gymnasium.make_vec("morphkit/walker-v0", num_envs=3)
    seen = []
    for env in (theirs, ours):
        env.reset(seed=0)
        env.action_space.seed(0)
        infos: dict = {}
        while "final_info" not in infos:
            infos = env.step(env.action_space.sample())[4]
        final = {key: value for key, value in infos.items() if "final" in key}
        seen.append({key: (type(value), getattr(value, "dtype", None)) for key, value in final.items()})
    assert seen[0] == seen[1]


def test_seeds() -> None:
    env = gymnasium.make_vec("morphkit/cheetah-v0", num_envs=3)
    first, again, other = (env.reset(seed=seed)[0] for seed in (7, 7, 8))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 1e-3
    assert np.abs(first[0] - first[1]).max() > 1e-3
    later = env.reset()[0]
    assert np.abs(later - other).max() > 1e-3
    np.testing.assert_array_equal(env.reset(seed=[1, 2, 3])[0], env.reset(seed=[1, 2, 3])[0])


def test_threads_do_not_change_results() -> None:
    envs = [gymnasium.make_vec("morphkit/humanoid_2d_8_left_knee-v0", num_envs=5, num_threads=n) for n in (1, 2, 4)]
    starts = [env.reset(seed=2)[0] for env in envs]
    np.testing.assert_array_equal(starts[0], starts[1])
    for _ in range(60):
        action = envs[0].action_space.sample()
        first, *others = [env.step(action) for env in envs]
        for other in others:
            for one, same in zip(first[:4], other[:4], strict=True):
                np.testing.assert_array_equal(one, same)


def test_observation_modes_of_the_vector_environment() -> None:
    fixed, legacy = (
        gymnasium.make_vec("morphkit/cheetah-v0", num_envs=2, observation=mode) for mode in ("fixed", "legacy")
    )
    qpos, qvel = np.zeros((2, 9)), np.zeros((2, 9))
    qpos[:, 0] = 3.0
    fixed.reset(), legacy.reset()
    difference = legacy.unwrapped.set_state(qpos, qvel) - fixed.unwrapped.set_state(qpos, qvel)
    limbs = difference.reshape(2, 7, 19)
    np.testing.assert_allclose(limbs[:, 0], 0, atol=1e-6)
    np.testing.assert_allclose(limbs[:, 1:, 0], 3.0, atol=1e-6)
    np.testing.assert_allclose(limbs[:, 1:, 1:], 0, atol=1e-6)


def test_observations_of_some_sensors() -> None:
    settings = {"sensors": ["position", "translational_velocity"], "limb_names": "joint", "text_style": "raw"}
    env = gymnasium.make("morphkit/humanoid_2d_7_left_arm-v0", **settings)
    vector = gymnasium.make_vec("morphkit/humanoid_2d_7_left_arm-v0", num_envs=2, observation="legacy", **settings)
    assert env.observation_space.shape == vector.single_observation_space.shape == (7 * 6,)
    assert env.reset(seed=0)[0].shape == (42,)
    assert vector.reset(seed=0)[0].shape == (2, 42)
    assert vector.step(vector.action_space.sample())[0].shape == (2, 42)
    spec = env.unwrapped.token_spec
    assert spec.sensors[6].text == "right_hip_y_position_x"
    assert spec == vector.unwrapped.token_spec
    with pytest.raises(UnknownNameError, match="did you mean 'position'"):
        gymnasium.make("morphkit/cheetah-v0", sensors=["positions"])


def test_state_of_a_single_environment() -> None:
    env = gymnasium.make("morphkit/cheetah-v0")
    env.reset(seed=0)
    qpos, qvel = np.linspace(-0.1, 0.1, 9), np.linspace(0, 1, 9)
    obs = env.unwrapped.set_state(qpos, qvel)
    assert obs.shape == (133,)
    got = env.unwrapped.state()
    assert [part.dtype for part in got] == [np.float64, np.float64]
    np.testing.assert_array_equal(got[0], qpos)
    np.testing.assert_array_equal(got[1], qvel)


def test_single_environment_stays_at_its_last_state() -> None:
    env = gymnasium.make("morphkit/walker-v0")
    env.reset(seed=0)
    qpos, qvel = env.unwrapped.state()
    qpos[1] = 0.5
    env.unwrapped.set_state(qpos, qvel)
    _, _, terminated, _, _ = env.step(np.zeros(6, np.float32))
    assert terminated
    assert env.unwrapped.state()[0][1] < 0.6


@pytest.mark.parametrize("robot", ["cheetah", "walker", "humanoid_2d", "hopper"])
def test_divergence_is_reported_and_poisons_nothing(robot: str, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    single = gymnasium.make(f"morphkit/{robot}-v0")
    vector = gymnasium.make_vec(f"morphkit/{robot}-v0", num_envs=3)
    single.reset(seed=0), vector.reset(seed=0)
    qpos, qvel = vector.unwrapped.state()
    qvel[1] = 1e9
    single.unwrapped.set_state(qpos[1], qvel[1])
    vector.unwrapped.set_state(qpos, qvel)
    obs, reward, terminated, _, info = single.step(np.zeros(single.action_space.shape, np.float32))
    assert np.isfinite(obs).all()
    assert (reward, terminated, info["return"], info["length"], info["diverged"]) == (0.0, True, 0.0, 1, True)
    assert info["x_velocity"] == 0
    assert np.isfinite(single.reset()[0]).all()
    obs, reward, terminated, _, infos = vector.step(np.zeros(vector.action_space.shape, np.float32))
    np.testing.assert_array_equal(terminated, [False, True, False])
    np.testing.assert_array_equal(infos["final_info"]["diverged"], [False, True, False])
    assert np.isfinite(obs).all()
    assert np.isfinite(reward).all()
    assert np.isfinite(infos["final_obs"][1]).all()
    assert list(tmp_path.iterdir()) == []


def test_the_examples_of_the_documentation_run(monkeypatch: pytest.MonkeyPatch) -> None:
    root = Path(__file__).parents[4]
    monkeypatch.chdir(root)
    blocks = re.findall(r"```python\n(.*?)```", (root / "docs" / "environments.md").read_text(), re.DOTALL)
    assert len(blocks) == 2
    for block in blocks:
        exec(block, {})


def test_import_registers_without_loading_torch_or_mujoco() -> None:
    code = (
        "import sys, gymnasium, morphkit_rl; "
        "assert 'morphkit/cheetah-v0' in gymnasium.registry; "
        "print([m for m in ('torch', 'mujoco', 'transformers', 'yourdfpy') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
