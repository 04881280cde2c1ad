from __future__ import annotations

import struct
from pathlib import Path

import pytest

from morphkit.ablation.ablate import Loss, ablate
from morphkit.description import Description
from morphkit.formats.skin import bone_names
from morphkit.readers import read
from morphkit.simulation.build import compile_plain

TENDONS = b"""<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <site name="post" pos="0 0 2"/>
    <body name="trunk">
      <freejoint/>
      <geom name="trunk" size=".2"/>
      <site name="socket"/>
      <geom name="drum" type="cylinder" size=".05 .1" contype="0"/>
      <site name="drum_side" pos=".1 0 0"/>
      <body name="crank" pos=".2 0 0">
        <joint name="crank" axis="0 1 0"/>
        <geom size=".05"/>
        <site name="crank_pin" pos="0 0 .05"/>
        <body name="rod" pos=".1 0 0">
          <joint name="rod" axis="0 1 0"/>
          <geom name="rod" type="cylinder" size=".02 .05"/>
          <site name="rod_end" pos="0 0 .1"/>
          <site name="rod_side" pos=".1 0 .1"/>
        </body>
      </body>
      <body name="slider" pos="-.2 0 0">
        <joint name="slider" type="slide" axis="0 0 1"/>
        <geom size=".05"/>
        <site name="slider_site"/>
      </body>
      <body name="wrist" pos="0 .2 0">
        <joint name="wrist" type="ball"/>
        <geom name="palm" size=".05"/>
        <site name="palm"/>
        <body name="finger" pos="0 .1 0"><joint name="finger" springref=".2"/><geom name="tip" size=".03"/></body>
      </body>
    </body>
  </worldbody>
  <tendon>
    <spatial name="wrap"><site site="socket"/><geom geom="drum" sidesite="drum_side"/><site site="rod_end"/></spatial>
    <spatial name="around_rod"><site site="socket"/><geom geom="rod"/><site site="slider_site"/></spatial>
    <spatial name="beside_rod"><site site="post"/><geom geom="drum" sidesite="rod_side"/><site site="palm"/></spatial>
    <spatial name="pulleys">
      <site site="socket"/><site site="palm"/><pulley divisor="2"/><site site="post"/><site site="slider_site"/>
      <pulley divisor="2"/><site site="post"/><site site="rod_end"/>
    </spatial>
    <fixed name="coupled"><joint joint="crank" coef="1"/><joint joint="slider" coef="-1"/></fixed>
    <fixed name="alone" limited="true" range="-1 1"><joint joint="slider" coef="1"/></fixed>
  </tendon>
  <equality>
    <joint name="follow" joint1="finger" joint2="crank"/>
    <joint name="lock" joint1="slider"/>
    <tendon name="equal" tendon1="alone" tendon2="coupled"/>
    <weld name="hold" body1="wrist" body2="slider" active="false"/>
    <connect name="pin" body1="rod" anchor="0 0 0" active="false"/>
  </equality>
  <actuator>
    <motor name="m_crank" joint="crank"/>
    <motor name="m_parent" jointinparent="wrist" gear="1 0 0"/>
    <position name="m_slider" joint="slider"/>
    <general name="m_thrust" site="palm" gear="0 0 1 0 0 0"/>
    <general name="m_relative" site="palm" refsite="rod_end" gear="1 0 0 0 0 0"/>
    <general name="m_slidercrank" cranksite="crank_pin" slidersite="slider_site" cranklength=".3"/>
    <adhesion name="m_adhesion" body="finger" ctrlrange="0 1"/>
    <muscle name="m_muscle" tendon="pulleys" lengthrange="2 3"/>
    <muscle name="m_muscle2" joint="finger" lengthrange="0 1"/>
    <general name="m_tendon" tendon="alone" dyntype="filterexact" dynprm=".1"/>
  </actuator>
  <sensor>
    <tendonpos tendon="pulleys"/>
    <tendonlimitfrc tendon="alone"/>
    <touch site="palm"/>
    <rangefinder site="rod_end"/>
    <framequat objtype="geom" objname="tip" reftype="site" refname="slider_site"/>
    <distance name="gap" geom1="tip" geom2="rod" cutoff="1"/>
    <distance name="gap2" body1="slider" geom2="trunk" cutoff="1"/>
    <insidesite site="socket" objtype="site" objname="rod_end"/>
    <actuatorpos actuator="m_muscle"/>
    <contact name="bump" geom1="tip" num="2"/>
    <contact name="bump2" subtree1="crank" body2="wrist"/>
    <ballquat joint="wrist"/>
    <jointactuatorfrc joint="slider"/>
    <tendonactuatorfrc tendon="coupled"/>
    <subtreeangmom body="crank"/>
    <clock/>
  </sensor>
  <contact><exclude body1="wrist" body2="slider"/><pair geom1="tip" geom2="rod"/></contact>
  <keyframe>
    <key name="half" qpos="0 0 1 1 0 0 0 .1 .2 .3 1 0 0 0 .5" ctrl="1 2 3 4 5 6 .7 .8 .9 10" act=".1 .2 .3"/>
    <key name="late" time="3"/>
  </keyframe>
</mujoco>"""


def mjcf(source: bytes, **options: object) -> Description:
    return Description("robot", "robot.xml", "mjcf", source, **options)


@pytest.mark.parametrize("limb", ["crank", "rod", "slider", "wrist", "finger"])
def test_tendons_transmissions_and_sensors_go_as_with_mjspec_delete(limb, plain_spec, differences):
    robot = mjcf(TENDONS)
    spec = plain_spec(robot)
    spec.delete(spec.body(limb))
    variant = ablate(robot, remove=[limb])
    assert differences(plain_spec(variant.description).compile(), spec.compile()) == []
    assert read(variant.description).limbs


def test_what_hangs_on_a_limb_in_two_steps_goes_too():
    lost = {(loss.kind, loss.name): loss.reason for loss in ablate(mjcf(TENDONS), remove=["rod"]).lost}
    assert lost["tendon", "beside_rod"] == "refers to site rod_side"
    assert lost["actuator", "m_muscle"] == "refers to tendon pulleys"
    assert lost["sensor", "actuatorpos of actuator m_muscle"] == "refers to actuator m_muscle"
    assert ("actuator", "m_slidercrank") not in lost


def test_a_plugin_instance_goes_with_its_actuator(plain_spec):
    extension = (
        b'<extension><plugin plugin="mujoco.pid"><instance name="pid"><config key="kp" value="4"/></instance>'
        b'<instance name="pid2"><config key="kp" value="5"/></instance></plugin></extension><worldbody>'
    )
    source = TENDONS.replace(b"<worldbody>", extension, 1).replace(
        b"</actuator>",
        b'<plugin name="m_pid" joint="finger" plugin="mujoco.pid" instance="pid"/>'
        b'<plugin name="m_pid2" joint="slider" plugin="mujoco.pid" instance="pid2"/></actuator>',
    )
    source = source.replace(b'.9 10"', b'.9 10 11 12"')
    plain_spec(mjcf(source)).compile()
    variant = ablate(mjcf(source), remove=["finger"])
    assert Loss("plugin", "pid", "finger", "only actuator m_pid used it") in variant.lost
    assert plain_spec(variant.description).compile().nplugin == 1
    assert ("plugin", "pid2") not in {(loss.kind, loss.name) for loss in variant.lost}


def test_keyframes_are_cut_where_muscles_have_no_length_range(plain_spec):
    source = TENDONS.replace(b' lengthrange="2 3"', b"").replace(b'joint="finger" lengthrange="0 1"', b'joint="finger"')
    lost = ablate(mjcf(source), remove=["slider"]).lost
    assert next(loss.reason for loss in lost if loss.name == "half").startswith("resized: ")


def skin_file(*bones: str) -> bytes:
    head = struct.pack("<4i", 3, 0, 1, len(bones)) + struct.pack("<9f", *range(9)) + struct.pack("<3i", 0, 1, 2)
    parts = [
        name.encode().ljust(40, b"\0")
        + struct.pack("<7f", 0, 0, 0, 1, 0, 0, 0)
        + struct.pack("<i3i3f", 3, 0, 1, 2, 1, 1, 1)
        for name in bones
    ]
    return head + b"".join(parts)


def test_bones_of_a_skin_file():
    assert bone_names(skin_file("crank", "wrist")) == ("crank", "wrist")
    assert bone_names(skin_file("crank", "wrist")[:-1]) == ("crank", "wrist")  # the weights are not read
    for damaged in (b"", b"solid cube", skin_file("crank", "wrist")[:100], struct.pack("<4i", -1, 0, 0, 9)):
        assert bone_names(damaged) == ()


def test_a_skin_goes_with_a_bone_that_only_its_file_names(tmp_path: Path, plain_spec):
    (tmp_path / "skins").mkdir()
    (tmp_path / "skins" / "suit.skn").write_bytes(skin_file("crank", "wrist"))
    robot = mjcf(
        TENDONS.replace(b'angle="radian"', b'angle="radian" meshdir="skins"').replace(
            b"<tendon>", b'<asset><skin name="suit" file="suit.skn"/></asset><tendon>'
        ),
        folder=tmp_path,
    )
    variant = ablate(robot, remove=["crank"])
    assert Loss("skin", "suit", "crank", "refers to body crank") in variant.lost
    assert plain_spec(variant.description).compile().nskin == 0
    assert b"suit.skn" in ablate(robot, remove=["slider"]).description.source


def test_a_keyframe_that_is_too_long_goes_and_the_others_are_cut(plain_spec):
    odd = b'<key name="odd" act="1 2 3 4 5 6 7 8 9"/><key name="late"'
    variant = ablate(mjcf(TENDONS.replace(b'<key name="late"', odd)), remove=["finger"])
    reasons = {loss.name: loss.reason for loss in variant.lost if loss.kind == "keyframe"}
    assert reasons["odd"] == "removed: its act has 9 values where the source has 3"
    assert reasons["half"].startswith("resized: qpos lost 1 of 15 values, act lost 1 of ")
    assert plain_spec(variant.description).compile().nkey == 2


@pytest.mark.parametrize("limb", ["crank", "rod", "wrist", "finger"])
def test_a_keyframe_that_ends_early_is_cut_as_if_it_were_whole(limb, plain_spec):
    early = b'qpos="0 0 1 1 0 0 0 .1 .2"'
    short = mjcf(TENDONS.replace(b'qpos="0 0 1 1 0 0 0 .1 .2 .3 1 0 0 0 .5"', early))
    assert plain_spec(short).compile().key_qpos[0].tolist() == [0, 0, 1, 1, 0, 0, 0, 0.1, 0.2, 0, 1, 0, 0, 0, 0]
    whole = mjcf(TENDONS.replace(b".1 .2 .3 1 0 0 0 .5", b".1 .2 0 1 0 0 0 0"))
    cut = [plain_spec(ablate(robot, remove=[limb]).description).compile() for robot in (short, whole)]
    assert cut[0].key_qpos.tolist() == cut[1].key_qpos.tolist()


ARM = b"""<mujoco><worldbody><body name="arm"><joint name="shoulder"/><geom size=".1"/></body></worldbody></mujoco>"""
CARRIER = b"""<mujoco>
  <asset><model name="arm" file="arm.xml"/></asset>
  <worldbody>
    <body name="base">
      <geom size=".1"/>
      <body name="wheel"><joint name="wheel"/><geom size=".1"/></body>
      <frame pos="1 0 0"><attach model="arm" body="arm" prefix="left_"/></frame>
      <body name="rudder"><joint name="rudder"/><geom size=".1"/></body>
    </body>
  </worldbody>
  <keyframe><key name="home" qpos=".1 .2 .3"/></keyframe>
</mujoco>"""


def test_limbs_beside_an_attached_model_are_cut_in_the_source(tmp_path: Path):
    (tmp_path / "arm.xml").write_bytes(ARM)
    variant = ablate(mjcf(CARRIER, folder=tmp_path), remove=["wheel"])
    assert variant.limbs == ("base", "left_arm", "rudder")
    assert b'<attach model="arm"' in variant.description.source
    assert b'<key name="home" qpos=".2 .3"/>' in variant.description.source


def test_limbs_of_an_attached_model_are_cut_in_mujocos_output(tmp_path: Path, plain_spec):
    (tmp_path / "arm.xml").write_bytes(ARM)
    variant = ablate(mjcf(CARRIER, folder=tmp_path), remove=["left_arm"])
    assert variant.limbs == ("base", "wheel", "rudder")
    assert variant.lost[0].kind == "format"
    model = plain_spec(variant.description).compile()
    assert list(model.key("home").qpos) == [0.1, 0.3]


def test_a_robot_with_a_skin_file_compiles(tmp_path: Path):
    (tmp_path / "suit.skn").write_bytes(skin_file("crank", "wrist"))
    skin = b'<asset><skin name="suit" file="suit.skn"/></asset><tendon>'
    robot = mjcf(TENDONS.replace(b"<tendon>", skin), folder=tmp_path)
    assert compile_plain(robot).nskin == 1
    (tmp_path / "suit.skn").unlink()
    assert compile_plain(robot).nskin == 0


VIEWS = b"""<mujoco><visual><global cameraid="%d"/></visual><worldbody>
  <body name="base"><geom size=".1"/>
    <body name="left"><joint/><geom size=".1"/><camera name="on left"/></body>
    <frame><camera name="in frame"/></frame>
    <body name="right"><joint/><geom size=".1"/><camera name="on right"/></body>
    <camera name="on base"/>
  </body>
  <camera name="in the room"/>
</worldbody></mujoco>"""


@pytest.mark.parametrize("number", range(5))
def test_the_camera_to_start_with_stays_the_same(number, plain_spec):
    robot = mjcf(VIEWS % number)
    model = plain_spec(robot).compile()
    named = model.camera(model.vis.global_.cameraid).name
    variant = ablate(robot, remove=["left"])
    cut = plain_spec(variant.description).compile()
    if named == "on left":
        assert cut.vis.global_.cameraid == -1
        assert Loss("view", "cameraid", "", "camera on left went; views start free") in variant.lost
    else:
        assert cut.camera(cut.vis.global_.cameraid).name == named


def test_keyframes_are_cut_where_names_are_empty():
    source = b"""<mujoco>
  <worldbody><body name="base"><geom size="1"/>
    <body name=""><joint name="left"/><geom size="1"/></body>
    <body name="arm"><joint name="right"/><geom size="1"/></body>
  </body></worldbody>
  <actuator><motor name="" joint="left"/><motor name="" joint="right"/></actuator>
  <keyframe><key qpos="1 2" ctrl="3 4"/></keyframe>
</mujoco>"""
    robot = Description("arm", "arm.xml", "mjcf", source)
    _, nameless, arm = read(robot).limbs
    for limb, left in ((nameless.name, b'qpos="2" ctrl="4"'), (arm.name, b'qpos="1" ctrl="3"')):
        assert left in ablate(robot, remove=[limb]).description.source
