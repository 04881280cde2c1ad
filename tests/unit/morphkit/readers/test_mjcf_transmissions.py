"""Units and ranges of actuators, by what they drive and how."""

from __future__ import annotations

import mujoco
import pytest

from morphkit.description import Description
from morphkit.readers import read

MODEL = """<mujoco><worldbody><body name="trunk"><freejoint name="root"/><geom size=".1"/><site name="imu"/>
<body name="leg"><joint name="knee"/><geom size=".1"/><site name="toe" pos="0 0 -.2"/>
<body name="foot"><joint name="slide" type="slide"/><geom size=".1"/>
<body name="eye"><joint name="ball" type="ball"/><geom size=".1"/></body></body></body></body></worldbody>
<tendon><spatial name="cord"><site site="imu"/><site site="toe"/></spatial>
<fixed name="turns"><joint joint="knee" coef="-1"/></fixed><fixed name="slides"><joint joint="slide" coef="1"/></fixed>
<fixed name="pulley"><joint joint="knee" coef=".05"/></fixed>
<fixed name="mixed"><joint joint="knee" coef="1"/><joint joint="slide" coef="1"/></fixed></tendon>
<actuator>{}</actuator></mujoco>"""
SERVO = 'gainprm="9" biastype="affine" biasprm="0 -9 -2"'


@pytest.mark.parametrize(
    ("xml", "unit"),
    [
        ('<motor tendon="cord"/>', "N"),
        ('<motor tendon="turns"/>', "N*m"),
        ('<motor tendon="slides"/>', "N"),
        ('<motor tendon="pulley"/>', "1"),
        ('<motor tendon="mixed"/>', "1"),
        ('<position tendon="cord" gear="-1"/>', "m"),
        ('<position tendon="cord" gear="2"/>', "1"),
        ('<velocity tendon="turns"/>', "rad/s"),
        ('<motor site="imu" gear="0 0 1 0 0 0"/>', "N"),
        ('<motor site="imu" gear="0 0 0 0 .6 .8"/>', "N*m"),
        ('<motor site="imu" gear="1 0 0 1 0 0"/>', "1"),
        ('<position site="toe" refsite="imu" gear="0 1 0 0 0 0"/>', "m"),
        ('<motor joint="root" gear="0 1 0 0 0 0"/>', "N"),
        ('<motor jointinparent="root" gear="0 0 0 0 0 1"/>', "N*m"),
        ('<motor jointinparent="ball" gear="0 0 1 0 0 0"/>', "N*m"),
        ('<motor cranksite="imu" slidersite="toe" cranklength=".3"/>', "N"),
        ('<cylinder joint="slide" area=".1"/>', "Pa"),
        ('<cylinder joint="knee" area=".1"/>', "1"),
        ('<damper joint="knee" ctrlrange="0 1"/>', "1"),
        ('<general joint="knee"/>', "N*m"),
        ('<general joint="knee" gainprm="5"/>', "1"),
        ('<general joint="knee" dyntype="filter" dynprm=".1"/>', "N*m"),
        ('<general joint="knee" dyntype="integrator"/>', "1"),
        (f'<general joint="slide" {SERVO}/>', "m"),
        (f'<general joint="knee" {SERVO} dyntype="filterexact" dynprm=".1"/>', "rad"),
        (f'<general joint="knee" {SERVO} dyntype="integrator"/>', "rad/s"),
        ('<general joint="knee" gainprm="9" biastype="affine" biasprm="0 0 -9"/>', "rad/s"),
        ('<general joint="knee" gainprm="9" biastype="affine" biasprm="1 -9 0"/>', "1"),
        ('<general joint="knee" gainprm="9" biastype="affine" biasprm="0 -8 0"/>', "1"),
    ],
)
def test_a_control_has_the_unit_of_what_it_sets(xml: str, unit: str) -> None:
    source = MODEL.format(xml)
    mujoco.MjModel.from_xml_string(source)
    (actuator,) = read(Description("r", "r.xml", "mjcf", source.encode())).actuators
    assert actuator.unit == unit


def test_a_muscle_takes_what_mujoco_does_not_clip() -> None:
    muscle = '<muscle joint="knee" lengthrange="0 1" {}/>'
    found = [
        read(Description("r", "r.xml", "mjcf", MODEL.format(muscle.format(limits)).encode())).actuators[0]
        for limits in ("", 'ctrlrange="-2 .5"')
    ]
    assert [(actuator.low, actuator.high) for actuator in found] == [(0.0, 1.0), (-2.0, 0.5)]
    rates = [mujoco.mju_muscleDynamics(control, 0.5, [0.01, 0.04, 0]) for control in (-1, 0, 1, 2)]
    assert rates[0] == rates[1] < rates[2] == rates[3]


def test_the_way_of_a_slide_in_frames_with_a_scale() -> None:
    slide = '<joint name="{0}" type="slide" axis="0 1 0" range="-.1 .2"/><geom type="box" size=".1 .1 .1"/>'
    b, c, d, e, f = (slide.format(name) for name in "bcdef")
    source = f"""<mujoco><worldbody><body name="a"><geom size=".1"/>
      <frame scale="2">
        <body name="b">{b}<body name="c"><frame scale="3" euler="10 20 30">{c}</frame></body></body>
        <frame scale=".5"><body name="d">{d}</body></frame>
      </frame>
      <frame scale="2 3 4" scaling="geometry"><body name="e">{e}</body></frame>
      <body name="f">{f}</body>
    </body></worldbody><actuator><position joint="c" inheritrange="1"/></actuator></mujoco>"""
    model = mujoco.MjModel.from_xml_string(source)
    robot = read(Description("r", "r.xml", "mjcf", source.encode()))
    found = {joint.name: (joint.low, joint.high) for joint in robot.joints}
    for number in range(model.njnt):
        assert found[model.joint(number).name] == pytest.approx(tuple(model.jnt_range[number]))
    (actuator,) = robot.actuators
    assert (actuator.low, actuator.high) == pytest.approx(tuple(model.actuator_ctrlrange[0]))
    assert actuator.high == pytest.approx(1.2)
