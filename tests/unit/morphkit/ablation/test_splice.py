from __future__ import annotations

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest

from morphkit.ablation.ablate import Loss, ablate, set_root_height
from morphkit.description import Description
from morphkit.errors import AblationError
from morphkit.readers import read
from morphkit.registry import load
from morphkit.simulation.build import compile_plain

DATA = Path(__file__).parents[3] / "data"

CHAIN = b"""<mujoco>
  <compiler angle="radian" eulerseq="ZYX"/>
  <default>
    <joint pos="0 0 .05"/>
    <default class="soft"><joint damping="3" pos=".01 .02 .03"/><geom density="500"/></default>
  </default>
  <worldbody>
    <body name="root" pos="0 0 2" euler=".1 .2 .3">
      <freejoint/><geom size=".1"/>
      <frame pos=".1 0 0" axisangle="0 0 1 .3">
        <body name="middle" pos="0 .1 -.3" xyaxes="1 .2 0 0 1 .4" childclass="soft">
          <joint name="middle" axis="0 1 0"/><geom size=".1"/>
          <body name="bracket" pos=".1 .1 .1" zaxis="1 0 1">
            <geom size=".05"/>
            <frame euler=".3 .1 -.2"><body name="first" pos="0 0 -.4" quat="1 .1 .2 .3">
              <joint name="first" axis="1 0 0"/><geom size=".1"/>
            </body></frame>
          </body>
          <body name="second" pos="0 0 -.4" euler="0 .3 0" childclass="main">
            <joint name="second" axis="1 0 0" pos="0 .1 0"/><geom size=".1"/>
          </body>
        </body>
      </frame>
    </body>
  </worldbody>
</mujoco>"""


def mjcf(source: bytes, **options: object) -> Description:
    return Description("robot", "robot.xml", "mjcf", source, **options)


def kinds(lost: tuple[Loss, ...]) -> set[tuple[str, str]]:
    return {(loss.kind, loss.name) for loss in lost}


def placed(model: mujoco.MjModel) -> mujoco.MjData:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return data


def test_splice_keeps_orientation_and_puts_anchors_where_the_limbs_was(plain_spec):
    robot = mjcf(CHAIN)
    variant = ablate(robot, splice=["middle"])
    assert variant.spliced == ("middle",)
    assert variant.removed == ()
    assert variant.limbs == ("root", "first", "second")
    assert ("body", "bracket") in kinds(variant.lost)
    before, after = plain_spec(robot).compile(), plain_spec(variant.description).compile()
    old, new = placed(before), placed(after)
    for name in ("first", "second"):
        np.testing.assert_allclose(abs(new.body(name).xquat @ old.body(name).xquat), 1, atol=1e-12)
        np.testing.assert_allclose(new.joint(name).xanchor, old.joint("middle").xanchor, atol=1e-12)
        np.testing.assert_allclose(after.joint(name).pos, before.joint(name).pos, atol=1e-15)
        assert after.joint(name).damping == before.joint(name).damping
        np.testing.assert_allclose(after.body(name).mass, before.body(name).mass, rtol=1e-12)
        assert after.body(name).parentid == after.body("root").id


def test_splice_leaves_a_straight_childs_orientation_as_written():
    source = ablate(load("hopper"), splice=["lower_leg"]).description.source
    assert b'<body name="foot" pos="0.065 0 -0.25">\n            <joint name="foot_joint"' in source


@pytest.mark.parametrize("name", ["hopper_3", "hopper_4"])
def test_spliced_hoppers_have_the_benchmarks_mass(name, plain_spec):
    bodies = json.loads((DATA / "benchmark_bodies.json").read_text())
    splice = {"hopper_3": ["leg", "lower_leg"], "hopper_4": ["lower_leg"]}[name]
    description = set_root_height(ablate(load("hopper"), splice=splice).description, 1.25)
    model = plain_spec(description).compile()
    assert sum(model.body_mass) == pytest.approx(bodies[name]["total_mass_kg"], abs=1e-9)
    assert [limb.name for limb in read(description).limbs] == bodies[name]["limbs"]


def test_hopper_4_moves_as_the_benchmarks(plain_spec):
    recorded = np.load(DATA / "trajectories.npz")
    description = set_root_height(ablate(load("hopper"), splice=["lower_leg"]).description, 1.25)
    model = plain_spec(description).compile()
    data = mujoco.MjData(model)
    np.testing.assert_allclose(model.qpos0, recorded["hopper_4/qpos0"], atol=1e-12)
    data.qpos[:], data.qvel[:] = recorded["hopper_4/start/qpos"], recorded["hopper_4/start/qvel"]
    for step, ctrl in enumerate(recorded["hopper_4/ctrl"]):
        data.ctrl[:] = ctrl
        mujoco.mj_step(model, data, nstep=4)
        np.testing.assert_allclose(data.qpos, recorded["hopper_4/qpos"][step], atol=1e-6)
        np.testing.assert_allclose(data.qvel, recorded["hopper_4/qvel"][step], atol=1e-6)


def test_root_height_leaves_slides_in_place_and_takes_hinges_along(plain_spec):
    before = placed(plain_spec(load("hopper")).compile())
    after = placed(plain_spec(set_root_height(load("hopper"), 1.25)).compile())
    assert after.body("torso").xpos[2] == pytest.approx(1.25)
    for joint, shift in (("rootx", 0), ("rootz", 0), ("rooty", -0.5)):
        assert after.joint(joint).xanchor[2] - before.joint(joint).xanchor[2] == pytest.approx(shift)


def test_root_height_leaves_a_slide_that_reads_displacement():
    assert b" ref=" not in set_root_height(load("cheetah"), 0.5).source


def test_prune_below_a_spliced_limb_and_splice_below_a_pruned_one():
    hopper = load("hopper")
    both = ablate(hopper, remove=["foot"], splice=["leg"])
    assert (both.removed, both.spliced, both.limbs) == (("foot",), ("leg",), ("torso", "thigh", "lower_leg"))
    gone = ablate(hopper, remove=["leg"], splice=["lower_leg"])
    assert (gone.removed, gone.spliced) == (("leg", "lower_leg", "foot"), ())


def test_an_orientation_that_is_none_cannot_be_spliced():
    source = CHAIN.replace(b'xyaxes="1 .2 0 0 1 .4"', b'axisangle="0 0 0 .3"')
    with pytest.raises(AblationError, match=r'line \d+: axisangle="0 0 0 .3" in <body> is no orientation'):
        ablate(mjcf(source), splice=["middle"])
    assert ablate(mjcf(source), remove=["middle"]).limbs == ("root",)


JOINT_IN_FRAME = b"""<mujoco><worldbody><body name="root"><geom size=".1"/>
  <body name="middle" pos=".3 .1 0" euler="10 20 30">
    <frame pos="0 .1 0" euler="0 40 0">
      <frame pos=".1 0 0" euler="50 0 0"><joint name="middle" pos="0 0 .2"/></frame>
    </frame>
    <geom size=".1"/>
    <body name="lower" pos="0 0 -.3">
      <frame euler="0 0 30"><joint name="lower" pos=".1 0 .1"/></frame>
      <geom size=".1"/>
    </body>
  </body>
</body></worldbody></mujoco>"""


def test_splice_sees_joints_inside_frames(plain_spec):
    before = placed(plain_spec(mjcf(JOINT_IN_FRAME)).compile())
    after = placed(plain_spec(ablate(mjcf(JOINT_IN_FRAME), splice=["middle"]).description).compile())
    np.testing.assert_allclose(after.joint("lower").xanchor, before.joint("middle").xanchor, atol=1e-12)
    np.testing.assert_allclose(after.joint("lower").xaxis, before.joint("lower").xaxis, atol=1e-12)


@pytest.mark.parametrize("turn", [b'euler="50 0 0"', b'euler="0 0 30"'])
def test_splice_refuses_to_lose_a_scale(turn):
    source = JOINT_IN_FRAME.replace(turn, turn + b' scale="2"')
    assert source != JOINT_IN_FRAME
    with pytest.raises(AblationError, match="a <frame> with a scale"):
        ablate(mjcf(source), splice=["middle"])


def test_attributes_without_a_word_count_as_if_they_were_not_there():
    source = b"""<mujoco><worldbody><body name="base"><geom size="1"/>
  <body name="arm" pos="0 0 1" quat=""><joint pos=""/><geom size="1"/>
    <body name="hand" pos="" euler=" "><joint pos=""/><geom size="1"/></body></body>
</body></worldbody></mujoco>"""
    plain = source.replace(b' quat=""', b"").replace(b' pos=""', b"").replace(b' euler=" "', b"")
    models = [
        compile_plain(ablate(Description("r", "r.xml", "mjcf", text), splice=["arm"]).description)
        for text in (source, plain)
    ]
    np.testing.assert_array_equal(models[0].body_pos, models[1].body_pos)
    np.testing.assert_array_equal(models[0].body("hand").pos, [0, 0, 1])
