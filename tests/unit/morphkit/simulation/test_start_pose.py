"""The start pose: from `robot.toml`, a keyframe or the zero pose, within limits, on the ground."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import morphkit
from morphkit.ablation.ablate import ablate
from morphkit.conversion.convert import convert
from morphkit.description import Description, RobotInfo
from morphkit.errors import DescriptionError
from morphkit.families.write import write_family
from morphkit.registry import load, recipes, shipped
from morphkit.simulation.build import build_simulation
from morphkit.simulation.ground import lowest_point
from morphkit.simulation.inspection_model import load_mechanics

LINK = """<link name="{0}"><inertial><mass value="1"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/>
</inertial><collision><origin xyz="0 0 -.2"/><geometry><box size=".05 .05 .4"/></geometry></collision></link>"""
JOINT = """<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><origin xyz="0 0 -.4"/>
<axis xyz="0 1 0"/><limit lower="{3}" upper="{4}" effort="20" velocity="10"/>{5}</joint>"""


def leg(low: float = -2.8, high: float = -0.8, mimic: str = "", **info: Any) -> Description:
    """A trunk with a thigh and a calf, whose zero is outside of `low` to `high`."""
    source = '<robot name="leg">' + "".join(LINK.format(name) for name in ("trunk", "thigh", "calf"))
    source += JOINT.format("hip", "trunk", "thigh", -1, 1, mimic) + JOINT.format("knee", "thigh", "calf", low, high, "")
    return Description("leg", "leg.urdf", "urdf", f"{source}</robot>".encode(), info=RobotInfo(**info))


def mjcf(joint: str = "<freejoint/>", keys: str = "", floor: float = 0.0, **info: Any) -> Description:
    """A box on a base of its own, with one limb."""
    source = f"""<mujoco><worldbody><geom type="plane" size="1 1 1" pos="0 0 {floor}"/>
      <body name="box" pos="0 0 1">{joint}<geom type="box" size=".2 .2 .1"/>
      <body name="arm"><joint name="elbow" axis="0 1 0" range="20 90"/>
      <geom type="capsule" size=".02" fromto="0 0 0 .5 0 0"/></body></body></worldbody>
      <keyframe>{keys}</keyframe></mujoco>"""
    return Description("box", "box.xml", "mjcf", source.encode(), info=RobotInfo(**info))


def joints(description: Description, base: Any = None) -> dict[str, float]:
    simulation = build_simulation(description, base=base)
    model = simulation.model
    hinges = [j for j in range(model.njnt) if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE]
    return {model.joint(j).name: float(simulation.start[model.jnt_qposadr[j]]) for j in hinges}


@pytest.mark.parametrize(
    ("start", "knee"),
    [("", -0.8), ("middle", -1.8), ("zero", 0.0), ({"knee": -1.5}, -1.5), ({"hip": 0.5, "not here": 1.0}, -0.8)],
)
def test_a_joint_starts_within_its_limits(start: Any, knee: float) -> None:
    found = joints(leg(start=start), base="free")
    assert found == {"hip": start.get("hip", 0.0) if isinstance(start, dict) else 0.0, "knee": pytest.approx(knee)}


def test_a_start_outside_of_limits_is_refused() -> None:
    with pytest.raises(
        DescriptionError, match=r"leg\.urdf: joint 'knee' cannot start at 1: its limits are -2\.8 to -0\.8"
    ):
        build_simulation(leg(start={"knee": 1.0}), base="free")


@pytest.mark.parametrize(
    ("keys", "start", "elbow"),
    [
        ('<key name="a" qpos="0 0 1 1 0 0 0 .4"/><key name="stand" qpos="0 0 1 1 0 0 0 .5"/>', "", 0.5),
        ('<key name="stand" qpos="0 0 1 1 0 0 0 .5"/><key name="home" qpos="0 0 1 1 0 0 0 .6"/>', "", 0.6),
        ('<key name="a" qpos="0 0 1 1 0 0 0 .4"/><key name="b" qpos="0 0 1 1 0 0 0 .5"/>', "", 0.4),
        ('<key name="a" qpos="0 0 1 1 0 0 0 .4"/><key name="b" qpos="0 0 1 1 0 0 0 .5"/>', "b", 0.5),
        ('<key name="home" qpos="0 0 1 1 0 0 0 9"/>', "", np.pi / 2),
        ('<key name="home" qpos="0 0 1 1 0 0 0 .4"/>', "middle", np.radians(55)),
        ("", "", np.radians(20)),
    ],
)
def test_keyframes_count_in_order(keys: str, start: str, elbow: float) -> None:
    description = mjcf(keys=keys, start=start)
    assert joints(description)["elbow"] == pytest.approx(elbow)
    mechanics = load_mechanics(description)
    np.testing.assert_allclose(mechanics.start, build_simulation(description).start, atol=1e-12)


def test_a_keyframe_that_is_not_there_is_refused() -> None:
    with pytest.raises(DescriptionError, match="'start' names keyframe 'hom', which is not there; did you mean 'home'"):
        build_simulation(mjcf(keys='<key name="home" qpos="0 0 1 1 0 0 0 .5"/>', start="hom"))


SLIDES = '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 -1"/><joint axis="0 1 0"/>'


@pytest.mark.parametrize("floor", [0.0, -2.0])
@pytest.mark.parametrize("joint", ["<freejoint/>", SLIDES])
def test_the_robot_touches_the_ground_where_it_starts(joint: str, floor: float) -> None:
    simulation = build_simulation(mjcf(joint, floor=floor))
    root = int(simulation.limb_body[0])
    assert lowest_point(simulation.model, root, simulation.start) == pytest.approx(floor)


def test_a_slide_keeps_the_height_of_its_file_in_the_zero_pose() -> None:
    simulation = build_simulation(mjcf(SLIDES, start="zero"))
    np.testing.assert_array_equal(simulation.start, simulation.model.qpos0)


def test_what_else_stands_in_the_world_leaves_the_height_alone() -> None:
    source = mjcf().source.replace(b"<body name", b'<geom type="box" size=".1 .1 .5" pos="2 0 0"/><body name', 1)
    assert build_simulation(replace(mjcf(), source=source)).start[2] == 1.0


def test_followers_start_where_their_leaders_put_them() -> None:
    mimic = '<mimic joint="knee" multiplier="-.5" offset=".1"/>'
    assert joints(leg(mimic=mimic), base="free")["hip"] == pytest.approx(0.5)


def test_the_converted_robot_starts_alike(tmp_path: Path) -> None:
    conversion = convert(leg(start="middle"), base="free")
    made = Description("leg", "leg.xml", "mjcf", conversion.spec.to_xml().encode())
    expected = build_simulation(leg(start="middle"), base="free")
    np.testing.assert_allclose(build_simulation(made).start, expected.start, atol=1e-6)
    assert lowest_point(expected.model, 1, expected.start) == pytest.approx(0, abs=1e-9)
    assert any("keyframe 'home'" in note for note in conversion.notes)


def test_a_cut_keeps_the_start_pose_on_disk_too(tmp_path: Path) -> None:
    source = leg(start={"hip": 0.25, "knee": -1.5})
    variant = ablate(source, remove=["calf"])
    assert joints(variant.description, base="free") == {"hip": 0.25}
    manifest = write_family(source, [variant], tmp_path / "family")
    assert joints(morphkit.load(manifest), base="free") == {"hip": 0.25}


@pytest.mark.parametrize(
    ("toml", "words"),
    [
        ("start = {knie = -1.5}", r"start: there is no hinge or slide 'knie' in leg\.urdf; did you mean 'knee'"),
        ("start = {knee = nan}", "a number, not nan"),
        ("start = 3", "start must be a table of joints, 'zero', 'middle' or a keyframe, not 3"),
    ],
)
def test_robot_toml_says_the_start(tmp_path: Path, toml: str, words: str) -> None:
    (tmp_path / "leg.urdf").write_bytes(leg().source)
    (tmp_path / "robot.toml").write_text('file = "leg.urdf"\nstart = {knee = -1.5}\n')
    assert joints(load(tmp_path / "leg.urdf"), base="free")["knee"] == -1.5
    (tmp_path / "robot.toml").write_text(f'file = "leg.urdf"\n{toml}\n')
    with pytest.raises(DescriptionError, match=words):
        load(tmp_path / "leg.urdf")


def test_benchmark_bodies_start_in_the_zero_pose() -> None:
    planar = [robot.name for robot in shipped() if robot.info.base == "planar"]
    for name in [each for robot in planar for each in (robot, *recipes(robot))]:
        simulation = build_simulation(load(name))
        np.testing.assert_array_equal(simulation.start, simulation.model.qpos0, err_msg=name)


def test_joints_that_start_elsewhere_are_named() -> None:
    assert any("so they start elsewhere: knee" in note for note in build_simulation(leg(), base="free").notes)
    assert not any("zero pose" in note for note in build_simulation(leg(start="zero"), base="free").notes)
