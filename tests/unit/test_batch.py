from __future__ import annotations

from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest

from morphkit.description import Description
from morphkit.errors import ConfigError
from morphkit.robots import load
from morphkit.simulation import Simulation, build
from morphkit_rl.envs.batch import BatchEnv
from morphkit_rl.envs.tasks import Task, task_for

UNUSUAL = b"""
<mujoco>
  <option timestep="0.01"/>
  <worldbody>
    <body name="base" pos="0 0 1">
      <geom size=".1"/>
      <body name="wheel" pos="0 0 .2"><joint name="spin" axis="0 1 0"/><geom size=".1" pos=".1 0 0"/></body>
      <body name="drawer" pos=".5 0 0">
        <joint name="pull" type="slide" axis="1 0 0" range="-.2 .6" limited="true"/><geom size=".1"/>
        <body name="knob"><joint name="turn" type="ball"/><geom size=".05" pos=".1 0 0"/></body>
      </body>
      <body name="rail" pos="0 .5 0"><joint name="run" type="slide" axis="0 1 0"/><geom size=".1"/></body>
    </body>
  </worldbody>
  <actuator><motor joint="pull"/></actuator>
  <sensor><jointpos joint="pull"/><accelerometer site="s"/></sensor>
</mujoco>""".replace(b'<geom size=".1"/>\n', b'<geom size=".1"/><site name="s"/>\n', 1)


FAMILIES = ("cheetah_5_back", "walker_6_main", "humanoid_2d_7_left_leg", "hopper_4")


@cache
def simulation(robot: str) -> Simulation:
    if robot == "unusual":
        return build(Description("unusual", "unusual.xml", "mjcf", UNUSUAL))
    return build(load(robot))


def batch(
    robots: list[str], num_envs: int | list[int] = 2, task: dict[str, object] | None = None, **settings
) -> BatchEnv:
    simulations = [simulation(robot) for robot in robots]
    return BatchEnv(simulations, [replace(task_for(s), **(task or {})) for s in simulations], num_envs, **settings)


def roll(env: BatchEnv, steps: int, seed: int = 0) -> dict[str, list[np.ndarray]]:
    """Observations and rewards of a noisy episode of every robot, by name; each robot has its own actions."""
    seen: dict[str, list[np.ndarray]] = {}
    rngs = [np.random.default_rng([seed, len(spec.sensors)]) for spec in env.specs]
    for _ in range(steps):
        actions = [
            rng.uniform(-1, 1, (n, len(spec.actuators)))
            for rng, n, spec in zip(rngs, env.num_envs, env.specs, strict=True)
        ]
        step = env.step(actions)
        for spec, obs, final, reward in zip(env.specs, step.obs, step.final_obs, step.reward, strict=True):
            seen.setdefault(spec.morphology, []).append(np.concatenate([obs.ravel(), final.ravel(), reward]))
    return seen


def test_shapes_and_types() -> None:
    env = batch(["cheetah", "walker_4_main"], [2, 3])
    obs = env.reset()
    assert [o.shape for o in obs] == [(2, len(env.specs[0].sensors)), (3, len(env.specs[1].sensors))]
    step = env.step([np.zeros((2, 6)), np.zeros((3, 3))])
    assert [o.dtype for o in (*step.obs, *step.final_obs)] == [np.float32] * 4
    assert [r.dtype for r in step.reward] == [np.float64] * 2
    assert [t.dtype for t in (*step.terminated, *step.truncated)] == [np.bool_] * 4
    assert env.num_robots == 2
    assert env.num_envs == [2, 3]


@pytest.mark.parametrize("threads", [1, 2, 3])
@pytest.mark.parametrize("observation", ["fixed", "legacy"])
def test_results_depend_neither_on_grouping_nor_on_threads(threads: int, observation: str) -> None:
    """Restarts included: episodes are short here."""
    settings = {"task": {"episode_length": 23}, "seed": 4, "observation": observation}
    together = batch([*FAMILIES, "arm"], [3, 2, 1, 5, 2], num_threads=threads, **settings)
    starts = dict(zip(FAMILIES, together.reset(), strict=False))
    seen = roll(together, 50)
    order = [FAMILIES[3], FAMILIES[1]]
    other = batch(order, [5, 2], num_threads=2, **settings)
    for robot, start in zip(order, other.reset(), strict=True):
        np.testing.assert_array_equal(start, starts[robot])
    for robot, values in roll(other, 50).items():
        np.testing.assert_array_equal(values, seen[robot])
    alone = batch([FAMILIES[0]], 3, num_threads=1, **settings)
    np.testing.assert_array_equal(alone.reset()[0], starts[FAMILIES[0]])
    np.testing.assert_array_equal(roll(alone, 50)[FAMILIES[0]], seen[FAMILIES[0]])


@pytest.mark.parametrize("robot", ["cheetah", "walker_4_main", "humanoid_2d", "hopper_3", "arm", "quadruped"])
def test_physics_is_the_models_to_the_last_bit(robot: str) -> None:
    """What the batch leaves out of a step, such as sensors and the search for islands, has no part in its result."""
    env = batch([robot], task={"healthy_height": None, "healthy_pitch": None, "healthy_state": None})
    env.reset()
    model, skip = simulation(robot).model, env.tasks[0].frame_skip
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    for _ in range(40):
        low, high = np.array([(token.low, token.high) for token in env.specs[0].actuators]).T
        action = rng.uniform(low, high, (2, model.nu))
        qpos, qvel = env.state(0)
        env.step([action])
        mujoco.mj_resetData(model, data)
        data.qpos, data.qvel, data.ctrl = qpos[1], qvel[1], action[1]
        mujoco.mj_step(model, data, nstep=skip)
        np.testing.assert_array_equal(env.state(0)[0][1], data.qpos)
        np.testing.assert_array_equal(env.state(0)[1][1], data.qvel)


def test_the_simulator_takes_no_time_measurements() -> None:
    batch(["cheetah"])
    data = mujoco.MjData(simulation("cheetah").model)
    mujoco.mj_step(simulation("cheetah").model, data)
    assert data.timer[mujoco.mjtTimer.mjTIMER_STEP].duration == 0


def test_seed_changes_the_start() -> None:
    first, again, other = (batch(["cheetah"], seed=seed).reset()[0] for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 1e-3


def test_equal_robots_in_a_batch_start_differently() -> None:
    first, second = batch(["cheetah", "cheetah"]).reset()
    assert np.abs(first - second).max() > 1e-3


def test_state_dict_continues_exactly() -> None:
    settings = {"robots": ["walker", "arm"], "num_envs": 3}
    env = batch(**settings, seed=1)
    env.reset()
    roll(env, 25)
    saved = env.state_dict()
    expected = roll(env, 60, seed=2)
    resumed = batch(**settings, seed=99)
    resumed.load_state_dict({key: value.copy() for key, value in saved.items()})
    continued = roll(resumed, 60, seed=2)
    for robot, values in expected.items():
        np.testing.assert_array_equal(continued[robot], values)


def test_state_dict_of_other_robots_is_refused() -> None:
    with pytest.raises(ConfigError, match="does not fit"):
        batch(["walker"]).load_state_dict(batch(["cheetah"]).state_dict())


def test_truncation_restarts_in_the_same_step() -> None:
    env = batch(["cheetah"], task={"episode_length": 3})
    env.reset()
    total = np.zeros(2)
    for number in range(3):
        step = env.step([np.full((2, 6), 0.5)])
        total += step.reward[0]
        assert step.truncated[0].all() == (number == 2)
        assert not step.terminated[0].any()
    assert [(e.robot, e.env, e.length) for e in step.episodes] == [(0, 0, 3), (0, 1, 3)]
    np.testing.assert_allclose([e.episode_return for e in step.episodes], total)
    assert np.abs(step.obs[0] - step.final_obs[0]).max() > 0.01
    np.testing.assert_array_equal(step.obs[0], env.observe()[0])
    assert env.step([np.zeros((2, 6))]).episodes == []


def test_only_the_environment_that_ended_restarts() -> None:
    env = batch(["walker"], num_envs=3)
    env.reset()
    qpos, qvel = env.state(0)
    qpos[1, 1] = 0.5
    env.set_state(0, qpos, qvel)
    step = env.step([np.zeros((3, 6))])
    np.testing.assert_array_equal(step.terminated[0], [False, True, False])
    np.testing.assert_array_equal(step.obs[0][[0, 2]], step.final_obs[0][[0, 2]])
    assert step.final_obs[0][1, 2] < 1.0 < step.obs[0][1, 2]
    assert [(e.env, e.length) for e in step.episodes] == [(1, 1)]


def test_without_autoreset_an_ended_environment_stays() -> None:
    env = batch(["cheetah"], task={"episode_length": 1}, autoreset=False)
    env.reset()
    step = env.step([np.zeros((2, 6))])
    assert step.truncated[0].all()
    np.testing.assert_array_equal(step.obs[0], step.final_obs[0])


@pytest.mark.parametrize("wild", [1e9, 5e7])
@pytest.mark.parametrize("robot", FAMILIES)
def test_divergence_ends_one_episode_and_poisons_nothing(robot: str, wild: float, tmp_path, monkeypatch, capfd) -> None:
    monkeypatch.chdir(tmp_path)
    env, calm = batch([robot, "walker"], [3, 2]), batch([robot, "walker"], [3, 2])
    for e in (env, calm):
        e.reset()
    qpos, qvel = env.state(0)
    fast = qvel.copy()
    fast[1] = wild
    before = env.set_state(0, qpos, fast)
    calm.set_state(0, qpos, qvel)
    actions = [np.full((n, len(spec.actuators)), 0.2) for n, spec in zip((3, 2), env.specs, strict=True)]
    step, expected = env.step(actions), calm.step(actions)
    np.testing.assert_array_equal(step.terminated[0], [False, True, False])
    assert step.reward[0][1] == 0
    assert env.diverged.tolist() == [1, 0]
    assert [(e.robot, e.env, e.length, e.episode_return, e.diverged) for e in step.episodes] == [(0, 1, 1, 0.0, True)]
    np.testing.assert_array_equal(step.final_obs[0][1], before[1])
    for _ in range(20):
        np.testing.assert_array_equal(step.obs[0][[0, 2]], expected.obs[0][[0, 2]])
        np.testing.assert_array_equal(step.obs[1], expected.obs[1])
        np.testing.assert_array_equal(step.reward[1], expected.reward[1])
        assert np.isfinite(step.obs[0]).all()
        assert np.abs(step.reward[0]).max() < 100
        step, expected = env.step(actions), calm.step(actions)
    assert env.diverged.tolist() == [1, 0]
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr() == ("", "")


def test_warnings_still_reach_a_handler_of_ones_own() -> None:
    env, heard = batch(["cheetah"]), []
    qpos, qvel = env.state(0)
    mujoco.set_mju_user_warning(heard.append)
    try:
        env.set_state(0, qpos, qvel + 1e9)
        env.step([np.zeros((2, 6))])
    finally:
        mujoco.set_mju_user_warning(None)
    assert "unstable" in heard[0]


def test_actions_are_clipped_for_simulator_and_reward() -> None:
    far, near = batch(["cheetah"]), batch(["cheetah"])
    far.reset(), near.reset()
    first, second = far.step([np.full((2, 6), 7.0)]), near.step([np.full((2, 6), 1.0)])
    np.testing.assert_array_equal(first.obs[0], second.obs[0])
    np.testing.assert_array_equal(first.reward[0], second.reward[0])


@pytest.mark.parametrize("action", [np.zeros((2, 5)), np.zeros((1, 6)), np.full((2, 6), np.nan)])
def test_bad_actions_are_refused(action: np.ndarray) -> None:
    env = batch(["cheetah"])
    env.reset()
    with pytest.raises(ValueError, match="actions must"):
        env.step([action])


def test_set_state_refuses_what_does_not_fit_and_changes_nothing() -> None:
    env = batch(["cheetah"])
    env.reset()
    qpos, qvel = env.state(0)
    with pytest.raises(ValueError, match=r"qvel must have shape \(2, 9\)"):
        env.set_state(0, np.zeros((2, 9)), np.zeros((2, 8)))
    np.testing.assert_array_equal(env.state(0)[0], qpos)
    np.testing.assert_array_equal(env.state(0)[1], qvel)


def test_reset_noise_is_the_tasks() -> None:
    env = batch(["walker"], num_envs=500)
    env.reset()
    qpos, qvel = env.state(0)
    offset = qpos - simulation("walker").model.qpos0
    assert 0.0049 < np.abs(offset).max() <= 0.005
    assert 0.0049 < np.abs(qvel).max() <= 0.005
    env = batch(["cheetah"], num_envs=500)
    env.reset()
    qpos, qvel = env.state(0)
    assert 0.099 < np.abs(qpos).max() <= 0.1
    assert qvel.std() == pytest.approx(0.1, rel=0.05)


def test_angles_of_unusual_joints() -> None:
    env = batch(["unusual"], num_envs=1)
    own = env.specs[0]
    place = {sensor.name: sensor.index for sensor in own.sensors}
    qpos = np.zeros((1, simulation("unusual").model.nq))
    names = [simulation("unusual").model.joint(j).name for j in range(4)]
    at = dict(zip(names, simulation("unusual").model.jnt_qposadr, strict=True))
    qpos[0, at["spin"]] = 1.5 * np.pi
    qpos[0, at["pull"]] = 0.2
    qpos[0, at["run"]] = 3.5
    qpos[0, at["turn"] : at["turn"] + 4] = [np.cos(0.4), 0, np.sin(0.4), 0]
    obs = env.set_state(0, qpos, np.zeros((1, simulation("unusual").model.nv)))[0]
    values = {
        "wheel_angle": -0.25,
        "wheel_joint_range_low": 0.0,
        "wheel_joint_range_high": 1.0,
        "drawer_angle": 0.2,
        "drawer_joint_range_low": -0.2,
        "drawer_joint_range_high": 0.6,
        "rail_angle": 3.5,
        "knob_angle": 0.8 / (2 * np.pi),
        "base_angle": 0.0,
        "drawer_position_x": 0.7,
        "wheel_exponential_map_y": -np.pi / 2,
    }
    for name, value in values.items():
        assert obs[place[name]] == pytest.approx(value, abs=1e-6), name


def test_unbounded_actions_are_not_clipped() -> None:
    env = batch(["unusual"], num_envs=1, task={"qpos_noise": 0.0, "qvel_noise": 0.0})
    env.reset()
    small = env.step([np.array([[1.0]])]).obs[0].copy()
    env.reset()
    large = env.step([np.array([[30.0]])]).obs[0]
    assert np.abs(small - large).max() > 0.01


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([], [], 1), "no robot"),
        ((["cheetah"], [], 1), "as many tasks"),
        ((["cheetah"], ["cheetah"], 0), "at least one environment"),
    ],
)
def test_impossible_batches_are_refused(arguments: tuple, message: str) -> None:
    robots, tasks, num_envs = arguments
    with pytest.raises(ConfigError, match=message):
        BatchEnv([simulation(r) for r in robots], [task_for(simulation(t)) for t in tasks], num_envs)


def test_an_incomplete_task_is_refused() -> None:
    with pytest.raises(ConfigError, match="task_for"):
        BatchEnv([simulation("cheetah")], [Task("mine", frame_skip=None)], 1)


def test_unknown_observation_is_refused() -> None:
    with pytest.raises(ConfigError, match="'fixed' or 'legacy'"):
        batch(["cheetah"], observation="both")
