"""Vector environments under Gymnasium's conventions: time limits, autoreset modes, infos and wrappers."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import NormalizeObservation, RecordEpisodeStatistics

import morphkit_rl  # noqa: F401  (registers the ids)
from morphkit.errors import ConfigError
from morphkit_rl.envs.registration import MAX_EPISODE_STEPS
from morphkit_rl.envs.tasks import TASKS

MODES = list(AutoresetMode)
TERMS = ("reward_forward", "reward_alive", "reward_control", "reward_tip")


def walkers(mode: AutoresetMode | str = AutoresetMode.SAME_STEP, **settings):
    env = gymnasium.make_vec("morphkit/walker-v0", num_envs=4, autoreset_mode=mode, **settings)
    env.reset(seed=3)
    env.action_space.seed(0)
    return env


def test_the_registered_length_is_that_of_every_task() -> None:
    assert {task.episode_length for task in TASKS.values()} == {MAX_EPISODE_STEPS}
    assert gymnasium.make("morphkit/cheetah-v0").spec.max_episode_steps == MAX_EPISODE_STEPS
    assert gymnasium.make_vec("morphkit/cheetah-v0", num_envs=2).spec.max_episode_steps == MAX_EPISODE_STEPS


@pytest.mark.parametrize("steps", [1, 50])
def test_a_time_limit_of_ones_own(steps: int) -> None:
    single = gymnasium.make("morphkit/cheetah-v0", max_episode_steps=steps)
    many = gymnasium.make_vec("morphkit/cheetah-v0", num_envs=2, max_episode_steps=steps)
    single.reset(seed=0), many.reset(seed=0)
    for number in range(1, steps + 1):
        last = number == steps
        assert single.step(single.action_space.sample())[2:4] == (False, last)
        *_, terminated, truncated, infos = many.step(many.action_space.sample())
        assert not terminated.any()
        assert truncated.tolist() == [last, last]
    assert infos["final_info"]["length"].tolist() == [steps, steps]


def test_a_longer_time_limit_than_the_tasks() -> None:
    env = gymnasium.make("morphkit/hopper-v0", max_episode_steps=MAX_EPISODE_STEPS + 5, task="locomotion")
    env.reset(seed=0)
    assert env.unwrapped._batch.tasks[0].episode_length > MAX_EPISODE_STEPS + 5
    with pytest.raises(ConfigError, match="max_episode_steps must be at least 1"):
        gymnasium.make_vec("morphkit/hopper-v0", num_envs=2, max_episode_steps=0)


@pytest.mark.parametrize("mode", MODES)
def test_modes_give_what_gymnasiums_own_vector_environment_gives(mode: AutoresetMode) -> None:
    ours = walkers(mode, max_episode_steps=20)
    theirs = gymnasium.make_vec(
        "morphkit/walker-v0", num_envs=4, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode},
        max_episode_steps=20,
    )  # fmt: skip
    theirs.reset(seed=3)
    assert ours.metadata["autoreset_mode"] == theirs.metadata["autoreset_mode"] == mode
    for number in range(1, 48):
        for env in (ours, theirs):
            obs, reward, terminated, truncated, infos = env.step(np.zeros(env.action_space.shape, np.float32))
            ended = terminated | truncated
            late = mode == AutoresetMode.NEXT_STEP
            assert ended.all() == (number % 21 == 20 if late else number % 20 == 0)
            assert ("final_info" in infos) == (mode == AutoresetMode.SAME_STEP and bool(ended.all()))
            if late and number % 21 == 0:
                assert (reward == 0).all()
                assert "x_velocity" not in infos or not infos["_x_velocity"].any()
            if mode == AutoresetMode.DISABLED and ended.any():
                env.reset(options={"reset_mask": ended})
    assert obs.shape == (4, 133)


def test_next_step_begins_the_next_episode_where_it_starts() -> None:
    env = walkers("next_step", max_episode_steps=3)
    for _ in range(3):
        env.step(np.zeros(env.action_space.shape))
    bad = np.full(env.action_space.shape, np.nan)
    obs, reward, terminated, truncated, infos = env.step(bad)
    qpos, qvel = env.unwrapped.state()
    np.testing.assert_array_equal(obs, env.unwrapped.set_state(qpos, qvel))
    assert np.abs(qvel).max() < 0.05
    assert not (terminated | truncated).any()
    assert (reward == 0).all()
    assert not infos["_x_velocity"].any()


def test_only_one_environment_ends() -> None:
    env = walkers(AutoresetMode.NEXT_STEP)
    while True:
        _, _, terminated, _, infos = env.step(env.action_space.sample())
        if terminated.any():
            break
    assert not terminated.all()
    np.testing.assert_array_equal(infos["_return"], terminated)
    assert (infos["length"][terminated] > 5).all()
    _, reward, *_ = env.step(env.action_space.sample())
    assert (reward[terminated] == 0).all()
    assert (reward[~terminated] != 0).all()


def test_without_autoreset_an_episode_that_is_over_must_be_reset() -> None:
    env = walkers(AutoresetMode.DISABLED, max_episode_steps=2)
    for _ in range(2):
        obs = env.step(env.action_space.sample())[0]
    mask = np.array([True, False, True, False])
    again = env.reset(options={"reset_mask": mask})[0]
    np.testing.assert_array_equal(again[~mask], obs[~mask])
    assert np.abs(again[mask] - obs[mask]).max() > 1e-3
    with pytest.raises(ValueError, match="episodes of environments 1, 3 are over"):
        env.step(env.action_space.sample())
    env.reset(options={"reset_mask": ~mask})
    env.step(env.action_space.sample())


@pytest.mark.parametrize("mask", [[True], np.zeros(4, bool), np.ones(4, int), "all"])
def test_a_wrong_mask_is_refused(mask) -> None:
    with pytest.raises(ConfigError, match="reset_mask must be 4 booleans"):
        walkers().reset(options={"reset_mask": mask})


def test_an_unknown_mode_is_refused() -> None:
    with pytest.raises(ConfigError, match="autoreset_mode must be one of"):
        walkers("sometimes")


@pytest.mark.parametrize("robot", ["cheetah", "walker", "hopper", "arm", "quadruped"])
def test_rewards_are_the_sums_of_their_terms(robot: str) -> None:
    env = gymnasium.make(f"morphkit/{robot}-v0")
    env.action_space.seed(1)
    env.reset(seed=1)
    for _ in range(5):
        x = env.unwrapped.state()[0][0]
        _, reward, _, _, info = env.step(env.action_space.sample())
        terms = {name: value for name, value in info.items() if name.startswith("reward_")}
        assert reward == pytest.approx(sum(terms.values()), abs=1e-9)
        assert (tuple(terms) == TERMS) == (robot != "quadruped")
        if robot != "arm":
            moved = env.unwrapped.state()[0][0] - x
            assert info["x_velocity"] * env.unwrapped.metadata["render_fps"] ** -1 == pytest.approx(
                moved, rel=0.1, abs=1e-3
            )
        else:
            assert info["x_velocity"] == 0


def test_gymnasiums_wrappers() -> None:
    env = NormalizeObservation(RecordEpisodeStatistics(walkers(AutoresetMode.NEXT_STEP, max_episode_steps=30)))
    env.reset(seed=0)
    returns = np.zeros(4)
    for _ in range(30):
        obs, reward, _, _, infos = env.step(env.action_space.sample())
        returns += reward
        if "episode" in infos:
            break
    assert np.abs(obs).max() < 10
    ended = infos["_episode"]
    np.testing.assert_allclose(infos["episode"]["r"][ended], returns[ended])
    np.testing.assert_allclose(infos["return"][ended], returns[ended])
