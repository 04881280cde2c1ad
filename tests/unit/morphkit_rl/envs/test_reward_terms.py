"""What each term gives in states that were put together so that it is known."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import mujoco
import numpy as np
import pytest

from morphkit.description import Actuation, Description
from morphkit.errors import ConfigError, UnknownNameError
from morphkit.registry import load
from morphkit.simulation.build import build_simulation
from morphkit_rl.envs import reward_terms
from morphkit_rl.envs.batch_env import BatchEnv
from morphkit_rl.envs.reward_terms import TERMS, read_term, reward_term
from morphkit_rl.envs.robot_arrays import RobotArrays
from morphkit_rl.envs.tasks import task_for
from morphkit_rl.envs.tip import Targets

SIMULATION = build_simulation(load("quadruped"))
N = 3


@pytest.fixture
def env() -> BatchEnv:
    return BatchEnv([SIMULATION], [replace(task_for(SIMULATION), qpos_noise=0.0, qvel_noise=0.0)], N, num_threads=1)


def arrays(env: BatchEnv) -> RobotArrays:
    return env._tasks._parts[0].arrays


def put(env: BatchEnv, qpos: np.ndarray, qvel: np.ndarray) -> RobotArrays:
    env.set_state(0, qpos, qvel)
    return arrays(env)


def start() -> tuple[np.ndarray, np.ndarray]:
    return np.tile(SIMULATION.model.qpos0, (N, 1)), np.zeros((N, SIMULATION.model.nv))


def value(name: str, robot: RobotArrays, **settings: float) -> np.ndarray:
    result = TERMS[name](robot, **settings)
    assert result.shape == (N,)
    return result


def test_every_term_is_finite_and_has_one_number_an_environment(env: BatchEnv) -> None:
    env.reset()
    env.step([np.random.default_rng(0).uniform(-0.5, 0.5, (N, 12))])
    for name in TERMS:
        assert np.isfinite(value(name, arrays(env))).all(), name


def test_velocities_count_in_the_direction_that_the_robot_heads(env: BatchEnv) -> None:
    """Turned left by a quarter and moving along world y, the robot moves forward; turned by a half, back."""
    qpos, qvel = start()
    for row, angle in zip(qpos, (0, math.pi / 2, math.pi), strict=True):
        row[3:7] = math.cos(angle / 2), 0, 0, math.sin(angle / 2)
    qvel[0, :2], qvel[1, :2], qvel[2, :2] = (0.6, 0.1), (-0.1, 0.6), (0.6, 0.0)
    robot = put(env, qpos, qvel)
    np.testing.assert_allclose(robot.velocity[:, :2], [[0.6, 0.1], [0.6, 0.1], [-0.6, 0]], atol=1e-9)
    np.testing.assert_allclose(value("forward_velocity", robot, limit=0.5), [0.5, 0.5, -0.6], atol=1e-9)
    robot.command[:] = [0.6, 0.1, 0.0]
    np.testing.assert_allclose(value("track_velocity", robot)[:2], 1.0)
    error = (1.2**2 + 0.1**2) / robot.speed_unit**2
    assert value("track_velocity", robot, sigma=0.2)[2] == pytest.approx(math.exp(-error / 0.2))
    np.testing.assert_allclose(value("progress", robot), [1, 1, -0.36 / 0.37], atol=1e-9)
    robot.command[:] = 0.0
    np.testing.assert_array_equal(value("progress", robot), 0.0)


def test_turning_and_tilt(env: BatchEnv) -> None:
    qpos, qvel = start()
    qpos[1, 3:7] = math.cos(0.2), math.sin(0.2), 0, 0  # rolled by 0.4 rad
    qvel[2, 3:6] = 0.3, 0.4, 1.5  # a free joint's rotational velocity is in the body frame
    robot = put(env, qpos, qvel)
    np.testing.assert_allclose(robot.gravity[1], [0, -math.sin(0.4), -math.cos(0.4)], atol=1e-9)
    np.testing.assert_allclose(value("upright", robot), [1, math.cos(0.4), 1])
    np.testing.assert_allclose(value("tilt", robot), [0, math.sin(0.4) ** 2, 0], atol=1e-12)
    np.testing.assert_allclose(value("rocking", robot), [0, 0, 0.25], atol=1e-9)
    robot.command[:, 2] = 1.5
    np.testing.assert_allclose(value("track_yaw", robot, sigma=2.25), [math.exp(-1), math.exp(-1), 1])
    robot.command[:] = 0, 0, 1.5
    np.testing.assert_allclose(value("track_command", robot, yaw_sigma=2.25), [math.exp(-1), math.exp(-1), 1])


def test_heights_postures_and_limits(env: BatchEnv) -> None:
    qpos, qvel = start()
    qpos[1, 2] *= 1.1
    qpos[2, 7:] += 0.2
    qpos[1, 7] = 0.79  # the hip's limit is 0.8
    qvel[1, 2], qvel[2, 6:] = -0.5, 3.0
    robot = put(env, qpos, qvel)
    np.testing.assert_allclose(value("height", robot, sigma=0.01), [1, math.exp(-1), 1], rtol=1e-6)
    np.testing.assert_allclose(value("posture", robot), [0, 0.79**2 / 12, 0.04], atol=1e-9)
    np.testing.assert_allclose(value("joint_limits", robot, margin=0.05), [0, 0.04 / 12, 0], atol=1e-9)
    np.testing.assert_allclose(value("bouncing", robot), [0, 0.25, 0], atol=1e-9)
    np.testing.assert_allclose(value("joint_speed", robot), [0, 0, 9], atol=1e-9)


def test_actions_and_falls(env: BatchEnv) -> None:
    env.reset()
    env.step([np.full((N, 12), 0.25)])
    env.step([np.full((N, 12), -0.5)])
    robot = arrays(env)
    np.testing.assert_allclose(value("action_rate", robot), 1.5**2)
    np.testing.assert_allclose(value("control", robot), 1.0)
    robot.ended = np.array([True, False, False])
    np.testing.assert_array_equal(value("alive", robot), [0, 1, 1])
    np.testing.assert_array_equal(value("fall", robot), [1, 0, 0])


def test_energy_is_the_power_of_mujocos_own_forces(env: BatchEnv) -> None:
    env.reset()
    control = np.random.default_rng(1).uniform(-0.5, 0.5, (N, 12))
    env.step([control])
    robot, model = arrays(env), SIMULATION.model
    mass = model.body_subtreemass[SIMULATION.limb_body[0]]
    for i, (qpos, qvel) in enumerate(zip(*env.state(0), strict=True)):
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:], data.ctrl[:] = qpos, qvel, control[i]
        mujoco.mj_forward(model, data)
        power = data.actuator_force * data.actuator_velocity
        np.testing.assert_allclose(robot.power[i], power, rtol=1e-9, atol=1e-9)
        assert value("energy", robot)[i] == pytest.approx(np.abs(power).sum() / (mass * 9.81))


def test_feet_are_where_mujoco_finds_them(env: BatchEnv) -> None:
    env.reset()
    for _ in range(20):
        env.step([np.random.default_rng(2).uniform(-0.5, 0.5, (N, 12))])
    robot, model = arrays(env), SIMULATION.model
    geoms = [model.geom(g).id for g in range(model.ngeom) if "foot" in model.body(model.geom_bodyid[g]).name]
    geoms = [g for g in geoms if model.geom_contype[g]]
    assert len(geoms) == robot.foot_height.shape[1] == 4
    for i, (qpos, qvel) in enumerate(zip(*env.state(0), strict=True)):
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = qpos, qvel
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(
            robot.foot_height[i], data.geom_xpos[geoms, 2] - model.geom_size[geoms, 0], atol=1e-9
        )
        touching = {c.geom[1] if c.geom[0] == model.geom("morphkit_floor").id else c.geom[0] for c in data.contact}
        assert robot.foot_contact[i].tolist() == [g in touching for g in geoms] or robot.foot_height[i].min() > 0
        for foot, geom in enumerate(geoms):
            velocity = np.zeros(6)
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_GEOM, geom, velocity, 0)
            np.testing.assert_allclose(robot.foot_velocity[i, foot], velocity[3:], atol=1e-9)
    slip = (robot.foot_velocity[..., :2] ** 2).sum(-1) * robot.foot_contact
    np.testing.assert_allclose(value("foot_slip", robot), slip.sum(1))


def test_time_in_the_air_counts_when_a_foot_lands(env: BatchEnv) -> None:
    qpos, qvel = start()
    qpos[:, 2] += 0.1
    robot = put(env, qpos, qvel)
    robot.command[:] = 0.5
    landed = []
    for _ in range(15):
        env.step([np.zeros((N, 12))])
        landed.append(env.reward_terms(0)["reward_progress"] * 0 + robot.air_time.max(1))
    fallen = int(np.argmax([times.max() == 0 for times in landed]))
    assert 5 < fallen < 12  # 0.11 m take 0.15 s
    assert landed[fallen - 1] == pytest.approx(fallen * 0.02)
    robot.air_time[:] = [[0.45] * 4, [0.1] * 4, [0.02] * 4]  # on the floor, as if only now
    np.testing.assert_allclose(value("feet_air_time", robot, least=0.2), [1.0, -0.4, 0.0])
    np.testing.assert_allclose(value("feet_air_time", robot, least=0.2, most=0.3), [0.4, -0.4, 0.0])


def test_reaching_pays_by_distance() -> None:
    simulation = build_simulation(load("arm"))
    env = BatchEnv([simulation], [task_for(simulation, "reach")], N, num_threads=1)
    env.reset()
    robot = arrays(env)
    assert (robot.target != robot.target[:1]).any()
    robot.target[:] = robot.tip_position + np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.3, 0.4]])
    np.testing.assert_allclose(value("reach", robot, sigma=0.01), [1, math.exp(-1), math.exp(-25)], atol=1e-9)
    np.testing.assert_allclose(value("distance", robot), [0, 0.1, 0.5], atol=1e-9)


def test_targets_are_within_reach_and_drawn_anew() -> None:
    simulation = build_simulation(load("arm"))
    task = replace(task_for(simulation, "reach"), reach_seconds=0.1)
    env = BatchEnv([simulation], [task], N, num_threads=1)
    env.reset()
    robot, seen = arrays(env), []
    for _ in range(6):
        seen.append(robot.target.copy())
        env.step([np.zeros((N, len(simulation.tokens.actuators)))])
    assert [(a != b).any() for a, b in pairwise(seen)] == [False, False, False, False, True]
    assert (np.linalg.norm(np.concatenate(seen) - robot.root_position[0], axis=1) <= robot.tip.reach).all()


@pytest.mark.parametrize(("actuation", "furthest"), [("position", 0.4), ("torque", 2.5)])
def test_targets_are_where_motors_bring_the_tip(actuation: Actuation, furthest: float) -> None:
    source = """<mujoco><worldbody><body name="base"><geom size=".05"/><body name="arm" pos="0 0 .5">
      <joint name="j" axis="0 1 0" range="-143.24 143.24"/><geom type="capsule" fromto="0 0 0 .4 0 0" size=".02"/>
      </body></body></worldbody><actuator><motor joint="j" ctrlrange="-9 9"/></actuator></mujoco>"""
    simulation = build_simulation(Description("arm", "arm.xml", "mjcf", source.encode()), actuation=actuation)
    drawn = Targets(simulation).draw(np.random.default_rng(0), np.tile(simulation.start, (300, 1)))
    angles = np.arctan2(0.5 - drawn[:, 2], drawn[:, 0])
    assert np.abs(angles).max() == pytest.approx(furthest, rel=0.05)


def test_own_terms(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reward_terms, "TERMS", TERMS.copy())

    @reward_term
    def low(robot: RobotArrays, *, share: float = 0.8) -> np.ndarray:
        return (robot.height < share).astype(float)

    assert reward_terms.read_term("low", {"weight": -1, "share": 0.5}, "here").settings == (("share", 0.5),)
    with pytest.raises(ConfigError, match="term of morphkit already"):

        @reward_term
        def alive(robot: RobotArrays) -> np.ndarray:
            return robot.height

    with pytest.raises(ConfigError, match="needs a number as its default"):

        @reward_term
        def wrong(robot: RobotArrays, name: str) -> np.ndarray:
            return robot.height


@pytest.mark.parametrize(
    ("name", "given", "error", "message"),
    [
        ("upright", {"weight": 1, "sigma": 2}, ConfigError, "no setting 'sigma'"),
        ("height", {"weight": 1, "sigm": 2}, ConfigError, "did you mean 'sigma'"),
        ("height", {"sigma": 2}, ConfigError, "has no weight"),
        ("height", float("nan"), ConfigError, "expected a finite number"),
        ("height", True, ConfigError, "expected a finite number"),
        ("hight", 1, UnknownNameError, "did you mean 'height'"),
    ],
)
def test_terms_that_make_no_sense(name: str, given: object, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        read_term(name, given, "mine.toml")
