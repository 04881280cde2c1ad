"""URDF into MJCF: kinematics, masses, joints and meshes are those of the URDF."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
import yourdfpy

import morphkit
from morphkit.conversion.convert import Conversion, convert
from morphkit.conversion.write import write_conversion
from morphkit.errors import AssetError
from morphkit.simulation.build import build_simulation
from morphkit.simulation.mesh_files import load_mesh
from tests.support.everything_urdf import EVERYTHING


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


def test_kinematics_are_those_of_the_urdf(everything: Path, converted: tuple[Conversion, Path]) -> None:
    assert_same_kinematics(everything, mujoco.MjModel.from_xml_path(str(converted[1])))


@pytest.mark.parametrize(
    ("name", "base"), [("quadruped", "free"), ("quadruped", "fixed"), ("planar_cheetah", "planar")]
)
def test_kinematics_of_shipped_robots(tmp_path: Path, name: str, base: str) -> None:
    write_conversion(convert(morphkit.load(name), base=base), tmp_path / "out.xml")  # type: ignore[arg-type]
    assert_same_kinematics(shipped(name), mujoco.MjModel.from_xml_path(str(tmp_path / "out.xml")))


def test_masses_and_inertias_are_those_of_the_urdf(everything: Path, converted: tuple[Conversion, Path]) -> None:
    model = mujoco.MjModel.from_xml_path(str(converted[1]))
    changed = {"axis", "wheel", "finger"}  # no mass, and impossible inertias
    for link in yourdfpy.URDF.load(everything, load_meshes=False).robot.links:
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
    # In file order: the .dae in millimeters and twice as large, the .stl, the .stl in text.
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


def test_converted_robot_simulates_like_the_urdf(tmp_path: Path) -> None:
    write_conversion(convert(morphkit.load("quadruped"), base="free"), tmp_path / "quadruped.xml")
    sources = (tmp_path / "quadruped.xml", "quadruped")
    ours, theirs = (build_simulation(morphkit.load(each), actuation="as-file") for each in sources)
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
