"""Joints that a URDF holds in place, and those that mimic them."""

from __future__ import annotations

import math
from pathlib import Path

import mujoco
import pytest

from morphkit.ablation.ablate import ablate
from morphkit.conversion.convert import convert
from morphkit.readers import read
from morphkit.simulation.build import build_simulation, compile_plain
from tests.support.faulty_robots import check_text, lines_of
from tests.support.small_urdfs import AXIS, LIMIT, by_all, described, joint, link, robot, two


def held(lower: str, upper: str, *, kind: str = "revolute", extra: str = "", inside: str = "") -> str:
    limit = f'<limit {lower} {upper} effort="5" velocity="3"/>'
    return robot(
        link("base"),
        link("a"),
        link("b"),
        joint("j", "base", "a", f'<origin xyz="0 0 1" rpy="0 0 1"/><axis xyz="0 2 0"/>{limit}{inside}', kind=kind),
        joint("k", "a", "b", '<origin xyz="1 0 0"/>' + AXIS + LIMIT),
        extra,
    )


@pytest.mark.parametrize("value", [0.5, 0.0, -2.0])
@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_a_joint_whose_limits_are_equal_is_held_there(tmp_path: Path, value: float, kind: str) -> None:
    text = held(f'lower="{value}"', f'upper="{value}"', kind=kind)
    free = convert(described(held('lower="-9"', 'upper="9"', kind=kind))).spec.compile()
    expected = mujoco.MjData(free)
    expected.joint("j").qpos[0] = value
    mujoco.mj_kinematics(free, expected)
    for model in (by_all(text).spec.compile(), build_simulation(described(text)).model):
        assert [model.joint(number).name for number in range(model.njnt)] == ["k"]
        assert model.nu == 1
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        for body in ("a", "b"):
            assert data.body(body).xpos == pytest.approx(expected.body(body).xpos, abs=1e-12)
            assert abs(data.body(body).xquat @ expected.body(body).xquat) == pytest.approx(1)
    unit = "m" if kind == "prismatic" else "rad"
    assert f"joint 'j' is held at {value:g} {unit}: its limits are equal" in convert(described(text)).notes
    assert [actuator.joint for actuator in read(described(text)).actuators] == ["k"]
    report = check_text(tmp_path, "r.urdf", text, deep=False)
    assert lines_of(report, "limit-empty") == [5]
    assert not report.count("error")


def test_limits_that_say_nothing_or_infinity_do_not_hold() -> None:
    for lower, upper in (("", ""), ('lower="-inf"', 'upper="inf"'), ('lower="-1e400"', 'upper="inf"')):
        model = by_all(held(lower, upper)).spec.compile()
        assert not model.joint("j").limited[0]
        assert model.nu == 2
    one_sided = by_all(held('lower="-inf"', 'upper="1"')).spec.compile()
    assert one_sided.joint("j").range.tolist() == [-1e9, 1]
    assert read(described(held('lower="-inf"', 'upper="1"'))).joints[0].low == -1e9


def follower(leader: str, name: str = "f", *, numbers: str = 'multiplier="2" offset="0.25"') -> str:
    inside = f'{AXIS}<limit lower="-3" upper="3" effort="5" velocity="3"/><mimic joint="{leader}" {numbers}/>'
    return link(f"{name}_link") + joint(name, "base", f"{name}_link", inside)


def test_what_mimics_a_held_or_fixed_joint_is_held(tmp_path: Path) -> None:
    for text, angle in (
        (held('lower="0.5"', 'upper="0.5"', extra=follower("j")), 1.25),
        (held('lower="0.5"', 'upper="0.5"', extra=follower("g") + follower("j", "g", numbers="")), 1.25),
        (two(extra=follower("w") + link("plate") + joint("w", "base", "plate", "", kind="fixed")), 0.25),
    ):
        model = by_all(text).spec.compile()
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        assert data.body("f_link").xquat == pytest.approx([math.cos(angle / 2), 0, math.sin(angle / 2), 0])
        assert not model.neq
        report = check_text(tmp_path, "r.urdf", text, deep=False)
        assert lines_of(report, "mimic-fixed")
        assert not report.count("error")


def test_mimics_that_say_nothing_go() -> None:
    itself = by_all(two(moving=AXIS + LIMIT + '<mimic joint="j"/>'))
    assert itself.motors == 1
    planar = link("sled") + joint("p", "base", "sled", '<axis xyz="0 0 1"/>', kind="planar")
    loose = by_all(two(moving=AXIS + LIMIT + '<mimic joint="p"/>', extra=planar))
    assert not loose.spec.equalities
    assert any("joint 'j' cannot follow 'p'" in note for note in loose.notes)


def test_a_splice_keeps_what_is_below_a_held_joint_in_place() -> None:
    limit = '<limit lower="0.5" upper="0.5" effort="5" velocity="3"/>'
    text = robot(
        *map(link, ("base", "thigh", "shin", "toe")),
        joint("hip", "base", "thigh", '<origin xyz="0 0 1"/>' + AXIS + LIMIT),
        joint("knee", "thigh", "shin", '<origin xyz="0 0 -1"/>' + AXIS + limit),
        joint("curl", "shin", "toe", '<origin xyz="1 0 0"/>' + AXIS + LIMIT),
    )
    before = compile_plain(described(text))
    after = compile_plain(ablate(described(text), splice=["thigh"]).description)
    poses = []
    for model in (before, after):
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        poses.append(data.body("toe").xquat.copy())
    assert abs(poses[0] @ poses[1]) == pytest.approx(1)
    assert [limb.name for limb in read(described(text)).limbs] == ["base", "thigh", "toe"]
