from __future__ import annotations

import xml.etree.ElementTree as ElementTree

import mujoco
import numpy as np
import pytest

from morphkit.ablation.limb_scale import LimbScale
from morphkit.conversion.convert import convert
from morphkit.description import Description, RobotInfo
from morphkit.readers import read
from morphkit.registry import load
from morphkit.scaling.scale import scale_limbs
from tests.support.small_robots import INERTIA, LIMIT, LINK, urdf

GRIPPER = urdf(
    LINK.format("base", '<visual><geometry><cylinder radius=".1" length=".3"/></geometry></visual>'),
    '<link name="hand"><inertial><origin xyz="0 0 .1"/><mass value="2"/>' + INERTIA + "</inertial>"
    '<collision><origin xyz="0 0 .2" rpy="1 0 0"/><geometry><box size=".1 .2 .3"/></geometry></collision>'
    '<visual><geometry><mesh filename="hand.stl"/></geometry></visual>'
    '<visual><geometry><mesh filename="hand.stl" scale=".001 .001 -.001"/></geometry></visual></link>',
    LINK.format("tip", '<collision><geometry><sphere radius=".01"/></geometry></collision>'),
    LINK.format("left", ""),
    LINK.format("right", ""),
    '<link name="bare"/>',
    *(
        f'<joint name="{child}_joint" type="{kind}"><origin xyz="0 .1 .5"/><parent link="{parent}"/>'
        f'<child link="{child}"/><axis xyz="0 1 0"/>{rest}</joint>'
        for child, parent, kind, rest in (
            ("hand", "base", "revolute", LIMIT.format(-1, 1)),
            ("tip", "hand", "fixed", ""),
            ("bare", "hand", "fixed", ""),
            ("left", "hand", "prismatic", LIMIT.format(0, 0.04) + '<safety_controller soft_upper_limit=".03"/>'),
            ("right", "hand", "prismatic", LIMIT.format(0, 0.04) + '<mimic joint="left_joint" offset=".01"/>'),
        )
    ),
    '<gazebo reference="hand"><sensor type="camera"><pose>.1 0 .2 0 1.5 0</pose></sensor></gazebo>',
)


def tree(description: Description) -> ElementTree.Element:
    return ElementTree.fromstring(description.source)


def joint(root: ElementTree.Element, name: str) -> ElementTree.Element:
    return next(each for each in root.iter("joint") if each.get("name") == name)


def test_a_limb_with_what_is_fixed_to_it_grows_and_what_hangs_on_it_moves():
    variant = scale_limbs(GRIPPER, {"hand": LimbScale(length=2, mass=3, gain=4)})
    root = tree(variant.description)
    hand = root.findall("link")[1]
    assert hand.find("inertial/origin").get("xyz") == "0 0 0.2"
    assert hand.find("inertial/mass").get("value") == "48"
    assert hand.find("inertial/inertia").get("ixx") == "9.6"
    assert hand.find("collision/geometry/box").get("size") == "0.2 0.4 0.6"
    assert dict(hand.find("collision/origin").attrib) == {"xyz": "0 0 0.4", "rpy": "1 0 0"}
    assert [mesh.get("scale") for mesh in hand.iter("mesh")] == ["2 2 2", "0.002 0.002 -0.002"]
    assert root.find("gazebo//pose").text == "0.2 0 0.4 0 1.5 0"
    assert next(root.iter("sphere")).get("radius") == "0.02"
    assert [joint(root, f"{name}_joint").find("origin").get("xyz") for name in ("hand", "tip", "left")] == [
        "0 .1 .5",
        "0 0.2 1",
        "0 0.2 1",
    ]
    assert joint(root, "hand_joint").find("limit").get("effort") == "4"
    assert joint(root, "left_joint").find("limit").get("effort") == "1"
    assert next(root.iter("cylinder")).get("length") == ".3"
    assert [(loss.kind, loss.name) for loss in variant.lost] == [("mass", "bare")]


def test_slides_go_farther_and_what_mimics_them_keeps_up():
    variant = scale_limbs(GRIPPER, {"left": LimbScale(length=2), "right": LimbScale(length=3)})
    root = tree(variant.description)
    assert joint(root, "left_joint").find("limit").get("upper") == "0.08"
    assert joint(root, "left_joint").find("safety_controller").get("soft_upper_limit") == "0.06"
    assert dict(joint(root, "right_joint").find("mimic").attrib) == {
        "joint": "left_joint",
        "offset": "0.03",
        "multiplier": "1.5",
    }
    same = scale_limbs(GRIPPER, {"left": LimbScale(length=2), "right": LimbScale(length=2)}).description
    assert "multiplier" not in joint(tree(same), "right_joint").find("mimic").attrib


def test_gains_and_start_that_are_known_besides_the_file_fit_the_limb():
    info = RobotInfo(gains={"*_joint": (10.0, 1.0)}, start={"left_joint": 0.04, "hand_joint": 0.5}, expert_return=1.0)
    robot = Description("r", "r.urdf", "urdf", GRIPPER.source, info=info)
    found = scale_limbs(robot, {"left": LimbScale(length=2, gain=3)}, name="big").description
    assert found.name == "big"
    assert found.file == "big.urdf"
    assert next(iter(found.info.gains.items())) == ("left_joint", (30.0, 3.0))
    assert found.info.gains["*_joint"] == (10.0, 1.0)
    assert found.info.start == {"left_joint": 0.08, "hand_joint": 0.5}
    assert found.info.expert_return is None


@pytest.mark.parametrize("robot", ["quadruped", "planar_cheetah"])
def test_scaled_and_converted_is_converted_and_scaled(robot):
    description = load(robot)
    scales = {
        limb.name: LimbScale(length=0.8 + 0.05 * number, mass=1.3 - 0.05 * number)
        for number, limb in enumerate(read(description).limbs)
    }
    first = compiled(scale_limbs(description, scales).description)
    converted = convert(description, thorough=False).spec.to_xml()
    again = scale_limbs(Description(robot, f"{robot}.xml", "mjcf", converted.encode()), scales).description
    second = mujoco.MjModel.from_xml_string(again.source.decode())
    for name in ("body_mass", "body_inertia", "body_ipos", "body_pos", "geom_size", "geom_pos", "actuator_ctrlrange"):
        one, other = getattr(first, name), getattr(second, name)
        np.testing.assert_allclose(one, other, atol=2e-5, rtol=1e-4, err_msg=name)  # to_xml writes six digits


def compiled(description: Description) -> mujoco.MjModel:
    return convert(description, thorough=False).spec.compile()
