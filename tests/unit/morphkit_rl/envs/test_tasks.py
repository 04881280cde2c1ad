from __future__ import annotations

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from morphkit.description import Description, RobotInfo
from morphkit.errors import ConfigError, UnknownNameError
from morphkit.registry import load
from morphkit.simulation.build import Simulation, build_simulation
from morphkit_rl.envs.batch_env import BatchEnv
from morphkit_rl.envs.reward import tilt
from morphkit_rl.envs.tasks import TASKS, Task, task_for


def body(base: str | None = None, **info) -> Simulation:
    """A box of 0.2 m with a 0.3 m long arm along x, a 40 N*m motor between; its frame starts at 0.11 m."""
    source = b"""<mujoco><option timestep=".005"/><worldbody><body name="box"><geom type="box" size=".1 .1 .1"/>
      <body name="arm" pos=".1 0 0"><joint name="j" axis="0 1 0"/><geom type="box" size=".15 .02 .02" pos=".15 0 0"/>
      </body></body></worldbody>
      <actuator><motor joint="j" ctrlrange="-40 20" ctrllimited="true"/></actuator></mujoco>"""
    return build_simulation(Description("body", "body.xml", "mjcf", source, info=RobotInfo(**info)), base=base)


def one_step(simulation: Simulation, task: Task, action: float, qpos: np.ndarray, qvel: np.ndarray | None = None):
    """Reward, termination and coordinates of one step from `qpos`."""
    env = BatchEnv([simulation], [task], 1, autoreset=False)
    velocity = np.zeros((1, simulation.model.nv)) if qvel is None else np.asarray(qvel, float)[None]
    env.set_state(0, np.asarray(qpos, float)[None], velocity)
    step = env.step([np.full((1, 1), action)])
    return step.reward[0][0], bool(step.terminated[0][0]), env.state(0)[0][0]


@pytest.mark.parametrize(
    ("robot", "task", "healthy"),
    [
        ("cheetah", "cheetah", None),
        ("walker", "walker", (0.8, 2.0)),
        ("walker_2_main", "walker", (0.54, 1.74)),
        ("hopper_3", "hopper", (0.45, math.inf)),
        ("humanoid_2d", "humanoid_2d", (0.4, 2.1)),
    ],
)
def test_benchmark_robots_have_their_task(robot: str, task: str, healthy: tuple[float, float] | None) -> None:
    chosen = task_for(build_simulation(load(robot)))
    assert (chosen.name, chosen.healthy_height, chosen.frame_skip) == (task, healthy, 4)


def test_robots_without_a_task_get_one_that_fits_their_base() -> None:
    assert task_for(body("fixed")).name == "raise"
    assert task_for(body("planar")).name == "locomotion"
    assert task_for(body("free")).name == "walk"
    assert task_for(body("free", task="hopper")).name == "hopper"
    assert task_for(body("free", task="hopper"), "locomotion").name == "locomotion"


def test_unknown_task_offers_the_nearest() -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'locomotion'"):
        task_for(body("free"), "locomotive")


def test_forward_tasks_need_a_base_that_moves() -> None:
    with pytest.raises(ConfigError, match="base is fixed; take task 'raise'"):
        task_for(body("fixed"), "locomotion")


@pytest.mark.parametrize("base", ["planar", "free"])
def test_locomotion_is_filled_in_from_the_robot(base: str) -> None:
    task = task_for(body(base), "locomotion")
    assert task.frame_skip == 4  # 4 * 5 ms
    assert task.healthy_height == pytest.approx((0.4 * 0.1, 2.0 * 0.1))
    own = task_for(body(base, healthy_height=(0.05, 3.0)), "locomotion")
    assert own.healthy_height == (0.05, 3.0)


def test_control_frequency() -> None:
    assert task_for(body("free"), control_frequency=100).frame_skip == 2  # of 5 ms
    assert task_for(body("free", control_frequency=25.0)).frame_skip == 8
    walker = build_simulation(load("walker"))
    assert task_for(body("planar", control_frequency=25.0), "walker").frame_skip == 4
    assert task_for(walker, control_frequency=50).frame_skip == round(0.02 / walker.model.opt.timestep)


def test_holding_the_start_pose_by_servos_costs_nothing() -> None:
    simulation = body("free", actuation="position")
    low, high = simulation.tokens.actuators[0].low, simulation.tokens.actuators[0].high
    task = replace(task_for(simulation, "locomotion"), forward_weight=0.0, alive_bonus=0.0, control_cost=0.5)
    start = simulation.model.qpos0
    assert one_step(simulation, task, (low + high) / 2, start)[0] == 0
    assert one_step(simulation, task, high, start)[0] == pytest.approx(-0.5)


ROOT_JOINTS = {
    "free": "<freejoint/>",
    "planar": '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/><joint axis="0 1 0"/>',
}


@pytest.mark.parametrize("base", ["planar", "free"])
@pytest.mark.parametrize(
    ("ground", "frame"), [(0.0, 0.0), (-6.0, 0.0), (-6.0, 0.4)], ids=["footprint", "sunken footprint", "sunken"]
)
def test_a_root_frame_at_the_ground_or_below_it_can_be_healthy(base: str, ground: float, frame: float) -> None:
    """A box of 0.2 m whose frame lies at its foot, or at 0.4 m above it."""
    source = f"""<mujoco><worldbody><geom type="plane" size="5 5 1" pos="0 0 {ground}"/>
      <body name="box" pos="0 0 {ground + frame}">{ROOT_JOINTS[base]}
      <geom type="box" size=".1 .1 .1" pos="0 0 {0.1 - frame}"/></body></worldbody></mujoco>"""
    simulation = build_simulation(Description("box", "box.xml", "mjcf", source.encode()))
    task = task_for(simulation, "locomotion")
    start = ground + frame
    assert task.healthy_height == pytest.approx((start - 0.6 * 0.1, start + 0.1))
    env = BatchEnv([simulation], [task], 3, autoreset=False)
    env.reset()
    assert not env.step([np.zeros((3, 0))]).terminated[0].any()


def test_world_height_of_a_planar_base_without_ref() -> None:
    cheetah = build_simulation(load("cheetah"))
    cheetah.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    task = task_for(cheetah, "locomotion")
    assert task.healthy_height == pytest.approx((0.28, 1.4))
    env = BatchEnv([cheetah], [task], 3, autoreset=False)
    qpos = np.zeros((3, 9))
    qpos[:, 1] = [0.0, -0.45, 0.75]
    env.set_state(0, qpos, np.zeros((3, 9)))
    np.testing.assert_array_equal(env.step([np.zeros((3, 6))]).terminated[0], [False, True, True])


@pytest.mark.parametrize("base", ["planar", "free"])
def test_forward_reward(base: str) -> None:
    simulation = body(base)
    task = replace(task_for(simulation, "locomotion"), alive_bonus=0.25, control_cost=0.0, forward_weight=2.0)
    start = simulation.model.qpos0
    velocity = np.zeros(simulation.model.nv)
    velocity[0] = 1.5
    reward, terminated, qpos = one_step(simulation, task, 0.0, start, velocity)
    assert reward == pytest.approx(2.0 * (qpos[0] - start[0]) / 0.02 + 0.25)
    assert 2.0 < reward < 3.5
    assert not terminated


def test_control_cost_as_share_of_the_largest_bound() -> None:
    simulation = body("planar")
    base = replace(task_for(simulation), forward_weight=0.0, alive_bonus=0.0, control_cost=0.5, healthy_pitch=None)
    start = simulation.model.qpos0
    assert one_step(simulation, base, 20.0, start)[0] == pytest.approx(-0.5 * 0.25)
    absolute = replace(base, control_as_share=False)
    assert one_step(simulation, absolute, 20.0, start)[0] == pytest.approx(-0.5 * 400)
    assert one_step(simulation, absolute, 1000.0, start)[0] == pytest.approx(-0.5 * 400)


@pytest.mark.parametrize("base", ["planar", "free"])
def test_healthy_bounds_are_strict(base: str) -> None:
    """The bounds of a second run are where the first run ended: on the bound, the episode ends."""
    simulation = body(base)
    task = replace(task_for(simulation), healthy_pitch=None, height_in_world=False)
    start = simulation.model.qpos0.copy()
    z = 1 if base == "planar" else 2
    start[z] = 2.0
    loose = replace(task, healthy_height=(0.0, 5.0))
    _, terminated, qpos = one_step(simulation, loose, 0.0, start)
    assert not terminated
    height = float(qpos[z])
    for bounds, expected in (
        ((height, 5.0), True),
        ((np.nextafter(height, 0), 5.0), False),
        ((0.0, height), True),
        ((0.0, np.nextafter(height, 5)), False),
    ):
        assert one_step(simulation, replace(task, healthy_height=bounds), 0.0, start)[1] == expected


@pytest.mark.parametrize("base", ["planar", "free"])
@pytest.mark.parametrize(("angle", "expected"), [(0.9, False), (1.5, True), (-1.5, True)])
def test_pitch_and_tilt_end_the_episode(base: str, angle: float, expected: bool) -> None:
    simulation = body(base)
    task = replace(task_for(simulation), healthy_height=None, healthy_pitch=1.2)
    start = simulation.model.qpos0.copy()
    if base == "planar":
        start[1:3] = 1.0, angle
    else:
        start[2:7] = 1.0, math.cos(angle / 2), math.sin(angle / 2), 0, 0
    assert one_step(simulation, task, 0.0, start)[1] == expected


def test_turning_about_the_vertical_is_no_tilt() -> None:
    turned = np.array([[math.cos(0.7), 0, 0, math.sin(0.7)]])
    upright = np.array([[math.cos(0.3), math.sin(0.3), 0, 0]])
    product = np.zeros(4)
    mujoco.mju_mulQuat(product, turned[0], upright[0])
    assert tilt(product[None], upright)[0] == pytest.approx(0, abs=1e-7)
    mujoco.mju_mulQuat(product, np.array([math.cos(0.4), 0, math.sin(0.4), 0]), upright[0])
    assert tilt(product[None], upright)[0] == pytest.approx(0.8)


def test_hopper_ends_where_any_other_state_is_large() -> None:
    hopper = build_simulation(load("hopper"))
    task = replace(TASKS["hopper"], healthy_height=None, healthy_pitch=None)
    env = BatchEnv([hopper], [task], 4, autoreset=False)
    qpos, qvel = np.tile(hopper.model.qpos0, (4, 1)), np.zeros((4, hopper.model.nv))
    qpos[1, 0] = 500.0  # x does not count
    qvel[2, 0] = 150.0
    qpos[3, 2] = -101.0
    env.set_state(0, qpos, qvel)
    np.testing.assert_array_equal(env.step([np.zeros((4, 4))]).terminated[0], [False, False, True, True])


def test_fingers_start_within_their_travel() -> None:
    """Noise of 0.1 would put a finger of 4 cm travel centimeters into its stop."""
    source = b"""<mujoco><worldbody><body name="palm"><geom size=".1"/>
      <body name="finger"><joint type="slide" axis="0 1 0" range="0 .04"/><geom size=".01"/></body>
      <body name="rail"><joint type="slide" axis="0 1 0"/><geom size=".01"/></body>
      <body name="wrist"><joint axis="0 1 0" range="0 2"/><geom size=".01"/></body></body></worldbody></mujoco>"""
    simulation = build_simulation(Description("hand", "hand.xml", "mjcf", source))
    env = BatchEnv([simulation], [task_for(simulation, "raise")], 100)
    env.reset()
    finger, rail, wrist = env.state(0)[0].T
    assert (finger.min(), finger.max()) == (0.0, 0.04)
    for free in (rail, wrist):
        assert -0.1 < free.min() < -0.05
        assert 0.05 < free.max() < 0.1


@pytest.mark.parametrize(("angle", "share"), [(0.0, 0.0), (-math.pi / 2, 0.75), (math.pi / 2, -0.75)])
def test_raise_pays_the_height_of_the_tip(angle: float, share: float) -> None:
    """The arm's joint is 0.1 m from the root's frame, its tip 0.3 m from the joint: straight up it is 0.3 of 0.4 m."""
    simulation = body("fixed")
    simulation.model.opt.gravity[:] = 0
    simulation.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    task = replace(task_for(simulation), control_cost=0.0)
    reward, terminated, _ = one_step(simulation, task, 0.0, np.array([angle]))
    assert reward == pytest.approx(share, abs=1e-6)
    assert not terminated


def test_pitch_bound_is_strict() -> None:
    simulation = body("planar")
    task = replace(task_for(simulation), healthy_height=None, healthy_pitch=3.0)
    start = simulation.model.qpos0 + np.array([0, 1.0, -0.4, 0])
    pitch = abs(float(one_step(simulation, task, 0.0, start)[2][2]))
    assert one_step(simulation, replace(task, healthy_pitch=pitch), 0.0, start)[1]
    assert not one_step(simulation, replace(task, healthy_pitch=np.nextafter(pitch, 4)), 0.0, start)[1]
