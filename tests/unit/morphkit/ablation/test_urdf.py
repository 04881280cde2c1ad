from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from morphkit.ablation.ablate import Loss, ablate, set_root_height
from morphkit.description import Description
from morphkit.errors import AblationError
from morphkit.registry import load
from morphkit.simulation.spec import load_spec

LEG = b"""<robot name="leg" xmlns:drake="http://drake.mit.edu">
  <link name="base">INERTIAL</link>
  <link name="thigh">INERTIAL</link>
  <link name="shin">INERTIAL</link>
  <link name="foot">INERTIAL</link>
  <link name="toe">INERTIAL</link>
  <link name="tail">INERTIAL</link>
  <joint name="hip" type="revolute"><parent link="base"/><child link="thigh"/>
    <origin xyz=".1 .2 .3" rpy=".4 -.5 .6"/><axis xyz="0 1 0"/>LIMIT</joint>
  <joint name="knee" type="revolute"><parent link="thigh"/><child link="shin"/>
    <origin xyz="0 .1 -.5" rpy="1 .2 .3"/><axis xyz="0 1 0"/>LIMIT</joint>
  <joint name="weld" type="fixed"><parent link="shin"/><child link="foot"/><origin xyz="0 0 -.5" rpy="0 .7 0"/></joint>
  <joint name="curl" type="revolute"><parent link="foot"/><child link="toe"/>
    <axis xyz="0 1 0"/>LIMIT</joint>
  <joint name="wag" type="revolute"><parent link="base"/><child link="tail"/>
    <axis xyz="0 0 1"/>LIMIT
    <mimic joint="knee" multiplier="2"/></joint>
  <transmission name="hip_drive"><joint name="hip"/></transmission>
  <transmission name="knee_drive"><joint name="knee"/></transmission>
  <gazebo reference="foot"><mu1>1</mu1></gazebo>
  <gazebo reference="tail"><mu1>1</mu1></gazebo>
  <gazebo>
    <plugin name="bumper"><bodyName>foot</bodyName></plugin>
    <plugin name="states"><joint_name>hip</joint_name><joint_name>knee</joint_name></plugin>
  </gazebo>
  <ros2_control name="system" type="system">
    <hardware><plugin>sim</plugin></hardware>
    <joint name="knee"/>
    <joint name="wag"><param name="mimic">knee</param><param name="multiplier">2</param></joint>
    <sensor name="contact"><param name="frame">foot</param></sensor>
  </ros2_control>
  <disable_collisions link1="tail" link2="shin" reason="never"/>
  <disable_collisions link1="tail" link2="base" reason="adjacent"/>
  <sensor name="imu"><parent link="foot"/><origin xyz="0 0 0"/></sensor>
  <loop_joint name="loop"><link1 link="tail"/><link2 link="toe"/></loop_joint>
  <collisions margin=".1"><pair link1="tail" link2="toe"/></collisions>
  <drake:gear ratio="3"/>
</robot>
""".replace(b"LIMIT", b'<limit lower="-1" upper="1" effort="1" velocity="1"/>').replace(
    b"INERTIAL",
    b'<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>',
)


def urdf(source: bytes) -> Description:
    return Description("leg", "leg.urdf", "urdf", source)


def kinds(lost: tuple[Loss, ...]) -> set[tuple[str, str]]:
    return {(loss.kind, loss.name) for loss in lost}


def placed(model: mujoco.MjModel) -> mujoco.MjData:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return data


def test_unknown_urdf_elements_and_comments_survive():
    source = LEG.replace(b"<drake:gear", b"<!-- a comment --><anything goes='here'/><drake:gear")
    left = ablate(urdf(source), remove=["shin"]).description
    assert left.format == "urdf"
    assert b"<!-- a comment --><anything goes='here'/><drake:gear ratio=\"3\"/>" in left.source


def test_what_refers_to_a_urdf_link_goes(plain_spec):
    variant = ablate(urdf(LEG), remove=["shin"])
    assert variant.removed == ("shin", "toe")
    assert variant.limbs == ("base", "thigh", "tail")
    assert kinds(variant.lost) == {
        ("joint", "knee"), ("joint", "curl"), ("link", "foot"), ("mimic", "wag"), ("transmission", "knee_drive"),
        ("gazebo", "foot"), ("gazebo", "bumper"), ("gazebo", "states joint_name"), ("ros2_control", "knee"),
        ("mimic", "wag"), ("ros2_control", "contact"), ("disable_collisions", "disable_collisions of shin"),
        ("sensor", "imu"), ("loop_joint", "loop"), ("pair", "pair of toe"),
    }  # fmt: skip
    assert b'<collisions margin=".1"></collisions>' in variant.description.source
    assert Loss("sensor", "imu", "shin", "refers to foot") in variant.lost
    for word in (b"knee", b"foot", b"shin", b"toe", b"multiplier", b"bumper"):
        assert word not in variant.description.source
    assert b'<disable_collisions link1="tail" link2="base" reason="adjacent"/>' in variant.description.source
    model = plain_spec(variant.description).compile()
    assert [model.body(index).name for index in range(1, model.nbody)] == ["base", "thigh", "tail"]


def test_a_fixed_link_goes_with_what_hangs_on_it():
    variant = ablate(urdf(LEG), remove=["foot"])
    assert variant.removed == ("foot", "toe")
    assert variant.limbs == ("base", "thigh", "shin", "tail")
    assert Loss("joint", "curl", "toe", "part of toe") in variant.lost
    quadruped = ablate(load("quadruped"), remove=["foot"])
    assert len(quadruped.removed) == 4
    assert len(quadruped.limbs) == 13


def test_splice_of_a_urdf_keeps_orientation_and_puts_origins_where_the_limbs_was(plain_spec):
    variant = ablate(urdf(LEG), splice=["thigh", "shin"])
    assert variant.spliced == ("thigh", "shin")
    assert variant.limbs == ("base", "toe", "tail")
    old, new = placed(plain_spec(urdf(LEG)).compile()), placed(plain_spec(variant.description).compile())
    np.testing.assert_allclose(abs(new.body("toe").xquat @ old.body("toe").xquat), 1, atol=1e-12)
    np.testing.assert_allclose(new.joint("curl").xanchor, old.joint("hip").xanchor, atol=1e-12)


def test_a_urdf_has_no_root_height():
    with pytest.raises(AblationError, match="does not say where its root link is"):
        set_root_height(load("quadruped"), 0.5)


SHARING = """  <link name="{}">
    <inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><sphere radius="1"/></geometry>
      <material name="red">{}</material></visual></link>
"""
SHARED_JOINT = '  <joint name="j{0}" type="continuous"><parent link="a"/><child link="{0}"/></joint>\n'


def sharing(*colors: str | None) -> Description:
    """A base and links `b`, `c`, `d` of one material's name, each with a color of its own or none."""
    color = '\n        <color rgba="{} 0 0 1"/>\n      '
    named = list(zip("bcd", colors, strict=False))
    links = [SHARING.format(name, color.format(red) if red else "") for name, red in named]
    joints = "".join(SHARED_JOINT.format(name) for name, _ in named)
    source = f'<robot name="r">\n  <link name="a"/>\n{"".join(links)}{joints}</robot>\n'
    return Description("r", "r.urdf", "urdf", source.encode())


def reds(spec: mujoco.MjSpec) -> dict[str, float]:
    model = spec.compile()
    bodies = [model.body(body).name for body in model.geom_bodyid]
    return dict(zip(bodies, model.geom_rgba[:, 0].astype(float).round(6).tolist(), strict=True))


@pytest.mark.parametrize(
    ("colors", "kept"),
    [
        ((".1", None, None), True),
        ((".1", None, ".2"), True),  # `c` would get the color of `d`
        ((".1", ".2", None), True),  # `d` too
        ((".1", ".1", None), False),
        ((".1", ".1", ".2"), False),
        ((None, ".1", None), False),
    ],
)
def test_what_shares_a_material_with_a_removed_link_keeps_its_color(plain_spec, colors, kept):
    robot = sharing(*colors)
    variant = ablate(robot, remove=["b"])
    before = reds(plain_spec(robot))
    del before["b"]
    assert reds(plain_spec(variant.description)) == before
    assert [(loss.name, loss.limb) for loss in variant.lost if loss.kind == "material"] == [("red", "b")] * kept
    # The definition is where the link was, and nothing else is new.
    lines, old = variant.description.source.decode().split("\n"), iter(robot.source.decode().split("\n"))
    own = ['  <material name="red">', '    <color rgba=".1 0 0 1"/>', "  </material>"] if kept else []
    assert lines[2 : 2 + len(own)] == own
    assert all(line in old for line in [*lines[:2], *lines[2 + len(own) :]])
    assert b"color" not in ablate(variant.description, remove=["c", "d"], drop_assets=True).description.source


def test_a_material_of_the_robot_itself_counts_wherever_it_stands():
    own = b'  <material name="red"><color rgba=".9 0 0 1"/></material>\n'
    links = sharing(".1", None)
    for source in (
        links.source.replace(b'  <link name="a"/>', own + b'  <link name="a"/>'),
        links.source.replace(b"</robot>", own + b"</robot>"),
    ):
        robot = replace(links, source=source)
        variant = ablate(robot, remove=["b"])
        assert reds(load_spec(robot)[0]) == {"b": 0.1, "c": 0.9}
        assert reds(load_spec(variant.description)[0]) == {"c": 0.9}
        assert variant.description.source.count(b"<material") == source.count(b"<material") - 1
        assert not [loss for loss in variant.lost if loss.kind == "material"]
