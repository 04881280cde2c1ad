"""What is observed besides the sensors of limbs, against MuJoCo's own numbers."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from morphkit.description import Description
from morphkit.errors import ConfigError, UnknownNameError
from morphkit.registry import load
from morphkit_rl.envs.batch_env import BatchEnv
from morphkit_rl.envs.robot import Robot, prepare

ROBOT = """<mujoco><option timestep=".005"/><worldbody>
  <body name="hull" pos="0 0 .5" euler="0 0 30"><freejoint/><geom type="box" size=".2 .1 .05"/><site name="imu"/>
    <body name="leg" pos=".2 0 0"><joint name="knee" axis="0 1 0" range="-60 60"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.45" size=".03"/><site name="toe" pos="0 0 -.45" size=".05"/></body>
    <body name="ball" pos="-.2 0 0"><joint name="socket" type="ball"/><geom size=".05"/></body>
    <body name="rail" pos="0 .2 0"><joint name="rail" type="slide" axis="0 1 0" range="0 .1"/><geom size=".05"/></body>
  </body></worldbody>
  <actuator><motor joint="knee" ctrlrange="-5 5"/><motor joint="rail" ctrlrange="-5 5"/></actuator>
  <sensor><gyro site="imu"/><accelerometer site="imu"/><touch site="toe"/><actuatorfrc actuator="knee_motor"/>
  </sensor></mujoco>""".replace("<motor joint=\"knee\"", "<motor name=\"knee_motor\" joint=\"knee\"")  # fmt: skip


def robot(*sensors: str, task: str = "walk") -> Robot:
    return prepare(Description("crab", "crab.xml", "mjcf", ROBOT.encode()), task=task, sensors=sensors)


def moving(own: Robot, steps: int = 9) -> tuple[BatchEnv, np.ndarray, np.ndarray]:
    """Environments that have come to the floor, what was observed there, and the latest action."""
    env = BatchEnv([own.simulation], [own.task], 3, specs=[own.spec], seed=1, num_threads=2)
    env.reset()
    rng = np.random.default_rng(0)
    for _ in range(steps):
        action = rng.uniform(-5, 5, (3, 2))
        step = env.step([action])
    assert not step.episodes
    return env, step.obs[0], action


def columns(own: Robot, quantity: str) -> list[int]:
    return [token.index for token in own.spec.sensors if token.quantity == quantity]


def test_what_a_real_robot_knows() -> None:
    own = robot("proprioceptive")
    quantities = list(dict.fromkeys(token.quantity for token in own.spec.sensors))
    assert quantities == [
        "angle",
        "gravity",
        "body_rotational_velocity",
        "joint_velocity",
        "previous_action",
        "command",
    ]
    env, obs, action = moving(own)
    model, start = own.simulation.model, own.simulation.model.body("hull").id
    rest = mujoco.MjData(model)
    mujoco.mj_kinematics(model, rest)
    heading = rest.xmat[start].reshape(3, 3)
    for i, (qpos, qvel) in enumerate(zip(*env.state(0), strict=True)):
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = qpos, qvel
        mujoco.mj_forward(model, data)
        turned = data.xmat[start].reshape(3, 3) @ heading.T  # from the body frame to the world
        np.testing.assert_allclose(obs[i, columns(own, "gravity")], turned.T @ [0, 0, -1], atol=1e-6)
        rotational = turned.T @ data.sensor("morphkit/hull/rotational_velocity").data
        np.testing.assert_allclose(obs[i, columns(own, "body_rotational_velocity")], rotational, atol=1e-5)
        speeds = [qvel[6], np.linalg.norm(qvel[7:10]), qvel[10]]
        np.testing.assert_allclose(obs[i, columns(own, "joint_velocity")], speeds, rtol=1e-5)
    np.testing.assert_allclose(obs[:, columns(own, "previous_action")], action / 5, rtol=1e-6)
    units = {token.name: token.unit for token in own.spec.sensors}
    assert (units["leg_joint_velocity"], units["rail_joint_velocity"]) == ("rad/s", "m/s")


def test_declared_sensors_read_what_mujoco_reads_under_the_same_control() -> None:
    own = robot("declared")
    names = [token.name for token in own.spec.sensors]
    assert names[-5:] == [
        *("leg_previous_action", "rail_previous_action"),
        *("hull_command_x", "hull_command_y", "hull_command_yaw"),
    ]
    env, obs, action = moving(own)
    touched = False
    for i, (qpos, qvel) in enumerate(zip(*env.state(0), strict=True)):
        model = own.simulation.model
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:], data.ctrl[:] = qpos, qvel, action[i]
        mujoco.mj_forward(model, data)
        read = np.concatenate([data.sensor(name).data for name in [s.name for s in own.simulation.morphology.sensors]])
        np.testing.assert_allclose(obs[i, :-5], read, rtol=1e-4, atol=1e-4)
        touched |= bool(data.sensordata[6] > 0)
    assert touched
    again = env.step([action]).obs[0]
    env.set_state(0, *env.state(0))
    assert again.shape == env.observe()[0].shape


def test_quantities_of_every_kind_can_be_chosen() -> None:
    own = robot("gyro", "gravity", "position")
    quantities = list(dict.fromkeys(token.quantity for token in own.spec.sensors))
    assert quantities == ["position", "gyro", "gravity", "previous_action", "command"]
    env, obs, _ = moving(own)
    assert obs.shape == (3, 4 * 3 + 3 + 3 + 2 + 3)
    both = robot("all", "declared")
    assert len(both.spec.sensors) == len(robot().spec.sensors) + 8
    assert [token.index for token in both.spec.sensors] == list(range(len(both.spec.sensors)))
    env.close()


def test_published_tasks_can_have_sensor_sets() -> None:
    hopper = prepare(load("hopper"), sensors=["proprioceptive"])
    assert "command" not in {token.quantity for token in hopper.spec.sensors}
    env = BatchEnv([hopper.simulation], [hopper.task], 2, specs=[hopper.spec], num_threads=1)
    env.reset()
    step = env.step([np.full((2, 4), 0.5)])
    np.testing.assert_allclose(step.obs[0][:, columns(hopper, "previous_action")], 0.5)
    assert "reward_forward" in env.reward_terms(0)


def test_what_cannot_be_observed() -> None:
    with pytest.raises(ConfigError, match="declares no sensors with readings"):
        prepare(load("hopper"), sensors=["declared"])
    with pytest.raises(UnknownNameError, match="did you mean 'proprioceptive'"):
        prepare(load("hopper"), sensors=["proprioceptiv"])
    imu = b"""<robot name="r"><link name="a"><inertial><mass value="1"/>
      <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <gazebo reference="a"><sensor name="imu" type="imu"/></gazebo></robot>"""
    own = prepare(Description("r", "r.urdf", "urdf", imu), sensors=["declared"], task="raise", base="fixed")
    with pytest.raises(ConfigError, match="MuJoCo does not simulate the sensor 'imu'"):
        BatchEnv([own.simulation], [own.task], 1, specs=[own.spec])
