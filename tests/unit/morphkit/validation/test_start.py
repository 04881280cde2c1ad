"""What `check` says of the pose in which a robot starts."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
import trimesh

from morphkit.ablation.ablate import ablate
from morphkit.description import RobotInfo
from morphkit.families.write import write_family
from morphkit.registry import load
from morphkit.validation import urdf_conversion
from morphkit.validation.check import check
from morphkit.validation.mujoco_checks import examine
from tests.support.faulty_robots import lines_of

LINK = """<link name="{0}"><inertial><mass value="1"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/>
</inertial><collision><origin xyz="0 0 -.2"/><geometry><box size=".05 .05 .4"/></geometry></collision></link>\n"""
JOINT = """<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><origin xyz="0 0 -.4"/>
<axis xyz="0 1 0"/><limit lower="-4" upper="4" effort="20" velocity="10"/></joint>\n"""
CHAIN = (
    '<robot name="r">\n'
    + "".join(map(LINK.format, "abc"))
    + JOINT.format("one", "a", "b")
    + JOINT.format("two", "b", "c")
    + "</robot>"
)
"""A chain that touches itself nowhere, unless a joint folds it back."""


def touching(tmp_path: Path, start: str | dict[str, float]) -> list[list[str]]:
    found = urdf_conversion.examine(CHAIN, "r.urdf", str(tmp_path), {}, start)
    assert found["refused"] == ""
    return [each["bodies"] for each in found["touching"]]


def test_links_overlap_where_the_start_folds_them(tmp_path: Path) -> None:
    assert touching(tmp_path, "") == []
    assert touching(tmp_path, {"one": 3.1, "two": -3.1}) == [["a", "c"]]  # neighbors do not count
    assert "cannot start" in urdf_conversion.examine(CHAIN, "r.urdf", str(tmp_path), {}, {"one": 9.0})["refused"]


def test_what_is_fixed_to_a_neighbor_is_a_neighbor(tmp_path: Path) -> None:
    source = CHAIN.replace("</robot>", LINK.format("d") + '<joint name="f" type="fixed"><parent link="a"/>')
    source += '<child link="d"/><origin xyz="0 0 -.4"/></joint></robot>'
    assert urdf_conversion.examine(source, "r.urdf", str(tmp_path), {}, "")["touching"] == []


def test_a_robot_toml_next_to_the_file_counts(tmp_path: Path) -> None:
    (tmp_path / "r.urdf").write_text(CHAIN)
    (tmp_path / "robot.toml").write_text('file = "r.urdf"\nstart = {one = 3.1, two = -3.1}\n')
    assert lines_of(check(tmp_path / "r.urdf"), "links-overlap") == [6]


def bench(width: float, center: float, legs: int = 2) -> str:
    """10 kg at 0.4 m above the floor, at `center` along x, on legs that are `width` wide and end at x = 0.4, -0.4."""
    inertia = '<inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/>'
    source = f"""<robot name="r">
      <link name="a"><inertial><origin xyz="{center} 0 0"/><mass value="10"/>{inertia}</inertial></link>"""
    for name, x in list(zip("bc", (0.3, -0.3), strict=True))[:legs]:
        source += f"""<link name="{name}"><inertial><mass value="1e-5"/>{inertia.replace(".1", "1e-5")}</inertial>
          <collision><origin xyz="0 0 -.2"/><geometry><box size=".2 {width} .4"/></geometry></collision></link>"""
        source += JOINT.format(name, "a", name).replace("0 0 -.4", f"{x} 0 0")
    return source + "</robot>"


@pytest.mark.parametrize(
    ("robot", "angle"),
    [
        (bench(0.2, 0.0), math.atan2(0.1, 0.4)),
        (bench(0.2, 0.35), math.atan2(0.05, 0.4)),
        (bench(0.2, 0.5), math.atan2(-0.1, 0.4)),
        (bench(0.2, 0.0, legs=1), None),
        (CHAIN, None),
    ],
)
def test_a_robot_tips_over_where_its_feet_do_not_support_it(tmp_path: Path, robot: str, angle: float | None) -> None:
    found = urdf_conversion.examine(robot, "r.urdf", str(tmp_path), {}, "")["tips_at"]
    assert found == (None if angle is None else pytest.approx(angle, abs=2e-3))


def test_check_reports_what_barely_stands(tmp_path: Path) -> None:
    (tmp_path / "r.urdf").write_text(bench(0.1, 0.0))
    assert lines_of(check(tmp_path / "r.urdf"), "start-tips") == [1]


def test_a_family_says_where_its_variants_start(tmp_path: Path) -> None:
    (tmp_path / "r.urdf").write_text(CHAIN)
    info = RobotInfo(start={"one": 3.1, "two": -3.1})
    robot = replace(load(tmp_path / "r.urdf"), info=info)
    write_family(robot, [ablate(robot, remove=[], name="r_all")], tmp_path / "family")
    assert lines_of(check(tmp_path / "family" / "r_all.urdf"), "links-overlap") == [6]
    (tmp_path / "family" / "manifest.json").write_text('{"name": "another program"}')
    assert not lines_of(check(tmp_path / "family" / "r_all.urdf"), "links-overlap")


def test_a_family_says_where_the_meshes_of_its_variants_are(tmp_path: Path) -> None:
    (tmp_path / "source").mkdir()
    trimesh.creation.box((0.1, 0.1, 0.1)).export(tmp_path / "source" / "box.stl")
    source = CHAIN.replace('<box size=".05 .05 .4"/>', '<mesh filename="box.stl"/>', 1)
    (tmp_path / "source" / "r.urdf").write_text(source)
    robot = load(tmp_path / "source" / "r.urdf")
    write_family(robot, [ablate(robot, remove=["c"], name="r_2")], tmp_path / "family", assets="reference")
    assert check(tmp_path / "family" / "r_2.urdf").count("error") == 0
    (tmp_path / "family" / "manifest.json").unlink()
    assert lines_of(check(tmp_path / "family" / "r_2.urdf"), "file-outside")


POST = '<body name="post" pos=".9 0 .3"><geom size=".1"/></body>'


def mjcf(joint: str, keys: str, post: str = "") -> str:
    return f"""<mujoco><worldbody><geom type="plane" size="1 1 1"/><body name="a" pos="0 0 .3">{joint}
      <geom type="box" size=".1 .1 .1"/><body name="b" pos=".3 0 0"><joint name="j" type="slide" axis="1 0 0"/>
      <geom size=".1"/><body name="c" pos=".3 0 0"><joint name="k" range="10 90"/><geom size=".1"/></body></body></body>
      {post}</worldbody><keyframe>{keys}</keyframe></mujoco>"""


@pytest.mark.parametrize(
    ("joint", "keys", "post", "start", "bodies"),
    [
        ("<freejoint/>", "", "", "", []),
        ("", '<key name="far" qpos="0 0"/><key name="home" qpos=".05 0"/>', POST, "", []),
        ("", '<key name="far" qpos="0 0"/><key name="home" qpos=".05 0"/>', POST, {"j": 0.15}, [["c", "post"]]),
        ('<joint type="slide" axis="0 0 1"/>', '<key name="home" qpos="-.25 0 0"/>', "", "", []),
        ("", '<key name="home" qpos="1 2 3 4"/>', "", "", []),
    ],
)
def test_an_mjcf_is_looked_at_where_it_starts(
    tmp_path: Path, joint: str, keys: str, post: str, start: str | dict[str, float], bodies: list[list[str]]
) -> None:
    found = examine(mjcf(joint, keys, post), "r.xml", str(tmp_path), {}, start)
    assert [each["bodies"] for each in found["touching"]] == bodies


def test_geoms_in_the_world_count_too(tmp_path: Path) -> None:
    source = mjcf("", "").replace('pos="0 0 .3"', 'pos="0 0 .05"')
    found = examine(source, "r.xml", str(tmp_path), {}, "")
    assert ["world", "b"] in [each["bodies"] for each in found["touching"]]
    assert [each["depth"] for each in found["touching"]] == pytest.approx([0.05] * 2, abs=1e-3)
    assert found["outside"] == ["k"]


@pytest.mark.parametrize("start", ["zero", {"k": 1.0}])
def test_a_start_that_is_said_answers_for_the_zero_pose(tmp_path: Path, start: str | dict[str, float]) -> None:
    assert examine(mjcf("", ""), "r.xml", str(tmp_path), {}, start)["outside"] == []
    assert examine(mjcf("", '<key qpos="0 .5"/>'), "r.xml", str(tmp_path), {}, "")["outside"] == []
    (tmp_path / "r.urdf").write_text(CHAIN.replace('lower="-4"', 'lower="0.5"', 1))
    assert lines_of(check(tmp_path / "r.urdf", deep=False), "zero-outside") == [9]
    said = '"zero"' if isinstance(start, str) else "{one = 1.0}"
    (tmp_path / "robot.toml").write_text(f'file = "r.urdf"\nstart = {said}\n')
    assert not lines_of(check(tmp_path / "r.urdf", deep=False), "zero-outside")
