from __future__ import annotations

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest

from morphkit.description import Description, RobotInfo
from morphkit.errors import AssetError, DescriptionError, UnknownNameError
from morphkit.morphology import Joint, Morphology
from morphkit.readers import read

GEOM = '<geom size=".1"/>'


def mjcf(inside: str, **fields: object) -> Description:
    source = f'<mujoco model="m">\n{inside}\n</mujoco>\n'.encode()
    return Description(name="m", file="m.xml", format="mjcf", source=source, **fields)  # type: ignore[arg-type]


def world(bodies: str, more: str = "", **fields: object) -> Morphology:
    return read(mjcf(f"<worldbody>{bodies}</worldbody>{more}", **fields))


def body(name: str, *inside: str) -> str:
    return f'<body name="{name}">{GEOM}{"".join(inside)}</body>'


def hinge(name: str) -> str:
    return f'<joint name="{name}"/>'


PLANAR = (
    '<joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>'
    '<joint name="p" axis="0 1 0"/>'
)

EVERYTHING = f"""
<compiler angle="degree"/>
<default><joint armature="1"/>
  <default class="arm"><joint type="slide" range="-1 2"/><motor gear="3" ctrlrange="-1 1"/></default></default>
<worldbody><geom type="plane" size="1 1 1"/>
  <body name="torso"><freejoint/>{GEOM}
    <body name="head">{GEOM}
      <body childclass="arm">
        <joint name="reach"/><joint type="hinge" range="-90 90"/>{GEOM}<site name="tip"/>
        <body name="ball"><joint name="ball" type="ball" range="0 60"/>{GEOM}<site name="palm"/></body>
      </body></body>
    <frame pos="0 1 0"><body name="leg"><joint name="knee" limited="false" range="-3 3"/>{GEOM}</body></frame>
    <replicate count="2" offset="1 0 0"><body name="toe"><joint name="toe" range="0 10"/>{GEOM}</body></replicate>
  </body>
</worldbody>
<tendon><fixed name="cord"><joint joint="reach" coef="1"/></fixed></tendon>
<actuator>
  <motor joint="knee"/>
  <motor joint="knee"/>
  <motor class="arm" joint="reach" name="push"/>
  <motor joint="reach" name="force"/>
  <position name="servo" joint="toe0" kp="3" inheritrange=".5"/>
  <velocity name="drive" joint="reach" kv="1" ctrlrange="-4 4"/>
  <velocity name="spin" jointinparent="knee" kv="1"/>
  <motor name="cord" tendon="cord" ctrllimited="true" ctrlrange="0 5"/>
  <general name="jet" site="palm" gear="0 0 1 0 0 0" ctrllimited="false" ctrlrange="-1 1"/>
  <adhesion name="glue" body="head" ctrlrange="0 1"/>
  <pid name="pid" joint="knee" ctrlrange="-1 1" velrange="-2 2" ffrange="-3 3" input="pos vel ff"/>
  <pid name="only" joint="knee" velrange="-2 2" input="vel"/>
  <orientation name="aim" joint="ball" ctrlrange="-1 1"/>
  <orientation name="look" site="palm" refsite="tip" input="quat"/>
  <dcmotor name="dc" joint="knee" motorconst="1" resistance="1"/>
  <dcmotor name="passive" joint="knee" motorconst="1" resistance="1" input="none"/>
  <intvelocity name="integral" joint="toe1" kp="1" inheritrange="1"/>
  <damper name="damper" joint="knee" ctrlrange="0 1"/>
  <muscle name="muscle" joint="knee" lengthrange="-1 1" ctrllimited="true" ctrlrange="0 1"/>
</actuator>
<sensor><framepos objtype="body" objname="head"/><gyro name="g" site="tip"/><jointpos joint="knee"/>
  <tendonpos tendon="cord"/></sensor>
"""


def test_everything_agrees_with_the_compiled_model() -> None:
    description = mjcf(EVERYTHING)
    morphology = read(description)
    model = mujoco.MjModel.from_xml_string(description.source.decode())
    limbs = [limb.name for limb in morphology.limbs]
    assert limbs == ["torso", "reach_body", "ball", "leg", "toe0", "toe1"]
    assert [limb.parent for limb in morphology.limbs] == [None, "torso", "reach_body", "torso", "torso", "torso"]
    assert morphology.root.members == ("torso", "head")
    assert [limb.type for limb in morphology.limbs] == [None] * 6
    found = morphology.joints
    assert [joint.name for joint in found] == ["reach", "reach_body_joint", "ball", "knee", "toe0", "toe1"]
    assert [joint.kind for joint in found] == ["slide", "hinge", "ball", "hinge", "hinge", "hinge"]
    assert [joint.limited for joint in found] == model.jnt_limited[1:].astype(bool).tolist()
    expected = np.where(model.jnt_limited[1:, None], model.jnt_range[1:], 0.0)
    np.testing.assert_allclose([(joint.low, joint.high) for joint in found], expected, atol=1e-15)
    assert len(morphology.actuators) == model.nu
    limited = model.actuator_ctrllimited[:, None].astype(bool)
    expected = np.where(limited, model.actuator_ctrlrange, [-math.inf, math.inf])
    np.testing.assert_allclose([(a.low, a.high) for a in morphology.actuators], expected, atol=1e-15)


def test_actuators_names_targets_and_units() -> None:
    found = [(a.name, a.limb, a.joint, a.unit) for a in read(mjcf(EVERYTHING)).actuators]
    assert found == [
        ("knee", "leg", "knee", "N*m"),
        ("knee_2", "leg", "knee", "N*m"),
        ("push", "reach_body", "reach", "1"),
        ("force", "reach_body", "reach", "N"),
        ("servo", "toe0", "toe0", "rad"),
        ("drive", "reach_body", "reach", "m/s"),
        ("spin", "leg", "knee", "rad/s"),
        ("cord", None, None, "N"),
        ("jet", "ball", None, "N"),
        ("glue", "torso", None, "1"),
        ("pid_position", "leg", "knee", "rad"),
        ("pid_velocity", "leg", "knee", "rad/s"),
        ("pid_force", "leg", "knee", "N*m"),
        ("only", "leg", "knee", "rad/s"),
        *((f"aim_{axis}", "ball", "ball", "rad") for axis in "xyz"),
        *((f"look_{axis}", "ball", None, "1") for axis in "wxyz"),
        ("dc", "leg", "knee", "V"),
        ("integral", "toe1", "toe1", "rad/s"),
        ("damper", "leg", "knee", "1"),
        ("muscle", "leg", "knee", "1"),
    ]


def test_sensors() -> None:
    assert [(sensor.name, sensor.kind, sensor.limb) for sensor in read(mjcf(EVERYTHING)).sensors] == [
        ("framepos_head", "framepos", "torso"),
        ("g", "gyro", "reach_body"),
        ("jointpos_knee", "jointpos", "leg"),
        ("tendonpos_cord", "tendonpos", None),
    ]


@pytest.mark.parametrize(
    ("joints", "base"),
    [
        ("", "fixed"),
        ("<freejoint/>", "free"),
        ('<joint type="free"/>', "free"),
        (PLANAR, "planar"),
        (PLANAR.replace('axis="0 1 0"', 'axis="1 0 0"'), "fixed"),
        ('<joint name="yaw"/>', "fixed"),
        ('<joint name="x" type="slide"/>', "fixed"),
        ('<joint name="b" type="ball"/>' + "".join(f'<joint name="s{i}" type="slide"/>' for i in "xyz"), "free"),
    ],
)
def test_the_base_follows_from_the_root_joints(joints: str, base: str) -> None:
    morphology = world(body("t", joints))
    assert morphology.base == base
    assert morphology.root.joints == ()
    assert world(body("t", joints), info=RobotInfo(base="free")).base == "free"


def test_a_joint_of_the_root_keeps_its_actuator() -> None:
    morphology = world(body("t", '<joint name="yaw"/>'), '<actuator><motor joint="yaw"/></actuator>')
    assert [(a.limb, a.joint) for a in morphology.actuators] == [("t", "yaw")]


@pytest.mark.parametrize(("angle", "high"), [("radian", 1.5), ("degree", math.radians(1.5))])
def test_degrees_and_autolimits(angle: str, high: float) -> None:
    inside = body(
        "t", body("a", '<joint name="a" range="-1 1.5"/>'), body("b", '<joint name="b" type="slide" range="0 2"/>')
    )
    (a, b) = world(inside, f'<compiler angle="{angle}"/>').joints
    assert (a.limited, a.high, b) == (True, pytest.approx(high, abs=1e-15), Joint("b", "slide", True, 0.0, 2.0))
    unlimited = world(inside, '<compiler autolimits="false"/>').joints
    assert unlimited == (Joint("a", "hinge", False, 0.0, 0.0), Joint("b", "slide", False, 0.0, 0.0))


def test_several_top_level_bodies() -> None:
    two = body("arm", body("hand", '<joint name="w"/>')) + '<body name="target" mocap="true"/>'
    actuator = '<actuator><motor joint="w"/></actuator>'
    with pytest.raises(DescriptionError, match=r"2 top-level body elements.*: arm, target\. .*--root"):
        world(two, actuator)
    assert [limb.name for limb in world(two, actuator, root="arm").limbs] == ["arm", "hand"]
    assert world(two, actuator, root="target").actuators == ()
    with pytest.raises(UnknownNameError, match="did you mean 'arm'"):
        world(two, root="harm")


FAMILIES = [
    # body name, joint name, words, where they are looked for, type
    (("bthigh", "bthigh"), ("torso", "thigh", "shin", "foot"), "body", "thigh"),
    (("left1", "left1_joint"), ("torso", "1", "2", "3"), "body", "1"),
    (("right3", "right3_joint"), ("torso", "1", "2", "3"), "body", "3"),
    (("lower_leg", "lower_leg_joint"), ("torso", "thigh", "leg", "foot"), "body", "leg"),
    (("right_thigh", "right_hip_y"), ("hip", "knee", "shoulder", "elbow"), "joint", "hip"),
    (("right_thigh", "right_hip_y"), ("hip", "knee", "shoulder", "elbow"), "body", None),
    (("left_lower_arm", "left_elbow"), ("hip", "knee", "shoulder", "elbow"), "joint", "elbow"),
]


@pytest.mark.parametrize(("names", "words", "where", "kind"), FAMILIES)
def test_limb_types(names: tuple[str, str], words: tuple[str, ...], where: str, kind: str | None) -> None:
    info = RobotInfo(type_words=tuple((word,) for word in words), type_matched_in=where)  # type: ignore[arg-type]
    limb = body(names[0], f'<joint name="{names[1]}"/>')
    morphology = world(body("torso", PLANAR.replace('"p"', f'"{words[0]}_root"'), limb), info=info)
    assert morphology.limbs[1].type == kind
    assert morphology.root.type == ("torso" if words[0] == "torso" else None)


def test_the_type_is_the_first_word_of_the_first_group_that_matches() -> None:
    info = RobotInfo(type_words=(("thigh", "upper"), ("leg", "shin")))
    morphology = world(
        body("torso", body("upper_leg", '<joint name="a"/>'), body("shin", '<joint name="b"/>')), info=info
    )
    assert [limb.type for limb in morphology.limbs] == [None, "thigh", "leg"]


@pytest.mark.parametrize(
    ("inside", "start", "words"),
    [
        ("<worldbody/>", "m.xml: ", "no <body>"),
        ("<worldbody>\n<bdy/></worldbody>", "m.xml:3: ", "unrecognized element"),
        (f"<worldbody>\n{body('a', body('a'))}</worldbody>", "m.xml:3: ", "repeated name 'a' in body"),
        (f"<worldbody>{body('a', hinge('j'), body('b', hinge('j')))}</worldbody>", "m.xml:2: ", "repeated name 'j'"),
        (
            f"<worldbody>{body('a', hinge('j'))}</worldbody>\n<actuator>\n<motor name='m' joint='k'/></actuator>",
            "m.xml:4: ",
            "actuator 'm' drives joint 'k', which does not exist",
        ),
        (
            f"<worldbody>{body('a')}</worldbody>\n<actuator><motor name='m' tendon='k'/></actuator>",
            "m.xml:3: ",
            "tendon",
        ),
        ('<worldbody>\n<include file="a.xml"/></worldbody>', "m.xml:3: ", "without a folder"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(inside: str, start: str, words: str) -> None:
    with pytest.raises(DescriptionError) as caught:
        read(mjcf(inside))
    assert str(caught.value).startswith(start)
    assert words in str(caught.value)


def test_the_other_format_is_refused() -> None:
    description = Description(name="m", file="m.xml", format="mjcf", source=b"<robot name='r'/>")
    with pytest.raises(DescriptionError, match="expected MJCF"):
        read(description)


def test_line_numbers_hold_after_a_declaration_over_two_lines() -> None:
    source = b'<?xml version="1.0"\n?>\n<mujoco>\n<nonsense/></mujoco>'
    with pytest.raises(DescriptionError, match=r"^m\.xml:4: "):
        read(Description(name="m", file="m.xml", format="mjcf", source=source))


def test_missing_assets_do_not_matter() -> None:
    assets = '<asset><mesh name="m" file="gone.stl"/><hfield name="h" file="gone.png" size="1 1 1 1"/>'
    assets += '<texture name="t" type="2d" file="gone.png"/></asset>'
    morphology = world('<body name="t"><geom type="mesh" mesh="m"/></body>', assets)
    assert morphology.root.name == "t"


def test_includes_and_attached_models(tmp_path: Path) -> None:
    (tmp_path / "leg.xml").write_text(f"<mujocoinclude>{body('leg', hinge('hip'))}</mujocoinclude>")
    (tmp_path / "arm.xml").write_text(f"<mujoco><worldbody>{body('arm', hinge('s'))}</worldbody></mujoco>")
    inside = (
        '<asset><model name="arm" file="arm.xml"/></asset><worldbody><body name="t"><geom size=".1"/>'
        '<include file="leg.xml"/><attach model="arm" body="arm" prefix="l_"/></body></worldbody>'
    )
    assert [limb.name for limb in read(mjcf(inside, folder=tmp_path)).limbs] == ["t", "leg", "l_arm"]
    (tmp_path / "arm.xml").unlink()
    with pytest.raises(AssetError, match=r"m\.xml:2: .*arm\.xml"):
        read(mjcf(inside, folder=tmp_path))


def test_encodings() -> None:
    text = f"<mujoco><worldbody>{body('été')}</worldbody></mujoco>"
    for source in (
        text.encode(),
        b"\xef\xbb\xbf" + text.encode(),
        text.encode("utf-16"),
        b'<?xml version="1.0" encoding="ISO-8859-1"?>' + text.encode("latin-1"),
    ):
        assert read(Description(name="m", file="m.xml", format="mjcf", source=source)).root.name == "été"


def test_only_servos_inherit_a_range() -> None:
    """The class's wish counts for the position actuator, not for the motor; a tendon's range counts as a joint's."""
    inside = """<default><position inheritrange="0.5"/></default>
    <worldbody><body name="b"><geom size="1"/><joint name="j" range="-10 50"/></body></worldbody>
    <tendon><fixed name="t" range="-1 3"><joint joint="j" coef="1"/></fixed></tendon>
    <actuator><position joint="j"/><position tendon="t"/><motor joint="j" ctrlrange="-7 7"/></actuator>"""
    compiled = mujoco.MjModel.from_xml_string(f"<mujoco>{inside}</mujoco>").actuator_ctrlrange
    found = [(actuator.low, actuator.high) for actuator in read(mjcf(inside)).actuators]
    np.testing.assert_allclose(found, compiled, atol=1e-12)
    assert found[1:] == [(0.0, 2.0), (-7.0, 7.0)]
