from __future__ import annotations

import math
import subprocess
import sys
import time
from dataclasses import replace

import mujoco
import pytest

from morphkit.description import Description, RobotInfo
from morphkit.errors import DescriptionError, UnknownNameError
from morphkit.morphology import Joint, Reading, Sensor
from morphkit.readers import read

INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'


def link(name: str) -> str:
    return f'<link name="{name}">{INERTIAL}</link>\n'


def joint(name: str, kind: str, parent: str, child: str, inside: str = "") -> str:
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{inside}</joint>\n'


def urdf(*parts: str, **fields: object) -> Description:
    source = f'<robot name="r">\n{"".join(parts)}</robot>\n'.encode()
    return Description(name="r", file="r.urdf", format="urdf", source=source, **fields)  # type: ignore[arg-type]


LIMIT = '<limit lower="-1" upper="2" effort="30" velocity="5"/>'
DOG = (
    *map(link, ("trunk", "knee", "hip", "foot", "imu", "tail", "toe")),
    joint("imu_joint", "fixed", "trunk", "imu"),
    joint("tail_joint", "continuous", "imu", "tail", '<limit effort="3" velocity="1"/>'),
    joint("hip_joint", "revolute", "trunk", "hip", LIMIT),
    joint("foot_joint", "fixed", "knee", "foot"),
    joint("knee_joint", "prismatic", "hip", "knee", '<limit upper="0.5" effort="7" velocity="1"/>'),
    joint("toe_joint", "revolute", "foot", "toe", LIMIT + '<mimic joint="hip_joint" multiplier="2"/>'),
)


def test_limbs_members_and_joints() -> None:
    morphology = read(urdf(*DOG))
    assert [(limb.name, limb.parent, limb.members) for limb in morphology.limbs] == [
        ("trunk", None, ("trunk", "imu")),
        ("tail", "trunk", ("tail",)),
        ("hip", "trunk", ("hip",)),
        ("knee", "hip", ("knee", "foot")),
        ("toe", "knee", ("toe",)),
    ]
    assert morphology.root.joints == ()
    assert morphology.joints == (
        Joint("tail_joint", "hinge", False, 0.0, 0.0),
        Joint("hip_joint", "hinge", True, -1.0, 2.0),
        Joint("knee_joint", "slide", True, 0.0, 0.5),
        Joint("toe_joint", "hinge", True, -1.0, 2.0),
    )
    assert (morphology.base, morphology.format, len(morphology.sha256)) == ("fixed", "urdf", 64)


def test_actuators_from_effort_limits_leave_mimics_out() -> None:
    found = read(urdf(*DOG)).actuators
    assert [(a.name, a.limb, a.joint, a.low, a.high, a.unit) for a in found] == [
        ("tail_joint", "tail", "tail_joint", -3.0, 3.0, "N*m"),
        ("hip_joint", "hip", "hip_joint", -30.0, 30.0, "N*m"),
        ("knee_joint", "knee", "knee_joint", -7.0, 7.0, "N"),
    ]


def transmission(name: str, joints: tuple[str, ...], actuators: tuple[str, ...]) -> str:
    inside = "".join(f'<joint name="{name}"/>' for name in joints)
    inside += "".join(f'<actuator name="{name}"/>' for name in actuators)
    return f'<transmission name="{name}"><type>T</type>{inside}</transmission>\n'


def test_transmissions_decide_where_there_are_some() -> None:
    parts = (transmission("t1", ("knee_joint",), ("motor",)), transmission("t2", ("hip_joint",), ("motor",)))
    found = read(urdf(*DOG, *parts, transmission("t3", ("toe_joint",), ("m",)))).actuators
    assert [(a.name, a.joint, a.high) for a in found] == [("motor", "knee_joint", 7.0), ("motor_2", "hip_joint", 30.0)]


def test_a_differential_transmission_gives_one_actuator_a_joint() -> None:
    found = read(urdf(*DOG, transmission("t", ("knee_joint", "tail_joint"), ("left", "right")))).actuators
    assert [(a.name, a.joint) for a in found] == [("left", "knee_joint"), ("right", "tail_joint")]


def test_a_joint_without_an_effort_limit() -> None:
    parts = (link("a"), link("b"), joint("j", "revolute", "a", "b"))
    assert read(urdf(*parts)).actuators == ()
    assert read(urdf(*parts)).joints == (Joint("j", "hinge", False, 0.0, 0.0),)
    (actuator,) = read(urdf(*parts, transmission("t", ("j",), ()))).actuators
    assert (actuator.name, actuator.low, actuator.high) == ("j", -math.inf, math.inf)


def test_planar_joints_are_those_of_mujoco() -> None:
    description = urdf(*map(link, "ab"), joint("j", "planar", "a", "b"))
    model = mujoco.MjModel.from_xml_string(description.source.decode())
    found = read(description).joints
    assert [j.name for j in found] == [model.joint(i).name for i in range(model.njnt)]
    assert [j.kind for j in found] == ["slide", "slide", "hinge"]


@pytest.mark.parametrize(
    ("kind", "base"), [("fixed", "fixed"), ("floating", "free"), ("planar", "planar"), ("continuous", "fixed")]
)
def test_a_world_link_is_the_world(kind: str, base: str) -> None:
    inside = LIMIT if kind == "continuous" else ""
    morphology = read(urdf('<link name="world"/>', *DOG, joint("w", kind, "world", "trunk", inside)))
    assert (morphology.root.name, morphology.root.joints, morphology.base) == ("trunk", (), base)
    driven = [(a.limb, a.joint) for a in morphology.actuators if a.joint == "w"]
    assert driven == ([("trunk", "w")] if kind == "continuous" else [])


def test_info_wins_and_gives_types() -> None:
    info = RobotInfo(base="free", family="dogs", task="locomotion", type_words=(("trunk",), ("hip", "knee")))
    morphology = read(urdf(*DOG, info=info))
    assert (morphology.base, morphology.family, morphology.task) == ("free", "dogs", "locomotion")
    assert [limb.type for limb in morphology.limbs] == ["trunk", None, "hip", "hip", None]
    by_joint = read(urdf(*DOG, info=replace(info, type_matched_in="joint", type_words=(("toe_j",), ("trunk",)))))
    assert [limb.type for limb in by_joint.limbs] == [None, None, None, None, "toe_j"]


def test_sensors() -> None:
    gazebo = '<gazebo reference="foot"><sensor name="touch" type="contact"/></gazebo><gazebo><plugin/></gazebo>'
    sensor = '<sensor name="eye" update_rate="1"><parent link="imu"/><origin/><camera/></sensor>'
    found = read(urdf(*DOG, gazebo, sensor)).sensors
    touched = Reading("contact", None, "1", None, 0.0, 1.0)
    assert found == (Sensor("eye", "camera", "trunk"), Sensor("touch", "contact", "knee", (touched,)))


A, B = link("a"), link("b")
TWINS = (link("c"), link("e"), joint("j", "continuous", "a", "b"), joint("j", "continuous", "a", "c"))


@pytest.mark.parametrize(
    ("parts", "line", "words"),
    [
        ((A, joint("j", "fixed", "arm", "a")), 3, "parent link 'arm' of joint 'j' does not exist"),
        ((A, link("b_link"), joint("j", "fixed", "a", "b_lnk")), 4, "did you mean 'b_link'"),
        ((A, B, joint("j", "fixed", "a", "b"), joint("k", "fixed", "b", "a")), 5, "cycle: b -> a -> b"),
        ((A, A), 3, "another link called 'a'"),
        (
            (A, A, B, joint("j", "fixed", "a", "b")),
            3,
            "two links are called 'a' (the first in line 2), and <joint> in line 5",
        ),
        (
            (A, B, joint("j", "fixed", "a", "b"), joint("j", "fixed", "a", "b")),
            5,
            "of joint 'j' (line 4); a link has one",
        ),
        ((A, B, link("c"), joint("j", "fixed", "a", "c"), joint("k", "fixed", "b", "c")), 6, "one parent"),
        ((A, B, joint("j", "revolut", "a", "b")), 4, "did you mean 'revolute'"),
        ((A, B, '<joint name="j" type="fixed"><child link="b"/></joint>'), 4, "no parent link"),
        ((A, "<link/>"), 3, "without a name"),
        ((A, B, joint("j", "revolute", "a", "b", '<limit lower="x"/>')), 4, "lower=\"x\" in <limit> of joint 'j'"),
        ((A, B, joint("j", "revolute", "a", "b", '<axis xyz="0 1"/>')), 4, "expected 3 numbers"),
        ((A, B, joint("j", "revolute", "a", "b", '<mimic joint="q"/>')), 4, "mimics joint 'q'"),
        (
            (A, B, *TWINS, joint("k", "revolute", "b", "e", '<mimic joint="j"/>')),
            7,
            "two joints are called 'j' (the first in",
        ),
        ((A, B, *TWINS, transmission("t", ("j",), ())), 7, "<joint> in line 8 refers to one of them; rename one"),
        (("",), 1, "no <link>"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(parts: tuple[str, ...], line: int, words: str) -> None:
    with pytest.raises(DescriptionError) as caught:
        read(urdf(*parts))
    assert str(caught.value).startswith(f"r.urdf:{line}: ")
    assert words in str(caught.value)


def test_several_roots() -> None:
    with pytest.raises(DescriptionError, match=r"2 top-level link elements.*: a, b\. .*--root"):
        read(urdf(A, B))
    assert [limb.name for limb in read(urdf(A, B, root="b")).limbs] == ["b"]
    with pytest.raises(UnknownNameError, match="no top-level link 'aa'; there is a, b; did you mean 'a'"):
        read(urdf(A, B, root="aa"))


def test_a_floating_joint_below_the_root() -> None:
    with pytest.raises(DescriptionError, match=r"floating joint 'j'.*'world'"):
        read(urdf(A, B, joint("j", "floating", "a", "b")))


def test_missing_meshes_do_not_matter() -> None:
    mesh = '<visual><geometry><mesh filename="package://nowhere/a.stl"/></geometry></visual><visual/>'
    assert read(urdf(f'<link name="a">{mesh}</link>')).root.name == "a"


def test_a_hundred_links_are_read_fast() -> None:
    names = [f"link_{i}" for i in range(100)]
    parts = [*map(link, names), *(joint(f"j{i}", "revolute", names[i], names[i + 1], LIMIT) for i in range(99))]
    read(urdf(A))  # the imports
    start = time.process_time()  # Other processes do not count.
    assert len(read(urdf(*parts)).limbs) == 100
    assert time.process_time() - start < 0.3


def test_yourdfpy_is_only_imported_for_a_urdf() -> None:
    code = "import sys, morphkit.readers.urdf; sys.exit('yourdfpy' in sys.modules or 'torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
