"""Commands, pushes and differences between episodes, and that a step depends on the saved state alone."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from morphkit.errors import ConfigError
from morphkit.registry import load
from morphkit_rl.envs.batch_env import BatchEnv
from morphkit_rl.envs.robot import Robot, prepare
from morphkit_rl.envs.task_settings import Commands, Pushes, Randomization
from morphkit_rl.envs.tasks import task_for
from morphkit_rl.evaluation.episodes import play, random_controller

QUADRUPED = prepare(load("quadruped"))
QUIET = replace(QUADRUPED.task, qpos_noise=0.0, qvel_noise=0.0)
N = 4


def batch(seed: int = 0, num_threads: int = 1, robots: tuple[Robot, ...] = (QUADRUPED,), **changes) -> BatchEnv:
    tasks = [replace(QUIET if robot is QUADRUPED else robot.task, **changes) for robot in robots]
    specs = [robot.spec for robot in robots]
    simulations = [robot.simulation for robot in robots]
    return BatchEnv(simulations, tasks, N, specs=specs, seed=seed, num_threads=num_threads)


def commands(obs: np.ndarray) -> np.ndarray:
    return obs[:, -3:]


def still(env: BatchEnv):
    return env.step([np.zeros((N, len(spec.actuators))) for spec in env.specs])


def test_commands_are_drawn_anew_within_and_between_episodes() -> None:
    told = Commands(x=(0.5, 1.0), y=(-0.2, 0.2), yaw=(0.3, 0.3), seconds=0.1)
    env = batch(commands=told, episode_length=12)
    seen = [commands(env.reset()[0])]
    seen += [commands(still(env).obs[0]) for _ in range(13)]
    changes = [i for i, (a, b) in enumerate(pairwise(seen), 1) if (a != b).any()]
    assert changes == [5, 10, 12]
    together = np.concatenate(seen)
    low, high = together.min(0), together.max(0)
    assert 0.5 <= low[0] < high[0] <= 1
    assert -0.2 <= low[1] < 0 < high[1] <= 0.2
    np.testing.assert_allclose(together[:, 2], 0.3, rtol=1e-6)


def test_a_command_is_observed_before_it_counts() -> None:
    """Rewards are for the command that the action was chosen under."""
    env = batch(commands=Commands(x=(0.5, 1.0), seconds=0.02))
    obs = env.reset()[0]
    for _ in range(3):
        before, step = commands(obs)[:, 0].astype(float), still(env)
        obs = step.obs[0]
        robot = env._tasks._parts[0].arrays
        expected = (robot.velocity[:, 0] / before).clip(-1, 1)
        np.testing.assert_allclose(env.reward_terms(0)["reward_progress"], expected, atol=1e-6)
        assert (commands(obs)[:, 0] != before).all()


def test_who_heads_off_is_told_to_turn_back() -> None:
    """Already where an episode ends, and before a step is rewarded."""
    env = batch(commands=Commands(x=(0.5, 1.0), heading=0.8), episode_length=2)
    env.reset()
    model = QUADRUPED.simulation.model
    qpos, angles = np.tile(model.qpos0, (N, 1)), np.array([0.0, 0.5, -0.5, 2.0])
    qpos[:, 3], qpos[:, 6] = np.cos(angles / 2), np.sin(angles / 2)
    obs = env.set_state(0, qpos, np.zeros((N, model.nv)))
    np.testing.assert_allclose(commands(obs)[:, 2], [0, -0.4, 0.4, -1], atol=1e-6)
    step = still(env)
    np.testing.assert_allclose(commands(step.obs[0])[:, 2], [0, -0.4, 0.4, -1], atol=0.05)
    step = still(env)
    assert step.truncated[0].all()
    np.testing.assert_allclose(commands(step.final_obs[0])[:, 2], [0, -0.4, 0.4, -1], atol=0.1)
    np.testing.assert_allclose(commands(step.obs[0])[:, 2], 0, atol=1e-6)


@pytest.mark.parametrize("base", ["free", "planar"])
def test_pushes(base: str) -> None:
    robot = prepare(load("quadruped"), base=base, task="walk")
    task = {"qpos_noise": 0.0, "qvel_noise": 0.0}
    rest, pushed = (batch(robots=(robot,), pushes=p, **task) for p in (Pushes(), Pushes(seconds=0.06, speed=0.4)))
    first = int(robot.simulation.model.jnt_dofadr[robot.simulation.base_joints[0]])
    for env in (rest, pushed):
        env.reset()
    for number in range(5):
        for env in (rest, pushed):
            still(env)
        difference = np.abs(pushed.state(0)[1] - rest.state(0)[1]).max(1)
        assert ((difference > 0.001) == (number >= 3)).all()
    change = pushed.state(0)[1][:, first] - rest.state(0)[1][:, first]
    assert 0.01 < np.abs(change).max() < 0.8
    assert len(set(np.round(change, 6))) == N


def test_episodes_differ_in_friction_masses_and_gains() -> None:
    env = batch(randomize=Randomization(friction=(0.5, 0.9), mass=(1.5, 2.0), gain=(0.7, 0.7)), episode_length=3)
    base, models = env._robots[0].model, env._robots[0].models
    env.reset()
    first = [model.body_mass[2] / base.body_mass[2] for model in models]
    for model in models:
        friction, mass = (model.geom_friction / base.geom_friction)[:, 0], model.body_mass[1:] / base.body_mass[1:]
        assert np.ptp(friction) < 1e-9
        assert np.ptp(mass) < 1e-9
        assert 0.5 <= friction[0] <= 0.9
        assert 1.5 <= mass[0] <= 2.0
        np.testing.assert_allclose(model.body_inertia[1:], base.body_inertia[1:] * mass[0])
        assert model.body_subtreemass[0] == pytest.approx(base.body_subtreemass[0] * mass[0])
        np.testing.assert_allclose(model.actuator_gainprm, base.actuator_gainprm * 0.7)
        np.testing.assert_allclose(model.actuator_biasprm, base.actuator_biasprm * 0.7)
    assert len(set(first)) == N
    for _ in range(3):
        still(env)
    assert not set(first) & {model.body_mass[2] / base.body_mass[2] for model in models}
    np.testing.assert_array_equal(base.body_mass, QUADRUPED.simulation.model.body_mass)


EVERYTHING = {
    "randomize": Randomization(mass=(0.8, 1.2)),
    "pushes": Pushes(seconds=0.1, speed=0.5),
    "commands": Commands(x=(0.5, 1.0), seconds=0.14),
    "episode_length": 20,
}


def rollout(env: BatchEnv, steps: int) -> list[np.ndarray]:
    rng = np.random.default_rng(4)
    widths = [len(spec.actuators) for spec in env.specs]
    results = [env.step([rng.uniform(-0.5, 0.5, (N, width)) for width in widths]) for _ in range(steps)]
    return [array for step in results for array in (*step.obs, *step.reward)]


def test_a_saved_state_continues_exactly() -> None:
    robots = (prepare(load("hopper")), QUADRUPED)
    one = batch(robots=robots, **EVERYTHING)
    one.reset()
    rollout(one, 17)
    saved = one.state_dict()
    ahead = rollout(one, 30)
    other = batch(seed=9, robots=robots, **EVERYTHING)
    other.load_state_dict(saved)
    for a, b in zip(ahead, rollout(other, 30), strict=True):
        np.testing.assert_array_equal(a, b)
    with pytest.raises(ConfigError, match="'tasks' does not fit"):
        other.load_state_dict({key: value for key, value in saved.items() if key != "tasks"})


def test_neither_threads_nor_other_robots_change_anything() -> None:
    alone, among = batch(**EVERYTHING), batch(num_threads=3, robots=(prepare(load("hopper")), QUADRUPED), **EVERYTHING)
    for env in (alone, among):
        env.reset()
    for _ in range(25):
        actions = np.random.default_rng(1).uniform(-0.5, 0.5, (N, 12))
        one, other = alone.step([actions]), among.step([np.zeros((N, 4)), actions])
        np.testing.assert_array_equal(one.obs[0], other.obs[1])
        np.testing.assert_array_equal(one.reward[0], other.reward[1])


def test_tasks_without_terms_keep_nothing() -> None:
    hopper = prepare(load("hopper"))
    env = BatchEnv([hopper.simulation], [hopper.task], 2, num_threads=1)
    assert "tasks" not in env.state_dict()


def test_speeds_follow_from_size() -> None:
    task = task_for(QUADRUPED.simulation, "walk")
    unit = np.sqrt(9.81 * QUADRUPED.simulation.model.qpos0[2])
    assert task.speed_unit == pytest.approx(unit)
    assert task.commands.x == pytest.approx((0.3 * unit, 0.5 * unit))
    arm = prepare(load("arm")).simulation
    with pytest.raises(ConfigError, match="base is fixed"):
        task_for(arm, "walk")


@pytest.mark.parametrize(("controller", "share"), [("still", 0.25), ("random", 0.1)])
def test_walking_alone_is_worth_much(controller: str, share: float) -> None:
    """Episodes of the shipped quadruped on the task that it gets: what earns less than `share` of the most."""
    n, task = 6, replace(QUADRUPED.task, episode_length=300)
    env = BatchEnv([QUADRUPED.simulation], [task], n, specs=[QUADRUPED.spec], seed=0)
    act = random_controller(env, 0) if controller == "random" else lambda _: [np.zeros((n, 12))]
    returns = play(env, act).returns[0]
    assert task.most == pytest.approx(2.1)
    assert returns.mean() < share * task.most * task.episode_length
    assert controller == "random" or returns.min() > 0
