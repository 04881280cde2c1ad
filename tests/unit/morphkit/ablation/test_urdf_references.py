"""References in a URDF are known by the names that they hold, whatever elements and attributes are called."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from morphkit.ablation.ablate import Variant, ablate
from morphkit.conversion.convert import convert
from morphkit.description import Description
from morphkit.readers import read

INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
JOINT = """<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="5" velocity="3"/></joint>"""
LINKS = ("base", "thigh", "shin", "tail")
JOINTS = (("hip", "base", "thigh"), ("knee", "thigh", "shin"), ("wag", "base", "tail"))


def robot(extra: str) -> Description:
    links = "".join(f'<link name="{name}">{INERTIAL}</link>' for name in LINKS)
    joints = "".join(JOINT.format(*each) for each in JOINTS)
    return Description(
        "r", "r.urdf", "urdf", f'<robot name="r">{links}{joints}\n<!-- extra -->\n{extra}\n</robot>'.encode()
    )


def without_shin(extra: str) -> tuple[str, Variant]:
    """What is left of `extra` after the cut, and the cut."""
    variant = ablate(robot(extra), remove=["shin"])
    text = variant.description.source.decode().partition("<!-- extra -->")[2]
    return text.removesuffix("</robot>").strip(), variant


@pytest.mark.parametrize(
    ("extra", "left"),
    [
        ('<force_element name="s"><torsional_spring k="1"><joint name="knee"/></torsional_spring></force_element>', ""),
        ("<gazebo><plugin name='p'><jointName>hip, knee</jointName></plugin></gazebo>",
         "<gazebo><plugin name='p'><jointName>hip</jointName></plugin></gazebo>"),
        ("<gazebo><plugin name='p'><joints>hip knee wag</joints></plugin></gazebo>",
         "<gazebo><plugin name='p'><joints>hip wag</joints></plugin></gazebo>"),
        ("<gazebo><plugin name='p'><a joints='knee,hip'/></plugin></gazebo>",
         "<gazebo><plugin name='p'><a joints='hip'/></plugin></gazebo>".replace("'hip'", '"hip"')),
        ("<gazebo><plugin name='p'><jointName>knee, knee</jointName></plugin><b/></gazebo>", "<gazebo><b/></gazebo>"),
        ('<sensor name="ft"><joint name="knee"/></sensor>', ""),
        ('<group name="leg"><link name="thigh"/><link name="shin"/></group>',
         '<group name="leg"><link name="thigh"/></group>'),
        ('<group name="leg"><link name="shin"/></group>', ""),
        ('<group name="leg"><chain base_link="base" tip_link="shin"/><joint name="hip"/></group>',
         '<group name="leg"><joint name="hip"/></group>'),
        ('<loop><a attached_to="shin"/><b attached_to="tail"/></loop>', '<loop><b attached_to="tail"/></loop>'),
        ('<calib><target>shin</target></calib>', ""),
        ('<set><param name="tip" value="shin"/><param name="rate" value="5"/></set>',
         '<set><param name="rate" value="5"/></set>'),
        ('<ros2_control name="s"><hardware><plugin>x</plugin><param name="tip">shin</param></hardware></ros2_control>',
         '<ros2_control name="s"><hardware><plugin>x</plugin></hardware></ros2_control>'),
        ('<gazebo><plugin name="p"><param name="tip">shin</param></plugin><b/></gazebo>', "<gazebo><b/></gazebo>"),
        ('<x:spring xmlns:x="u"><x:joint name="knee"/></x:spring>', ""),
    ],
)  # fmt: skip
def test_what_names_a_removed_link_or_joint_goes_and_is_listed(extra: str, left: str) -> None:
    text, variant = without_shin(extra)
    assert text == left
    lost = [loss for loss in variant.lost if loss.kind not in ("joint", "transmission")]
    assert lost
    assert {loss.limb for loss in lost} == {"shin"}
    assert not any(loss.kind == "mention" for loss in lost)


@pytest.mark.parametrize(
    "extra",
    [
        "<description>the knee of this robot is strong</description>",
        '<gazebo><plugin name="knee" filename="x.so"/></gazebo>',
        "<notes>shin</notes>",
        '<lamp name="shin"/>',
        '<gazebo><plugin name="p"><say>hip or knee</say></plugin></gazebo>',
        '<thing type="shin"/>',
    ],
)
def test_what_cannot_be_told_stays_and_is_listed(extra: str) -> None:
    text, variant = without_shin(extra)
    assert text == extra
    (mention,) = [loss for loss in variant.lost if loss.kind == "mention"]
    assert "is still mentioned" in mention.reason
    assert mention.limb == "shin"


def test_references_in_parts_that_tools_add_to_links_and_joints() -> None:
    added = robot("").source.replace(
        b'<child link="tail"/>', b'<child link="tail"/><coupled joint="knee"/><note>knee</note>'
    )
    variant = ablate(Description("r", "r.urdf", "urdf", added), remove=["shin"])
    assert b"coupled" not in variant.description.source
    assert [loss.kind for loss in variant.lost if loss.kind != "joint"] == ["coupled", "mention"]


def test_names_that_are_part_of_others_are_none() -> None:
    extra = '<gazebo><plugin name="p"><jointName>knee_2, hip</jointName><a>shinbone</a></plugin></gazebo>'
    text, variant = without_shin(extra)
    assert text == extra
    assert {loss.kind for loss in variant.lost} == {"joint"}


WRIST = (
    '<transmission name="wrist_trans"><rightActuator name="r_motor"/><leftActuator name="l_motor"/>'
    '<flexJoint name="hip"/><rollJoint name="knee"/></transmission>'
)
GRIPPER = (
    '<transmission name="grip"><actuator name="m"/><gap_joint name="wag"/><passive_joint name="knee"/></transmission>'
)


def test_transmissions_whose_joints_are_called_otherwise_drive_them() -> None:
    drives = WRIST + '<transmission name="t"><joint name="wag"/><actuator name="tail_motor"/></transmission>'
    assert [(each.name, each.joint) for each in read(robot(drives)).actuators] == [
        ("hip", "hip"), ("knee", "knee"), ("tail_motor", "wag"),
    ]  # fmt: skip
    assert convert(robot(drives)).motors == 3
    assert [each.joint for each in read(robot(GRIPPER)).actuators] == ["wag"]


def test_a_transmission_loses_one_of_several_joints() -> None:
    text, variant = without_shin(WRIST)
    assert "knee" not in text
    assert [actuator.joint for actuator in read(variant.description).actuators] == ["hip"]
    assert [loss.name for loss in variant.lost if loss.kind == "transmission"] == ["wrist_trans rollJoint"]
    assert ablate(robot(WRIST), remove=["thigh"]).description.source.count(b"transmission") == 0
    text, variant = without_shin(GRIPPER)
    assert text == GRIPPER.replace('<passive_joint name="knee"/>', "")
    pair = (
        '<transmission name="d"><joint name="knee"/><joint name="wag"/>'
        '<actuator name="m1"/><actuator name="m2"/></transmission>'
    )
    text, variant = without_shin(pair)
    assert text == '<transmission name="d"><joint name="wag"/><actuator name="m2"/></transmission>'
    assert [(each.name, each.joint) for each in read(variant.description).actuators] == [("m2", "wag")]


tags = st.sampled_from(["a", "joint", "jointName", "link_ref", "item", "frame", "param"])
keys = st.sampled_from(["ref", "joint", "link", "value", "name", "frame_id", "first"])
values = st.lists(st.sampled_from(["hip", "knee", "shin", "thigh", "tail", "5"]), min_size=1, max_size=3)


@st.composite
def blocks(draw: st.DrawFn, depth: int = 2) -> str:
    """An element of any name with names of links and joints in it."""
    tag = draw(tags)
    attributes = draw(st.dictionaries(keys, values, max_size=2))
    separator = draw(st.sampled_from([" ", ", "]))
    start = tag + "".join(f' {key}="{separator.join(value)}"' for key, value in attributes.items())
    inside = "".join(draw(st.lists(blocks(depth - 1), max_size=2))) if depth else separator.join(draw(values))
    return f"<{start}>{inside}</{tag}>"


@settings(max_examples=100, deadline=None, derandomize=True)
@given(block=blocks(), plugin=st.booleans())
def test_no_name_of_what_went_is_left_without_a_word(block: str, plugin: bool) -> None:
    extra = f"<gazebo><plugin name='p'>{block}</plugin></gazebo>" if plugin else f"<other>{block}</other>"
    text, variant = without_shin(extra)
    mentioned = " ".join(loss.reason for loss in variant.lost if loss.kind == "mention")
    for name in ("knee", "shin"):
        if name in text:
            assert f"{name} is still mentioned" in mentioned
    for name in ("hip", "thigh", "tail"):  # what is left is not touched where nothing beside it went
        if "knee" not in extra and "shin" not in extra:
            assert text.count(name) == extra.count(name)


@pytest.mark.parametrize("value", ["[hip, knee]", '["hip","knee"]', "hip;knee", "robot::knee", "(knee)", "a=knee"])
def test_names_in_lists_of_other_forms_are_still_mentioned(value: str) -> None:
    left, variant = without_shin(f"<gazebo><plugin name='p'><a>{value}</a></plugin></gazebo>")
    assert value in left
    (mention,) = [loss for loss in variant.lost if loss.kind == "mention"]
    assert mention.reason == "knee is still mentioned: <a>, its text"


def test_the_actuator_of_a_joint_that_leaves_a_transmission_is_listed() -> None:
    joints = '<joint name="hip"/><joint name="knee"/><actuator name="m1"/><actuator name="m2"/>'
    left, variant = without_shin(f'<transmission name="t">{joints}</transmission>')
    assert "m1" in left
    assert "m2" not in left
    lost = [(loss.kind, loss.name) for loss in variant.lost if loss.kind in ("transmission", "actuator")]
    assert lost == [("transmission", "t joint"), ("actuator", "m2")]
