"""Critics that see more than the policy: `trainer.critic_sensors`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from morphkit.errors import ConfigError, UnknownNameError
from morphkit.registry import load
from morphkit_rl.config.train_config import TrainConfig, load_config
from morphkit_rl.envs.selection import sensor_columns
from morphkit_rl.evaluation.evaluate import evaluate
from morphkit_rl.runs import run_settings
from morphkit_rl.training.session import Session
from morphkit_rl.training.trainer import resume, train
from tests.support.run_folders import assert_same, small_config

ROBOTS = ("hopper", "walker")


def settings(*overrides: str) -> TrainConfig:
    return small_config("trainer.sensors=proprioceptive", "td3.n_step=2", "trainer.critic_sensors=[]", *overrides)


def asymmetric(*overrides: str) -> TrainConfig:
    return settings("trainer.critic_sensors=all", *overrides)


def session(config: TrainConfig) -> Session:
    robots = tuple(load(name) for name in ROBOTS)
    return Session(
        run_settings.RunSettings(
            robots, (), (), config, None, None, seed=0, minutes=None, steps=8, device="cpu", threads=1
        )
    )


def test_a_run_resumes_exactly_and_its_policy_needs_its_own_sensors_only(tmp_path: Path) -> None:
    robots = [load(name) for name in ROBOTS]
    train(robots, tmp_path / "whole", asymmetric(), steps=28)
    train(robots, tmp_path / "parts", asymmetric(), steps=20)
    resume(tmp_path / "parts", steps=28)
    assert_same(tmp_path / "whole", tmp_path / "parts")
    (result,) = evaluate(tmp_path / "whole", [load("hopper")], episodes=1)
    assert np.isfinite(result.returns).all()


def test_critics_that_see_the_same_learn_the_same() -> None:
    sessions = [session(settings(*more)) for more in ((), ("trainer.critic_sensors=proprioceptive",))]
    for own in sessions:
        for _ in range(6):
            own.schedule.advance()
        own.close()
    one, other = (own.agent.arrays() for own in sessions)
    for part, arrays in one.items():
        for name, array in arrays.items():
            np.testing.assert_array_equal(array, other[part][name], err_msg=name)
    assert sessions[0].agent.learner.updates > 0


def test_critics_see_everything_and_the_policy_its_part() -> None:
    own, plain = session(asymmetric()), session(settings())
    layout = own.agent.robots.layout
    assert layout.specs == plain.agent.robots.layout.specs
    assert own.collector.obs.shape[1] == layout.stored.num_tokens > layout.num_tokens
    for robot in own.collector.robots:
        quantities = {sensor.quantity for sensor in robot.seen.sensors}
        assert {"translational_velocity", "position", "joint_velocity", "gravity"} <= quantities
        assert len(sensor_columns(robot.spec, robot.seen)) == len(robot.spec.sensors)
    np.testing.assert_array_equal(own.agent.robots.part(own.collector.obs), plain.collector.obs)
    texts = {sensor.text for robot in own.collector.robots for sensor in robot.seen.sensors}
    assert texts <= own.agent.learner.critic.texts.keys()
    own.close()
    plain.close()


def test_what_only_critics_see_moves_values_but_no_actions() -> None:
    own = session(asymmetric())
    view, learner = own.agent.robots, own.agent.learner
    obs = np.random.default_rng(0).normal(size=(3, view.layout.stored.num_tokens)).astype(np.float32)
    changed = obs + 1
    changed[:, view.layout.columns] = obs[:, view.layout.columns]
    action = own.agent.explore(obs)
    np.testing.assert_array_equal(action, own.agent.explore(changed))
    values = [learner.critic(*map(learner._tensor, (rows, action)), view.layout.stored) for rows in (obs, changed)]
    assert not np.array_equal(*(value.detach().numpy() for value in values))
    own.close()


def test_critics_see_everything_by_default_where_the_policy_does_not() -> None:
    assert load_config("default", ["trainer.sensors=proprioceptive"]).critics_see_more
    for overrides in ([], ["trainer.sensors=all"], ["trainer.sensors=proprioceptive", "trainer.critic_sensors=[]"]):
        assert not load_config("default", overrides).critics_see_more
    assert not load_config("default", ["learner.critic=method", "learner.value=scalar"]).critics_see_more
    own = session(small_config())
    assert own.agent.robots.layout.whole is None
    own.close()


def test_impossible_critic_sensors_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"critic_sensors needs learner.critic = 'perceptron'"):
        asymmetric("learner.critic=method", "learner.value=scalar")
    with pytest.raises(UnknownNameError, match="did you mean 'proprioceptive'"):
        train([load("hopper")], tmp_path / "run", settings("trainer.critic_sensors=propriceptive"), steps=8)
    assert not (tmp_path / "run").exists()
