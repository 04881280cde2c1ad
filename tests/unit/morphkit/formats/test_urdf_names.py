"""Names for links and joints of a URDF that share one or have none: unique, traced to the file, kept by every cut."""

from __future__ import annotations

import pytest

from morphkit.ablation.ablate import ablate
from morphkit.conversion.convert import convert
from morphkit.description import Description
from morphkit.errors import DescriptionError
from morphkit.readers import read
from morphkit.simulation.build import build_simulation
from morphkit.tokens.spec import token_spec
from tests.support.nameless_robots import names

INERTIA = '<mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
LINK = f'<link name="{{}}"><inertial>{INERTIA}</inertial></link>'
JOINT = """<joint{} type="revolute"><parent link="{}"/><child link="{}"/>
<limit lower="-1" upper="1" effort="3" velocity="1"/></joint>"""
URDF = "\n".join(
    [
        '<robot name="r">',
        *map(LINK.format, ("base", "stray", "stray", "left", "right", "toe")),
        "<link/>",
        JOINT.format(' name="hip"', "base", "left"),
        JOINT.format(' name="hip"', "base", "right"),
        JOINT.format("", "right", "toe"),
        '<gazebo reference="hip"><a/></gazebo>',
        '<gazebo reference="left"><sensor name="s" type="imu"/><sensor type="imu"/></gazebo>',
        '<gazebo reference="right"><sensor name="s" type="imu"/></gazebo>',
        "</robot>\n",
    ]
)


def urdf(text: str = URDF) -> Description:
    return Description("r", "r.urdf", "urdf", text.encode(), root="base")


def test_links_and_joints_of_a_urdf_that_share_a_name() -> None:
    morphology = read(urdf())
    assert names(morphology) == ["base", "left", "right", "toe"]
    assert [joint.name for joint in morphology.joints] == ["hip", "hip_2", "toe_joint"]
    assert [(each.name, each.joint) for each in morphology.actuators] == [
        (name, name) for name in ("hip", "hip_2", "toe_joint")
    ]
    found = token_spec(morphology, source="all").given_names
    assert [(each.given, each.kind, each.original, each.where, each.id) for each in found] == [
        ("hip_2", "joint", "hip", "r.urdf:11", None),
        ("toe_joint", "joint", None, "r.urdf:13", None),
        ("sensor", "sensor", None, "r.urdf:16", None),
        ("s_2", "sensor", "s", "r.urdf:17", None),
    ]
    by_joint = token_spec(morphology, limb_names="joint")
    assert [actuator.name for actuator in by_joint.actuators] == ["hip_ctrl", "hip_2_ctrl", "toe_joint_ctrl"]


def test_several_roots_say_which_have_no_name_of_their_own() -> None:
    with pytest.raises(DescriptionError, match=r"base, stray, stray_2, link\.") as caught:
        read(Description("r", "r.urdf", "urdf", URDF.encode()))
    assert "stray_2 is another link called 'stray', at r.urdf:4" in str(caught.value)
    assert "link is a link without a name, at r.urdf:8" in str(caught.value)


@pytest.mark.parametrize("limb", ["left", "right", "toe"])
def test_cuts_leave_shared_names_as_they_stand(limb: str) -> None:
    variant = ablate(urdf(), remove=[limb])
    lines = set(URDF.splitlines())
    assert [line for line in variant.description.source.decode().splitlines() if line not in lines] == []
    assert b'<gazebo reference="hip">' in variant.description.source
    both = ablate(urdf(), remove=["left", "right"])
    assert b"hip" not in both.description.source


def test_a_urdf_with_shared_names_can_be_simulated_and_converted() -> None:
    model = build_simulation(urdf()).model
    assert [model.joint(i).name for i in range(model.njnt)] == ["hip", "hip_2", "toe_joint"]
    assert [actuator.name for actuator in convert(urdf()).spec.actuators] == ["hip", "hip_2", "toe_joint"]
    other = (
        JOINT.format(' name="hip"', "stray_base", "stray_arm") + LINK.format("stray_base") + LINK.format("stray_arm")
    )
    beside = urdf(URDF.replace('<robot name="r">', f'<robot name="r">{other}'))
    assert [joint.name for joint in read(beside).joints] == ["hip_2", "hip_3", "toe_joint"]
    assert [actuator.name for actuator in convert(beside).spec.actuators] == ["hip_2", "hip_3", "toe_joint"]
