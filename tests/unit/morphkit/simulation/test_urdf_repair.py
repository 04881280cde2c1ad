"""URDFs with shapes and colors that mean nothing are looked at, simulated and converted all the same."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import pytest
import trimesh

from morphkit.conversion.convert import convert
from morphkit.description import Description
from morphkit.errors import DescriptionError
from morphkit.simulation.build import build_simulation
from morphkit.simulation.inspection_model import load_mechanics
from morphkit.simulation.mesh_files import load_mesh, read_for_mujoco

INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'


def urdf(base: str, rest: str = "") -> Description:
    text = f'<robot name="r"><link name="base">{base}</link>{rest}</robot>'
    return Description("r", "r.urdf", "urdf", text.encode())


def shape(tag: str, text: str, extra: str = "") -> str:
    return f"<{tag}><geometry>{text}</geometry>{extra}</{tag}>"


@pytest.mark.parametrize("tag", ["visual", "collision"])
@pytest.mark.parametrize(
    "empty", ['<box size="0 0 0"/>', '<sphere radius="0.0"/>', '<cylinder radius="0" length="0e0"/>']
)
def test_shapes_without_extent_go(tag: str, empty: str) -> None:
    robot = urdf(INERTIAL + shape("collision", '<sphere radius="0.1"/>') + shape(tag, empty))
    conversion = convert(robot, floor=False)
    assert [geom.type for geom in conversion.spec.geoms] == [mujoco.mjtGeom.mjGEOM_SPHERE]
    assert any(f"{tag} of link 'base' has no extent" in note for note in conversion.notes)
    build_simulation(robot)
    assert any("no extent" in note for note in load_mechanics(robot).notes)


def test_flat_collisions_stay() -> None:
    robot = urdf(INERTIAL + shape("collision", '<box size="1 2 0"/>') + shape("visual", '<box size="1 2 0"/>'))
    (geom,) = convert(robot, floor=False).spec.geoms
    assert geom.size.tolist() == [0.5, 1.0, 5e-7]


@pytest.mark.parametrize("rgba", ["1 0 0", "1 0 0 0 1", "1 0 0 x", "nan 0 0 1", ""])
def test_what_is_no_color_goes(rgba: str) -> None:
    material = f'<material name="m"><color rgba="{rgba}"/></material>'
    robot = urdf(INERTIAL + shape("visual", '<sphere radius="0.1"/>', material))
    conversion = convert(robot)
    assert any("opacity" in note for note in conversion.notes)
    conversion.spec.compile()


def test_colors_stay() -> None:
    material = '<material name="m"><color rgba="1 0.5 0 1"/></material>'
    (geom,) = convert(urdf(INERTIAL + shape("visual", '<sphere radius="0.1"/>', material))).spec.geoms
    assert geom.rgba.tolist() == [1, 0.5, 0, 1]


def test_a_massless_root_that_is_to_move_gets_a_mass() -> None:
    joint = '<joint name="j" type="revolute"><parent link="base"/><child link="leg"/><axis xyz="1 0 0"/>'
    limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
    ball = shape("collision", '<sphere radius="0.1"/>')
    robot = urdf("", f'<link name="leg">{INERTIAL}{ball}</link>{joint}{limit}')
    assert not any("0.001 kg" in note for note in convert(robot).notes)
    for base in ("free", "planar"):
        conversion = convert(robot, base=base)  # type: ignore[arg-type]
        assert any("'base' moves and has no mass" in note for note in conversion.notes)


@pytest.mark.parametrize("broken", ['<cone radius="1"/>', '<box size="nan 1 1"/>', '<sphere radius="x"/>', ""])
def test_visuals_that_are_none_go(broken: str) -> None:
    robot = urdf(INERTIAL + shape("collision", '<sphere radius="0.1"/>') + shape("visual", broken))
    assert len(convert(robot, floor=False).spec.geoms) == 1
    with pytest.raises(DescriptionError):  # what things touch is not left out
        convert(urdf(INERTIAL + shape("collision", broken)))


@pytest.mark.parametrize(("scale", "expected"), [("2", [2, 2, 2]), ("-2 2 2", [-2, 2, 2]), ("0 2 2", [1e-6, 2, 2])])
def test_scales_of_meshes(tmp_path: Path, scale: str, expected: list[float]) -> None:
    trimesh.creation.box((0.1, 0.1, 0.1)).export(tmp_path / "m.stl")
    robot = urdf(INERTIAL + shape("collision", f'<mesh filename="m.stl" scale="{scale}"/>'))
    (mesh,) = convert(replace(robot, folder=tmp_path), floor=False).spec.meshes
    assert mesh.scale.tolist() == expected


def two(dynamics: str, mass: str = "1", effort: str = "1") -> Description:
    legs = INERTIAL.replace('"1"', f'"{mass}"', 1)
    limit = f'<limit lower="-1" upper="1" effort="{effort}" velocity="0"/>'
    joint = '<joint name="j" type="revolute"><parent link="base"/><child link="leg"/><axis xyz="1 0 0"/>'
    return urdf(INERTIAL, f'<link name="leg">{legs}</link>{joint}{limit}{dynamics}</joint>')


def test_a_joint_that_mimics_itself_moves_by_itself() -> None:
    spec = convert(two('<mimic joint="j"/>')).spec
    assert not spec.equalities
    assert len(spec.joints) == 1


def test_negative_damping_counts_as_none() -> None:
    conversion = convert(two('<dynamics damping="-1" friction="-2"/>'))
    model = conversion.spec.compile()
    assert model.dof_damping.tolist() == [0.1]
    assert model.dof_frictionloss.tolist() == [0]
    assert sum("is negative" in note for note in conversion.notes) == 2


def test_masses_too_light_to_move_count_as_none() -> None:
    conversion = convert(two("", mass="1e-14"))
    assert any("'leg' has mass 1e-14 kg" in note for note in conversion.notes)
    assert conversion.spec.body("leg").mass == 1e-3


def test_an_infinite_effort_leaves_no_infinite_range() -> None:
    assert "inf" not in convert(two("", effort="inf")).spec.to_xml()


def test_stl_with_more_than_its_triangles(tmp_path: Path) -> None:
    content = trimesh.creation.box((1, 2, 3)).export(file_type="stl")
    (tmp_path / "m.stl").write_bytes(content + b"made by a program that says so")
    assert read_for_mujoco(tmp_path / "m.stl") == ("m.stl", content)
    assert load_mesh(tmp_path / "m.stl").extents.tolist() == [1, 2, 3]
    text = trimesh.creation.box((1, 2, 3)).export(file_type="stl_ascii")
    (tmp_path / "t.stl").write_text(text)
    assert load_mesh(tmp_path / "t.stl").extents.tolist() == [1, 2, 3]


@pytest.mark.parametrize(
    ("rest", "reason"),
    [("<xacro:arm/>", "<xacro:arm> stands for elements that are missing"), ("", "xacro macro may stand for the rest")],
)
def test_macros_that_were_not_expanded_are_refused(rest: str, reason: str) -> None:
    text = f'<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"><link name="world"/>{rest}</robot>'
    with pytest.raises(DescriptionError, match=reason):
        convert(Description("r", "r.urdf", "urdf", text.encode()))
