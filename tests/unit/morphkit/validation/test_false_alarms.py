"""Files that are right, or odd on purpose: no finding but those that they earn."""

from __future__ import annotations

from pathlib import Path

import pytest

from morphkit.registry import shipped
from morphkit.validation.check import check
from tests.support.faulty_robots import BALL, LIMIT, check_text, inertial, lines_of, moments, urdf


@pytest.mark.parametrize("robot", [robot.name for robot in shipped()])
def test_no_alarm_on_shipped_robots(robot: str) -> None:
    description = next(each for each in shipped() if each.name == robot)
    report = check(description.folder / description.file)
    expected = {("joint-unactuated", "swing")} if robot == "arm" else set()  # the arm's pendulum swings freely
    assert {(found.rule, found.element) for found in report.findings} == expected


def test_names_that_only_replicate_makes_are_known(tmp_path: Path) -> None:
    arm = '<body name="arm"><joint name="j"/><geom size="0.1"/></body>'
    arms = f'<replicate count="2" euler="0 0 180" sep="-">{arm}</replicate>'
    motor = '<motor name="m" joint="j-1" ctrlrange="-1 1"/>'
    text = f"<mujoco><worldbody>{arms}</worldbody><actuator>{motor}</actuator></mujoco>"
    assert not lines_of(check_text(tmp_path, "r.xml", text, deep=True), "reference-unknown")
    assert lines_of(check_text(tmp_path, "r.xml", text.replace("j-1", "j-7"), deep=True), "reference-unknown")


def test_link_that_stands_for_a_frame_is_not_judged_by_its_mass(tmp_path: Path) -> None:
    joint = '<joint name="j" type="{}"><parent link="leg"/><child link="frame"/><axis xyz="0 1 0"/>{}</joint>'
    frame = f'<link name="frame">{inertial("1e-6", moments("0", "0", "0"))}{BALL}</link>'
    fixed = check_text(tmp_path, "r.urdf", urdf(extra=frame + joint.format("fixed", "")), deep=False)
    assert fixed.findings == []
    moving = check_text(tmp_path, "r.urdf", urdf(extra=frame + joint.format("revolute", LIMIT)), deep=False)
    assert {found.rule for found in moving.findings} == {"inertia-zero", "mass-density"}


def test_numbers_that_are_none_break_nothing(tmp_path: Path) -> None:
    for origin in ('xyz="" rpy="1 2 3 4"', 'xyz="1e400 0 0"', 'xyz="a b c"'):
        part = f'<collision><origin {origin}/><geometry><box size="1 1 1"/></geometry></collision>'
        report = check_text(tmp_path, "r.urdf", urdf(leg=inertial() + part), deep=False)
        assert {found.rule for found in report.findings} <= {"number-invalid", "number-infinite"}
