"""URDF into MJCF: kinematics and masses are those of the URDF, and MuJoCo simulates it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
import yourdfpy

import morphkit
from morphkit.completion import settle_urdf
from morphkit.conversion import Conversion, convert, write_conversion
from morphkit.conversion.inertias import possible_moments
from morphkit.conversion.trial import holds
from morphkit.description import Description
from morphkit.errors import AssetError, ConfigError, DescriptionError, OutputError
from morphkit.mesh_files import load_mesh
from morphkit.morphology import Base
from morphkit.simulation import build
from morphkit_cli.main import run

SPHERE = '<inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0.001" ixz="-0.002" iyz="0.003"/>'
INERTIAL = f'<inertial><origin xyz="0.01 -0.02 0.03" rpy="0.3 -0.2 0.9"/><mass value="{{}}"/>{SPHERE}</inertial>'
EVERYTHING = f"""<?xml version="1.0"?>
<robot name="everything">
  <link name="base">{INERTIAL.format(3)}
    <visual name="look"><geometry><mesh filename="meshes/part.dae" scale="2 2 2"/></geometry></visual>
    <collision name="look"><geometry><mesh filename="meshes/part.stl"/></geometry></collision>
  </link>
  <link name="upper">{INERTIAL.format(1)}
    <visual name="look"><geometry><mesh filename="meshes/text.stl"/></geometry></visual>
    <visual><geometry><mesh filename="meshes/missing.stl"/></geometry></visual>
    <collision><geometry><cylinder radius="0.05" length="0.4"/></geometry></collision>
  </link>
  <link name="sensor"><visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual></link>
  <link name="slider">{INERTIAL.format(0.5)}</link>
  <link name="axis"/>
  <link name="wheel"><inertial><mass value="0.7"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="finger"><inertial><mass value="0.1"/>
    <inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><origin xyz="0.1 0.2 0.3" rpy="0.4 0.5 0.6"/><parent link="base"/>
    <child link="upper"/><axis xyz="0 0.6 0.8"/><limit lower="-1" upper="2" effort="30" velocity="3"/>
    <dynamics damping="0.7" friction="0.2"/></joint>
  <joint name="mount" type="fixed"><origin xyz="0 0 0.2" rpy="1 0 -1"/><parent link="upper"/>
    <child link="sensor"/></joint>
  <joint name="rail" type="prismatic"><origin rpy="0 1.2 0"/><parent link="upper"/><child link="slider"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="0.5" effort="80" velocity="1"/>
    <safety_controller k_velocity="10"/></joint>
  <joint name="turn" type="revolute"><parent link="slider"/><child link="axis"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="spin" type="continuous"><origin xyz="0 0.1 0"/><parent link="axis"/><child link="wheel"/>
    <axis xyz="0 0 1"/></joint>
  <joint name="grip" type="revolute"><origin xyz="0.3 0 0"/><parent link="upper"/><child link="finger"/>
    <axis xyz="0 0 1"/><limit lower="-3" upper="5" effort="4" velocity="1"/>
    <mimic joint="shoulder" multiplier="-1.5" offset="0.2"/></joint>
  <gazebo reference="base"><material>Gazebo/Red</material></gazebo>
</robot>
"""


def robot(folder: Path) -> Path:
    """A URDF with every kind of joint and mesh."""
    (folder / "meshes").mkdir(parents=True)
    box = trimesh.creation.box((0.2, 0.3, 0.4))
    box.export(folder / "meshes" / "part.stl")
    box.export(folder / "meshes" / "text.stl", file_type="stl_ascii")
    box.apply_scale(1000)
    dae = trimesh.exchange.dae.export_collada(box).decode()
    millimetres = dae.replace("</asset>", '<unit name="millimeter" meter="0.001"/></asset>')
    (folder / "meshes" / "part.dae").write_text(millimetres)
    path = folder / "everything.urdf"
    path.write_text(EVERYTHING)
    return path


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return robot(tmp_path_factory.mktemp("robot"))


@pytest.fixture(scope="module")
def converted(source: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Conversion, Path]:
    path = tmp_path_factory.mktemp("out") / "out.xml"
    conversion = convert(morphkit.load(source))
    write_conversion(conversion, path)
    return conversion, path


def shipped(name: str) -> Path:
    description = morphkit.load(name)
    return description.folder / description.file


def assert_same_kinematics(urdf: Path, model: mujoco.MjModel) -> None:
    """Every link lies where yourdfpy has it, seen from the root, in random poses."""
    reference = yourdfpy.URDF.load(urdf, load_meshes=False, build_scene_graph=True)
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    for _ in range(5):
        pose = {name: rng.uniform(-1, 1) for name in reference.actuated_joint_names}
        reference.update_cfg(pose)
        for joint in reference.robot.joints:
            if joint.mimic is not None:
                pose[joint.name] = joint.mimic.multiplier * pose[joint.mimic.joint] + joint.mimic.offset
        for name, value in pose.items():
            data.joint(name).qpos[0] = value
        mujoco.mj_kinematics(model, data)
        root = data.body(reference.base_link)
        turn = root.xmat.reshape(3, 3).T
        for link in reference.robot.links:
            expected = reference.get_transform(link.name, reference.base_link)
            body = data.body(link.name)
            np.testing.assert_allclose(turn @ (body.xpos - root.xpos), expected[:3, 3], atol=1e-9)
            np.testing.assert_allclose(turn @ body.xmat.reshape(3, 3), expected[:3, :3], atol=1e-9)


def test_kinematics_are_those_of_the_urdf(source: Path, converted: tuple[Conversion, Path]) -> None:
    assert_same_kinematics(source, mujoco.MjModel.from_xml_path(str(converted[1])))


@pytest.mark.parametrize(
    ("name", "base"), [("quadruped", "free"), ("quadruped", "fixed"), ("planar_cheetah", "planar")]
)
def test_kinematics_of_shipped_robots(tmp_path: Path, name: str, base: str) -> None:
    write_conversion(convert(morphkit.load(name), base=base), tmp_path / "out.xml")  # type: ignore[arg-type]
    assert_same_kinematics(shipped(name), mujoco.MjModel.from_xml_path(str(tmp_path / "out.xml")))


def test_masses_and_inertias_are_those_of_the_urdf(source: Path, converted: tuple[Conversion, Path]) -> None:
    model = mujoco.MjModel.from_xml_path(str(converted[1]))
    changed = {"axis", "wheel", "finger"}  # no mass, and impossible inertias
    for link in yourdfpy.URDF.load(source, load_meshes=False).robot.links:
        body = model.body(link.name)
        if link.inertial is None:
            assert body.mass[0] == (1e-3 if link.name == "axis" else 0)  # the axis moves
            continue
        assert body.mass[0] == pytest.approx(link.inertial.mass, rel=1e-12)
        if link.name in changed:
            continue
        origin = link.inertial.origin
        axes = np.zeros(9)
        mujoco.mju_quat2Mat(axes, body.iquat)
        turn = axes.reshape(3, 3)
        tensor = origin[:3, :3] @ link.inertial.inertia @ origin[:3, :3].T
        np.testing.assert_allclose(body.ipos, origin[:3, 3], atol=1e-12)
        np.testing.assert_allclose(turn * body.inertia @ turn.T, tensor, atol=1e-12)


def test_joints_keep_limits_damping_and_friction(converted: tuple[Conversion, Path]) -> None:
    model = mujoco.MjModel.from_xml_path(str(converted[1]))
    shoulder = model.joint("shoulder")
    assert shoulder.range.tolist() == [-1, 2]
    dof = shoulder.dofadr[0]
    assert np.ravel(model.dof_damping[dof])[0] == 0.7
    assert model.dof_frictionloss[dof] == 0.2
    assert not model.joint("spin").limited
    assert model.dof_damping[model.joint("spin").dofadr[0]] == 0.1
    shares = {
        name: model.dof_dampingpoly[model.joint(name).dofadr[0]].tolist() for name in ("shoulder", "spin", "rail")
    }
    assert shares == {"shoulder": [0, 0], "spin": [0, 0], "rail": [0, pytest.approx(79.9)]}  # damped; no limit; 80 N
    assert [model.actuator(index).name for index in range(model.nu)] == ["shoulder", "rail", "turn"]
    assert model.actuator("rail").ctrlrange.tolist() == [-80, 80]


def test_mimic_holds_while_stepping(converted: tuple[Conversion, Path]) -> None:
    model = mujoco.MjModel.from_xml_path(str(converted[1]))
    data = mujoco.MjData(model)
    data.joint("grip").qpos[0] = 0.2
    data.ctrl[0] = 5.0
    for _ in range(200):
        mujoco.mj_step(model, data)
    leader, follower = (float(data.joint(name).qpos[0]) for name in ("shoulder", "grip"))
    assert abs(leader) > 0.05
    assert follower == pytest.approx(-1.5 * leader + 0.2, abs=0.02)


def test_meshes_have_the_size_of_their_files(converted: tuple[Conversion, Path]) -> None:
    conversion, path = converted
    model = mujoco.MjModel.from_xml_path(str(path))
    sizes = []
    for geom in np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_MESH):
        sizes.append(sorted((2 * model.geom_aabb[geom, 3:]).round(4).tolist()))
    # In file order: the .dae in millimetres and twice as large, the .stl, the .stl in text.
    assert sizes == [[0.4, 0.6, 0.8], [0.2, 0.3, 0.4], [0.2, 0.3, 0.4]]
    named = {Path(mesh.file).name for mesh in mujoco.MjSpec.from_file(str(path)).meshes}
    assert {file.name for file in (path.parent / "out_assets").iterdir()} == named
    assert {Path(name).suffix for name in named} == {".stl"}
    assert any("missing.stl" in note for note in conversion.notes)


def test_changes_and_losses_are_listed(converted: tuple[Conversion, Path]) -> None:
    conversion, _ = converted
    notes = "\n".join(conversion.notes)
    assert (
        "inertia of link 'wheel' is impossible: principal moments 0.01, 0.01, 0.03 became 0.015, 0.015, 0.03" in notes
    )
    assert "inertia of link 'finger' is impossible" in notes
    assert "joint 'spin' got no motor" in notes
    assert [(each.kind, each.name) for each in conversion.missing] == [
        ("velocity limit", "shoulder"),
        ("safety controller", "rail"),
        ("gazebo", "base"),
    ]
    assert conversion.missing[0].line == EVERYTHING[: EVERYTHING.index('velocity="3"')].count("\n") + 1


def test_meshes_of_mujoco_are_read(tmp_path: Path) -> None:
    box = trimesh.creation.box((1, 2, 3))
    counts = np.array([len(box.vertices), 0, 0, len(box.faces)], "<i4")
    content = counts.tobytes() + box.vertices.astype("<f4").tobytes() + box.faces.astype("<i4").tobytes()
    (tmp_path / "good.msh").write_bytes(content)
    assert load_mesh(tmp_path / "good.msh").extents.tolist() == [1, 2, 3]
    (tmp_path / "cut.msh").write_bytes(content[:-4])
    with pytest.raises(AssetError, match="length"):
        load_mesh(tmp_path / "cut.msh")


LINK = (
    '<link name="{}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    '<collision><geometry><sphere radius="0.1"/></geometry></collision></link>'
)
FREE, SLIDE, HINGE = (int(getattr(mujoco.mjtJoint, f"mjJNT_{kind}")) for kind in ("FREE", "SLIDE", "HINGE"))


def on_world(folder: Path, joint: str) -> Path:
    """A robot of one link that a joint ties to a link called `world`."""
    tie = f'<joint name="j" type="{joint}"><parent link="world"/><child link="a"/><axis xyz="0 0 1"/></joint>'
    (folder / "r.urdf").write_text(f'<robot name="r"><link name="world"/>{LINK.format("a")}{tie}</robot>')
    return folder / "r.urdf"


@pytest.mark.parametrize(
    ("joint", "asked", "kinds", "height"),
    [
        ("floating", None, [FREE], 0.11),
        ("planar", None, [SLIDE, SLIDE, HINGE], 0.11),
        ("fixed", None, [], 0.0),
        ("fixed", "free", [FREE], 0.11),
        ("fixed", "planar", [SLIDE, SLIDE, HINGE], 0.11),
    ],
)
def test_base_of_a_robot_on_a_world_link(
    tmp_path: Path, joint: str, asked: Base | None, kinds: list[int], height: float
) -> None:
    model = convert(morphkit.load(on_world(tmp_path, joint)), base=asked).spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    assert model.jnt_type.tolist() == kinds
    assert data.body("a").xpos[2] == pytest.approx(height)
    assert (model.ngeom == 2) == bool(kinds)  # a floor where the base moves


def test_base_that_contradicts_the_file(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="makes it free"):
        convert(morphkit.load(on_world(tmp_path, "floating")), base="fixed")


def test_other_roots_are_left_out(tmp_path: Path) -> None:
    (tmp_path / "r.urdf").write_text(f'<robot name="r">{LINK.format("a")}{LINK.format("b")}</robot>')
    conversion = convert(morphkit.load(tmp_path / "r.urdf", root="b"))
    assert [body.name for body in conversion.spec.bodies] == ["world", "b"]
    assert "link 'a' is no part of the tree below 'b' and was left out" in conversion.notes


def test_massless_moving_link_gets_a_gram(tmp_path: Path) -> None:
    text = EVERYTHING.replace('<mass value="0.7"/>', '<mass value="0"/>')
    path = robot(tmp_path / "r")
    path.write_text(text)
    conversion = convert(morphkit.load(path))
    model = conversion.spec.compile()
    assert model.body("axis").mass[0] == pytest.approx(1e-3)
    assert model.body("wheel").mass[0] == pytest.approx(1e-3)
    assert sum("moves and has no mass" in note for note in conversion.notes) == 2


def test_converted_robot_simulates_like_the_urdf(tmp_path: Path) -> None:
    write_conversion(convert(morphkit.load("quadruped"), base="free"), tmp_path / "quadruped.xml")
    ours, theirs = (build(morphkit.load(each)) for each in (tmp_path / "quadruped.xml", "quadruped"))
    assert [token.name for token in ours.tokens.sensors] == [token.name for token in theirs.tokens.sensors]
    for array in (
        "qpos0",
        "jnt_range",
        "dof_armature",
        "dof_damping",
        "actuator_ctrlrange",
        "body_inertia",
        "geom_size",
    ):
        np.testing.assert_allclose(getattr(ours.model, array), getattr(theirs.model, array), atol=1e-12, err_msg=array)


@pytest.mark.parametrize("moments", [(1, 2, 10), (0.1, 5, 5.2), (-1, 2, 3), (1, 1, 2.0000001), (-3, -2, 1e-3)])
def test_repaired_moments_are_possible(moments: tuple[float, float, float]) -> None:
    settled = possible_moments(np.array(moments, dtype=float), 1.0)
    low, middle, high = np.sort(settled)
    assert low > 0
    assert low + middle >= high == max(moments)
    assert np.array_equal(np.argsort(settled, kind="stable"), np.argsort(moments, kind="stable"))


def test_possible_moments_stay() -> None:
    moments = np.array([1.0, 1.5, 2.0])
    assert possible_moments(moments, 1.0) is moments
    plate = np.array([1.0, 1.0, 2.0])
    assert possible_moments(plate, 1.0) == pytest.approx(plate, rel=2e-9)
    assert possible_moments(np.zeros(3), 2.0).tolist() == pytest.approx([2e-4] * 3)


def test_mjcf_is_one_already() -> None:
    with pytest.raises(ConfigError, match="MJCF model already"):
        convert(morphkit.load("cheetah"))


def test_output_is_not_overwritten(converted: tuple[Conversion, Path], tmp_path: Path) -> None:
    conversion, _ = converted
    (tmp_path / "out.xml").write_text("mine")
    with pytest.raises(OutputError, match="--force"):
        write_conversion(conversion, tmp_path / "out.xml")
    assert (tmp_path / "out.xml").read_text() == "mine"
    assert [path.name for path in tmp_path.iterdir()] == ["out.xml"]
    (tmp_path / "out_assets").mkdir()
    write_conversion(conversion, tmp_path / "out.xml", force=True)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.xml", "out_assets"]


def test_same_input_same_bytes(source: Path, tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        write_conversion(convert(morphkit.load(source)), tmp_path / name / "out.xml")
    assert (tmp_path / "a" / "out.xml").read_bytes() == (tmp_path / "b" / "out.xml").read_bytes()


def test_command(tmp_path: Path, source: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "new" / "robot.xml"
    assert run(["convert", str(source), str(out), "--base", "free", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    model = mujoco.MjModel.from_xml_path(str(out))
    assert told["base"] == "free"
    assert (told["bodies"], told["joints"], told["motors"]) == (model.nbody - 1, model.njnt, model.nu)
    assert told["mass"] == pytest.approx(model.body_mass.sum())
    assert told["assets"]
    assert all(Path(path).is_file() for path in told["assets"])
    assert {"kind": "gazebo", "name": "base"}.items() <= told["without_counterpart"][-1].items()
    assert run(["convert", str(source), str(out)]) == 2
    assert "--force replaces it" in capsys.readouterr().err
    assert run(["convert", str(source), str(out), "--force", "--no-floor"]) == 0
    text = capsys.readouterr().out
    assert "velocity limit" in text
    assert f"written: {out}" in text


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["cheetah", "out.xml"], "MJCF model already"),
        (["quadruped", "out.urdf"], "give out.xml"),
        (["no.urdf", "out.xml"], "no such file"),
    ],
)
def test_bad_input_leaves_nothing(
    arguments: list[str],
    expected: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(["convert", *arguments]) == 2
    assert expected in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_shown_conversion_is_what_is_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = (Path(__file__).parents[2] / "docs" / "convert.md").read_text("utf-8")
    monkeypatch.chdir(tmp_path)
    assert run(["convert", "quadruped", "quadruped.xml"]) == 0
    assert capsys.readouterr().out == page.split("quadruped.xml\n", 1)[1].split("```", 1)[0]


def test_infinite_inertia_is_refused(tmp_path: Path) -> None:
    path = robot(tmp_path / "r")
    path.write_text(EVERYTHING.replace('izz="0.04"', 'izz="1e400"'))
    with pytest.raises(DescriptionError, match=r"not finite|too large"):
        convert(morphkit.load(path))


def finger(effort: str) -> Description:
    """Three light links on hinges, whose motors can do what `effort` says."""
    inertia = '<inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/>'
    link = f'<link name="{{}}"><inertial><origin xyz="0 0 -0.1"/><mass value="0.1"/>{inertia}</inertial></link>'
    joint = (
        '<joint name="j{0}" type="revolute"><origin xyz="0 0 -0.2"/><parent link="l{0}"/><child link="l{1}"/>'
        f'<axis xyz="0 {{2}} 0.3"/><limit lower="-1" upper="1" effort="{effort}" velocity="1000"/></joint>'
    )
    links = "".join(link.format(f"l{number}") for number in range(4))
    joints = "".join(joint.format(number, number + 1, (-1) ** number) for number in range(3))
    return Description("f", "f.urdf", "urdf", f'<robot name="f">{links}{joints}</robot>'.encode())


@pytest.mark.parametrize(("effort", "slower"), [("3", False), ("1000", True)])
def test_the_time_step_suits_the_efforts(
    effort: str, slower: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    conversion = convert(finger(effort))
    model = conversion.spec.compile()
    assert (model.opt.timestep < 0.004) == slower
    assert any("the time step is" in note for note in conversion.notes) == slower
    assert model.actuator_ctrlrange[:, 1].tolist() == [float(effort)] * 3
    assert all(holds(model, hold) for hold in (0.02, 0.1))
    model.opt.timestep = 0.004
    assert all(holds(model, hold) for hold in (0.02, 0.1)) != slower
    assert not list(tmp_path.iterdir())  # MuJoCo writes a log of its warnings where it works
    assert capfd.readouterr() == ("", "")


def test_efforts_that_no_time_step_resolves_are_named() -> None:
    conversion = convert(finger("1e9"))
    assert any("far too large for its masses" in note for note in conversion.notes)
    assert conversion.spec.option.timestep == 0.004


@pytest.mark.parametrize(("effort", "velocity"), [(87.0, 2.2), (24.0, 30.0), (5.0, 100.0), (300.0, 10.0)])
def test_full_effort_leads_to_the_velocity_limit(effort: float, velocity: float) -> None:
    inertia = '<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>'
    link = f'<link name="{{}}"><inertial><mass value="1"/>{inertia}</inertial></link>'
    limit = f'<limit lower="-1e4" upper="1e4" effort="{effort}" velocity="{velocity}"/>'
    joint = f'<joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>{limit}</joint>'
    text = f'<robot name="r">{link.format("a")}{link.format("b")}{joint}</robot>'
    model = convert(Description("r", "r.urdf", "urdf", text.encode())).spec.compile()
    data = mujoco.MjData(model)
    data.ctrl[0] = effort
    mujoco.mj_step(model, data, nstep=2000)
    reached = min(velocity, effort / 0.1)  # the linear part alone holds a weak motor back
    assert data.qvel[0] == pytest.approx(reached, rel=0.02)


@pytest.mark.parametrize(("effort", "velocity"), [("1e300", "1e-300"), ("inf", "1"), ("1", "inf"), ("nan", "1")])
def test_odd_limits_give_finite_damping(effort: str, velocity: str) -> None:
    robot = finger(effort)
    source = robot.source.replace(b'velocity="1000"', f'velocity="{velocity}"'.encode())
    body = "<body><joint name='j0'/><geom size='1'/></body>"
    spec = mujoco.MjSpec.from_string(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    settle_urdf(spec, replace(robot, source=source))
    assert np.isfinite(spec.joint("j0").damping).all()
    spec.compile()
