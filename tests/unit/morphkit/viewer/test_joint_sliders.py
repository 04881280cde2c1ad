"""Dials of joints, in degrees and meters, and the poses and swings that they make."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from morphkit.registry import load
from morphkit.simulation.inspection_model import load_mechanics
from morphkit.viewer.joint_sliders import dials, pose, swing
from tests.support.small_robots import JOINT, LIMIT, LINK, arm, mjcf, urdf


def test_dials_are_in_degrees_and_metres_and_start_within_their_limits() -> None:
    slide = '<joint name="s" type="prismatic"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>{}</joint>'
    robot = urdf(
        LINK.format("a", ""),
        LINK.format("b", ""),
        LINK.format("c", ""),
        slide.format(LIMIT.format(0.1, 0.4)),
        JOINT.format("bc", "continuous", "b", "c", ""),
    )
    first, second = dials(load_mechanics(robot))
    assert (first.name, first.limb, first.unit, first.low, first.high, first.start) == ("s", "b", "m", 0.1, 0.4, 0.1)
    assert (second.unit, second.low, second.high, second.start) == ("°", -180, 180, 0)
    assert "rootx" not in [dial.name for dial in dials(load_mechanics(load("cheetah")))]


def test_a_pose_turns_joints_by_degrees() -> None:
    mechanics = load_mechanics(arm())
    data = mujoco.MjData(mechanics.model)
    data.qpos[:] = pose(mechanics, {"ab": 30.0, "nothing": 1.0})
    mujoco.mj_kinematics(mechanics.model, data)
    angle = np.radians(30)
    assert data.body("c").xpos - data.body("b").xpos == pytest.approx([np.sin(angle) / 2, 0, np.cos(angle) / 2])


def test_mimic_joints_follow() -> None:
    mimic = LIMIT.format(-2, 2) + '<mimic joint="ab" multiplier="-2" offset=".1"/>'
    robot = urdf(
        *(LINK.format(name, "") for name in "abc"),
        JOINT.format("ab", "revolute", "a", "b", LIMIT.format(-1, 1)),
        JOINT.format("bc", "revolute", "b", "c", mimic),
    )
    mechanics = load_mechanics(robot)
    assert [dial.name for dial in dials(mechanics)] == ["ab"]
    assert pose(mechanics, {"ab": np.degrees(0.5)}) == pytest.approx([0.5, -0.9])


def test_ball_joints_have_three_dials() -> None:
    mechanics = load_mechanics(mjcf("<body name='x'><joint name='b' type='ball'/><geom size='.1'/></body>"))
    assert [dial.name for dial in dials(mechanics)] == ["b x", "b y", "b z"]
    half = np.radians(20)
    assert pose(mechanics, {"b y": 40.0}) == pytest.approx([np.cos(half), 0, np.sin(half), 0])


def test_key_frames_are_start_poses() -> None:
    body = "<body name='x'><joint name='j' range='-90 90'/><geom size='.1'/></body>"
    mechanics = load_mechanics(mjcf(body, "<keyframe><key qpos='.25'/></keyframe>"))
    assert mechanics.start == pytest.approx([0.25])
    assert dials(mechanics)[0].start == pytest.approx(np.degrees(0.25))


def test_a_swing_reaches_both_ends_and_comes_back() -> None:
    dial = dials(load_mechanics(arm()))[0]
    values = swing(dial, 301)
    assert (values[0], values[-1]) == pytest.approx((0, 0))
    assert (min(values), max(values)) == pytest.approx((dial.low, dial.high), abs=0.1)
