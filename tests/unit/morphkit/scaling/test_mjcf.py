from __future__ import annotations

import re

import mujoco
import numpy as np
import pytest

from morphkit.ablation.limb_scale import LimbScale
from morphkit.description import Description
from morphkit.errors import AblationError, AssetError
from morphkit.readers import read
from morphkit.registry import load
from morphkit.scaling.scale import scale_limbs
from morphkit.simulation.build import compile_plain
from morphkit.simulation.ground import lowest_point

ARM = """<mujoco>
  <default>
    <general forcerange="-5 5"/>
    <tendon range="0 1"/>
    <default class="link"><geom type="capsule" size=".02" fromto="0 0 0 0 0 .2" density="500"/></default>
    <default class="tip"><site pos="0 0 .2" size=".01"/></default>
  </default>
  <worldbody>
    <geom name="table" type="box" size="1 1 .1" pos="0 0 -.1"/>
    <site name="wall" pos="0 .5 .2"/>
    <body name="base" pos="0 0 .05">
      <geom class="link"/>
      <site name="on_base" class="tip"/>
      <body name="upper" pos="0 0 .2">
        <joint name="shoulder" axis="0 1 0" pos="0 0 .01"/>
        <geom class="link"/>
        <camera name="eye" pos=".1 0 0"/>
        <frame pos=".05 0 0">
          <geom name="box" type="box" size=".01 .02 .03" mass=".4"/>
        </frame>
        <body name="lower" pos="0 0 .2" euler="0 30 0">
          <inertial pos="0 0 .1" mass="2" diaginertia=".1 .1 .01"/>
          <joint name="elbow" axis="0 1 0" pos="0 .02 0" actuatorfrcrange="-3 3"/>
          <geom class="link"/>
          <site name="on_lower" class="tip"/>
          <body name="finger" pos="0 0 .2">
            <joint name="slide" type="slide" axis="1 0 0" range="0 .04" ref=".01"/>
            <geom class="link"/>
          </body>
          <body name="thumb" pos="0 0 .2">
            <joint name="thumb_slide" type="slide" axis="-1 0 0" range="0 .04"/>
            <geom class="link"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <tendon>
    <spatial name="cable" springlength=".1"><site site="wall"/><site site="on_lower"/></spatial>
    <fixed name="grip"><joint joint="slide" coef="1"/><joint joint="thumb_slide" coef="1"/></fixed>
  </tendon>
  <equality>
    <joint name="follow" joint1="thumb_slide" joint2="slide" polycoef=".002 1 3 0 0"/>
    <joint name="geared" joint1="slide" joint2="elbow" polycoef="0 .1 0 0 0"/>
    <connect name="pin" body1="lower" body2="base" anchor="0 0 .1"/>
  </equality>
  <actuator>
    <motor name="shoulder" joint="shoulder" gear="10" ctrlrange="-1 1"/>
    <motor name="force" joint="shoulder" ctrlrange="-7 7"/>
    <position name="elbow" joint="elbow" kp="40" kv="2" ctrlrange="-1 1"/>
    <general name="grip" joint="slide" biastype="affine" gainprm="100" biasprm="0 -100 -1" ctrlrange="0 .04"/>
    <motor name="pull" tendon="cable" gear="2"/>
  </actuator>
  <keyframe>
    <key name="home" qpos="0.1 .2 .03 .04" ctrl="0 3.5 .1 .02 0"/>
  </keyframe>
</mujoco>
"""


def mjcf(text: str, **kwargs) -> Description:
    return Description("robot", "robot.xml", "mjcf", text.encode(), **kwargs)


def scaled(text: str, **scales: LimbScale) -> tuple[mujoco.MjModel, mujoco.MjModel, str]:
    variant = scale_limbs(mjcf(text), scales)
    source = variant.description.source.decode()
    return mujoco.MjModel.from_xml_string(text), mujoco.MjModel.from_xml_string(source), source


def lowest(model: mujoco.MjModel) -> float:
    return lowest_point(model, 1)


def height(model: mujoco.MjModel) -> float:
    return float(model.body_pos[1, 2]) - lowest(model)


def test_what_belongs_to_a_limb_grows_with_it_and_nothing_else_does():
    before, after, source = scaled(ARM, upper=LimbScale(length=2))
    upper = before.body("upper").id
    own = before.geom_bodyid == upper
    np.testing.assert_allclose(after.geom_size[own], 2 * before.geom_size[own])
    np.testing.assert_allclose(after.geom_pos[own], 2 * before.geom_pos[own])
    np.testing.assert_allclose(after.geom_size[~own], before.geom_size[~own])
    np.testing.assert_allclose(after.geom_pos[~own], before.geom_pos[~own])
    np.testing.assert_allclose(after.camera("eye").pos, [0.2, 0, 0])
    np.testing.assert_allclose(after.body("upper").mass, 8 * before.body("upper").mass)
    np.testing.assert_allclose(after.body("upper").inertia, 32 * before.body("upper").inertia)
    np.testing.assert_allclose(after.body("lower").mass, before.body("lower").mass)
    np.testing.assert_allclose(after.site("on_lower").pos, before.site("on_lower").pos)
    # The shoulder stays where the base has it, the elbow moves with the end of the upper arm.
    np.testing.assert_allclose(after.body("upper").pos + after.joint("shoulder").pos, [0, 0, 0.21])
    np.testing.assert_allclose(after.body("lower").pos, [0, 0.02, 0.4])
    assert '<body name="lower"' in source
    assert source.splitlines()[:4] == ARM.splitlines()[:4]


def test_explicit_inertia_goes_with_mass_and_the_square_of_length():
    _, after, _ = scaled(ARM, lower=LimbScale(length=2, mass=0.5))
    assert after.body("lower").mass == pytest.approx(2 * 8 * 0.5)
    np.testing.assert_allclose(after.body("lower").inertia, np.array([0.1, 0.1, 0.01]) * 32 * 0.5)
    np.testing.assert_allclose(after.body("lower").ipos, [0, 0, 0.2])


def test_masses_of_geoms_by_density_and_by_mass_take_the_factor():
    before, after, _ = scaled(ARM, upper=LimbScale(mass=3))
    np.testing.assert_allclose(after.body("upper").mass, 3 * before.body("upper").mass)
    np.testing.assert_allclose(after.body("upper").inertia, 3 * before.body("upper").inertia)


def test_gains_of_motors_and_servos():
    limbs = dict.fromkeys(("upper", "lower", "finger"), LimbScale(gain=2))
    before, after, _ = scaled(ARM, **limbs)
    assert after.actuator("shoulder").gear[0] == 20
    np.testing.assert_allclose(after.actuator("shoulder").ctrlrange, [-1, 1])
    np.testing.assert_allclose(after.actuator("force").ctrlrange, [-14, 14])
    np.testing.assert_allclose(after.actuator("force").forcerange, [-10, 10])  # of a default of another tag
    assert after.actuator("force").gear[0] == 1
    assert after.actuator("elbow").gainprm[0] == 80
    np.testing.assert_allclose(after.actuator("elbow").biasprm[1:3], [-80, -4])
    np.testing.assert_allclose(after.actuator("elbow").forcerange, [-10, 10])
    np.testing.assert_allclose(after.actuator("grip").biasprm[1:3], [-200, -2])
    np.testing.assert_allclose(after.jnt_actfrcrange[1], [-6, 6])
    assert after.actuator("pull").gear[0] == pytest.approx(4)
    np.testing.assert_allclose(after.key_ctrl[0], [0, 7, 0.1, 0.02, 0])
    np.testing.assert_allclose(after.body_mass, before.body_mass)


def test_slides_their_servos_couplings_and_keyframes_go_farther():
    _, after, source = scaled(ARM, finger=LimbScale(length=3), thumb=LimbScale(length=2))
    np.testing.assert_allclose(after.joint("slide").range, [0, 0.12])
    np.testing.assert_allclose(after.joint("slide").qpos0, 0.03)
    np.testing.assert_allclose(after.joint("thumb_slide").range, [0, 0.08])
    np.testing.assert_allclose(after.actuator("grip").ctrlrange, [0, 0.12])
    np.testing.assert_allclose(after.eq_data[0, :3], [0.004, 2 / 3, 3 * 2 / 9])
    np.testing.assert_allclose(after.eq_data[1, :2], [0, 0.3])
    np.testing.assert_allclose(after.key_qpos[0], [0.1, 0.2, 0.09, 0.08])
    assert 'qpos="0.1 .2 0.09 0.08"' in source  # what did not change is as it was written


def test_tendons_and_anchors_fit_the_longer_robot():
    before, after, _ = scaled(ARM, upper=LimbScale(length=1.5), lower=LimbScale(length=2))
    ratio = after.tendon_length0[:1] / before.tendon_length0[:1]
    assert ratio[0] != pytest.approx(1, abs=0.01)
    np.testing.assert_allclose(after.tendon_lengthspring[0, :1], 0.1 * ratio)
    np.testing.assert_allclose(after.tendon_range[0], [0, *ratio])
    np.testing.assert_allclose(after.eq_data[2, :3], [0, 0, 0.2])


def test_a_mesh_that_limbs_of_several_sizes_share_is_copied():
    text = """<mujoco>
  <default><mesh scale="2 2 2"/><default class="shape"><geom type="mesh" mesh="wedge"/></default></default>
  <asset><mesh name="wedge" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset>
  <worldbody>
    <body name="a"><freejoint/><geom class="shape"/>
      <body name="b"><joint/><geom class="shape"/></body>
      <body name="c"><joint/><geom class="shape"/></body>
      <body name="d"><joint/><geom class="shape"/></body>
    </body>
  </worldbody>
</mujoco>"""
    before, after, _ = scaled(text, b=LimbScale(length=2), c=LimbScale(length=2), d=LimbScale(length=0.5))
    assert after.nmesh == 3
    np.testing.assert_allclose(after.body_mass[1:] / before.body_mass[1:], [1, 8, 8, 1 / 8])
    before, after, source = scaled(text, **{name: LimbScale(length=3) for name in "abcd"})
    assert after.nmesh == 1
    np.testing.assert_allclose(after.body_mass[1:] / before.body_mass[1:], 27)
    assert 'scale="6 6 6"' in source


def test_a_total_mass_that_the_file_states_grows_with_the_limbs():
    text = ARM.replace("<mujoco>", '<mujoco><compiler settotalmass="10"/>')
    before, after, _ = scaled(text, upper=LimbScale(length=1.5, mass=1.1))
    upper = before.body("upper").id
    np.testing.assert_allclose(after.body_mass[upper], before.body_mass[upper] * 1.5**3 * 1.1, rtol=1e-9)
    np.testing.assert_allclose(np.delete(after.body_mass, upper), np.delete(before.body_mass, upper), rtol=1e-9)


@pytest.mark.parametrize("robot", ["cheetah", "walker", "hopper"])
def test_feet_stay_as_far_above_the_ground_as_the_robot_has_grown(robot):
    description = load(robot)
    limbs = [limb.name for limb in read(description).limbs]
    scales = {name: LimbScale(length=0.7 + 0.1 * number) for number, name in enumerate(limbs)}
    before, after = compile_plain(description), compile_plain(scale_limbs(description, scales).description)
    grown = height(after) / height(before)
    assert grown != pytest.approx(1, abs=0.01)
    assert lowest(after) == pytest.approx(lowest(before) * grown, abs=1e-9)


def test_the_root_of_a_keyframe_rises_with_the_legs():
    text = """<mujoco><worldbody><geom type="plane" size="1 1 1"/>
  <body name="trunk" pos="0 0 1"><freejoint/><geom size=".1"/>
    <body name="leg"><joint name="hip" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -.5" size=".05"/></body>
  </body></worldbody>
  <keyframe><key qpos="3 2 .55 1 0 0 0 0"/><key qpos="0 0 .3 1 0 0 0 1.5707963267948966"/></keyframe></mujoco>"""
    _, after, _ = scaled(text, leg=LimbScale(length=2))
    np.testing.assert_allclose(after.key_qpos[0, :3], [3, 2, 1.1])  # it touched the ground and still does
    np.testing.assert_allclose(after.key_qpos[1, 2], 0.3, atol=1e-9)  # it lies on its trunk
    np.testing.assert_allclose(after.body("trunk").pos, [0, 0, 2])


def test_limbs_that_replicate_makes_are_scaled_in_what_mujoco_writes():
    text = """<mujoco><worldbody><body name="base"><geom size=".1"/><replicate count="3" euler="0 0 120">
      <body name="arm" pos=".2 0 0"><joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".02"/></body>
    </replicate></body></worldbody></mujoco>"""
    variant = scale_limbs(mjcf(text), {"arm1": LimbScale(length=2)})
    assert any(loss.kind == "format" for loss in variant.lost)
    before, after = compile_plain(mjcf(text)), compile_plain(variant.description)
    np.testing.assert_allclose(after.body_mass[2:] / before.body_mass[2:], [1, 8, 1], rtol=1e-6)


@pytest.mark.parametrize(
    ("edit", "scale", "message"),
    [
        (
            ('<motor name="force" joint="shoulder" ctrlrange="-7 7"/>', '<pid name="force" joint="shoulder" kp="1"/>'),
            LimbScale(gain=2),
            "line .*: actuator 'force': the gains of a <pid> cannot be scaled",
        ),
        (('type="box" size=".01 .02 .03"', 'type="mesh" mesh="gone"'), LimbScale(length=2), "gone"),
    ],
)
def test_what_cannot_be_scaled_is_one_clear_error(edit, scale, message):
    with pytest.raises((AblationError, AssetError, ValueError), match=message):
        scale_limbs(mjcf(ARM.replace(*edit)), {"upper": scale})


def test_a_limb_that_is_not_there_is_refused():
    with pytest.raises(
        AblationError, match=re.escape("robot.xml: there is no limb 'uper' to scale; did you mean 'upper'?")
    ):
        scale_limbs(mjcf(ARM), {"uper": LimbScale(length=2)})
