"""Control steps of unusual models: those that MuJoCo cannot go on with, and those that only look wild."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from morphkit.errors import DescriptionError
from morphkit.registry import load
from morphkit_rl.envs.batch_env import BatchEnv
from morphkit_rl.envs.robot import prepare

LEG = '<body name="leg" pos="0 0 .2"><joint name="knee" axis="0 1 0"/><geom size=".05"/></body>'
MODEL = """
<mujoco>
  {size}
  <worldbody>
    <geom type="plane" size="5 5 1"/>
    <body name="torso" pos="0 0 {height}"><freejoint/>{geoms}{leg}</body>
  </worldbody>
  <actuator>{actuator}</actuator>
</mujoco>
"""


def make(path: Path, **parts: object) -> BatchEnv:
    values = {"size": "", "height": 1, "geoms": '<geom size=".1"/>', "leg": LEG, "actuator": '<motor joint="knee"/>'}
    path.write_text(MODEL.format(**{**values, **parts}))
    robot = prepare(load(path), task="cheetah")
    return BatchEnv([robot.simulation], [robot.task], 2, num_threads=1)


def test_large_activations_are_no_divergence(tmp_path: Path) -> None:
    """A filtered force in N, as a press has it, is state of the simulator too."""
    actuator = '<general joint="knee" dyntype="filter" dynprm="1e-2" gainprm="1e-8" ctrlrange="-1e8 1e8"/>'
    env = make(tmp_path / "press.xml", actuator=actuator)
    env.reset()
    step = env.step([np.full((2, 1), 1e8)])
    assert np.abs(env.state_dict()["state"]).max() > 1e6
    assert not step.terminated[0].any()
    assert env.diverged.tolist() == [0]


def test_an_activation_that_is_not_finite_is_one(tmp_path: Path) -> None:
    actuator = '<general joint="knee" dyntype="integrator" gainprm="0" ctrlrange="-1 1"/>'
    env = make(tmp_path / "wild.xml", actuator=actuator)
    env.reset()
    state = env.state_dict()
    state["state"][-1] = np.inf
    env.load_state_dict(state)
    step = env.step([np.zeros((2, 1))])
    assert step.terminated[0].tolist() == [False, True]
    assert env.diverged.tolist() == [1]


TILES = "".join(
    f'<geom type="box" size=".03 .03 .03" pos="{i / 10} {j / 10} 0"/>' for i in range(12) for j in range(12)
)


def lie_flat(env: BatchEnv) -> None:
    """Put all tiles onto the floor, without noise."""
    model = env.simulations[0].model
    env.set_state(0, np.tile(model.qpos0, (2, 1)), np.zeros((2, model.nv)))


def test_a_control_step_that_mujoco_does_not_finish_ends_the_episode(tmp_path: Path) -> None:
    """Too little memory for the contacts: MuJoCo warns, and the rest of the control step would be missing unseen."""
    cramped, roomy = (
        make(tmp_path / f"{memory}.xml", size=f'<size memory="{memory}"/>', geoms=TILES, height=0.029)
        for memory in ("128K", "64M")
    )
    for env, diverged in ((cramped, True), (roomy, False)):
        lie_flat(env)
        step = env.step([np.zeros((2, 1))])
        assert step.terminated[0].tolist() == [diverged] * 2
        assert [episode.diverged for episode in step.episodes] == [True] * (2 * diverged)
        assert np.isfinite(step.obs[0]).all()


def test_a_model_that_mujoco_cannot_step_at_all_is_named(tmp_path: Path) -> None:
    env = make(tmp_path / "tiny.xml", size='<size memory="24K"/>', geoms=TILES, height=0.029)
    lie_flat(env)
    with pytest.raises(DescriptionError, match=r"tiny: MuJoCo cannot simulate it: .*out of memory"):
        env.step([np.zeros((2, 1))])


def test_a_robot_that_may_fall_asleep_steps_from_its_state_alone(tmp_path: Path) -> None:
    """MuJoCo notes who sleeps outside of the state, so it would pass from one environment to the next."""
    box = '<geom type="box" size=".1 .1 .1"/>'
    sleep = '<option sleep_tolerance=".5"><flag sleep="enable"/></option>'
    env, other = (make(tmp_path / "lazy.xml", size=sleep, geoms=box, height=0.11, actuator="") for _ in range(2))
    env.reset()
    for _ in range(80):
        env.step([np.zeros((2, 0))])
    other.load_state_dict(env.state_dict())
    for _ in range(20):
        np.testing.assert_array_equal(env.step([np.zeros((2, 0))]).obs[0], other.step([np.zeros((2, 0))]).obs[0])
