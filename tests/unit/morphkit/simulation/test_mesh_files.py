"""COLLADA as ROS reads it: the unit counts, the up axis does not; the same for looking, converting and checking."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh

import morphkit
from morphkit.conversion.convert import convert
from morphkit.conversion.write import write_conversion
from morphkit.errors import AssetError
from morphkit.simulation import mesh_files
from morphkit.simulation.collada import up_axis
from morphkit.simulation.inspection_model import load_mechanics
from morphkit.simulation.mesh_files import load_mesh
from morphkit.validation import sandbox
from morphkit.validation.check import check

# A tetrahedron whose corners are at 0, 1 x, 2 y and 3 z, moved along y by its node.
COLLADA = """<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
  <asset><created>2020-01-01T00:00:00</created><modified>2020-01-01T00:00:00</modified>{unit}{up}</asset>
  <library_geometries><geometry id="g"><mesh>
    <source id="p"><float_array id="a" count="12">0 0 0 1 0 0 0 2 0 0 0 3</float_array>
      <technique_common><accessor source="#a" count="4" stride="3">
        <param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>
      </accessor></technique_common></source>
    <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
    <triangles count="4"><input semantic="VERTEX" source="#v" offset="0"/>
      <p>0 2 1 0 1 3 0 3 2 1 2 3</p></triangles>
  </mesh></geometry></library_geometries>
  <library_visual_scenes><visual_scene id="s"><node id="n"><translate>0 5 0</translate>
    <instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
  <scene><instance_visual_scene url="#s"/></scene>
</COLLADA>
"""
CORNERS = np.array([[0.0, 5.0, 0.0], [1.0, 7.0, 3.0]])  # lowest and highest, in the unit of the file
ROBOT = """<robot name="r">
  <link name="base"><inertial><mass value="{mass}"/>
    <inertia ixx="0.0001" iyy="0.0001" izz="0.0001" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><mesh filename="part.dae"/></geometry></visual>
    <collision><geometry><mesh filename="part.dae"/></geometry></collision></link>
</robot>
"""


def collada(folder: Path, *, up: str | None, unit: str | None = "0.01") -> Path:
    path = folder / "part.dae"
    path.write_text(
        COLLADA.format(
            up="" if up is None else f"<up_axis>{up}_UP</up_axis>",
            unit="" if unit is None else f'<unit name="own" meter="{unit}"/>',
        )
    )
    return path


@pytest.mark.parametrize("up", ["X", "Y", "Z", None])
@pytest.mark.parametrize("unit", ["0.01", "1", None])
def test_unit_counts_and_up_axis_does_not(tmp_path: Path, up: str | None, unit: str | None) -> None:
    path = collada(tmp_path, up=up, unit=unit)
    np.testing.assert_allclose(load_mesh(path).bounds, CORNERS * float(unit or 1), atol=1e-9)
    assert up_axis(path) == up


@pytest.mark.parametrize("unit", ["0", "-1", "nan", "inf"])
def test_impossible_units(tmp_path: Path, unit: str) -> None:
    with pytest.raises(AssetError, match="states a unit"):
        load_mesh(collada(tmp_path, up="Y", unit=unit))


@pytest.mark.parametrize("up", ["Y", "Z"])
def test_what_is_shown_and_converted_stands_as_in_the_file(tmp_path: Path, up: str) -> None:
    collada(tmp_path, up=up)
    (tmp_path / "r.urdf").write_text(ROBOT.format(mass=1))
    robot = morphkit.load(tmp_path / "r.urdf")

    model = load_mechanics(robot).model
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    assert model.nmesh == 1
    for geom in np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_MESH):
        corners = model.mesh_vert[: model.mesh_vertnum[0]] @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
        np.testing.assert_allclose([corners.min(axis=0), corners.max(axis=0)], CORNERS / 100, atol=1e-6)

    _, mesh, *_ = write_conversion(convert(robot), tmp_path / "out.xml")
    np.testing.assert_allclose(trimesh.load(mesh, force="mesh").bounds, CORNERS / 100, atol=1e-6)


def test_masses_are_compared_with_shapes_in_meters(tmp_path: Path) -> None:
    # A volume of 1 in centimeters: 1 g there is as dense as water, 1 kg is not.
    collada(tmp_path, up="Y")
    found = {}
    for mass in (0.001, 1):
        (tmp_path / "r.urdf").write_text(ROBOT.format(mass=mass))
        found[mass] = {each.rule for each in check(tmp_path / "r.urdf").findings}
    assert "mass-density" in found[1] - found[0.001]


@pytest.mark.parametrize(("up", "lines"), [("Y", [4]), ("X", [4]), ("Z", []), (None, [])])
def test_an_up_axis_that_some_tools_follow_is_reported_once(tmp_path: Path, up: str | None, lines: list[int]) -> None:
    collada(tmp_path, up=up)
    (tmp_path / "r.urdf").write_text(ROBOT.format(mass=0.001))
    found = [each for each in check(tmp_path / "r.urdf").findings if each.rule == "mesh-up-axis"]
    assert [each.line for each in found] == lines
    assert all(each.severity == "info" and "part.dae" in each.message for each in found)


def test_check_and_the_loader_have_one_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "large.stl").write_bytes(b"x" * 300)
    monkeypatch.setattr(mesh_files, "MESH_BYTES", 200)
    with pytest.raises(AssetError, match="more than the limit"):
        mesh_files.read_for_mujoco(tmp_path / "large.stl")
    with pytest.raises(AssetError, match="more than the limit"):
        sandbox._measure(tmp_path / "large.stl")


def test_an_stl_of_too_many_triangles_is_refused_at_its_head(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    loose = tmp_path / "loose.stl"
    trimesh.creation.icosphere(subdivisions=1).export(loose)  # 80 triangles
    assert len(load_mesh(loose, merged=False).vertices) == 240
    assert len(load_mesh(loose).vertices) == 42
    monkeypatch.setattr(mesh_files, "STL_FACES", 79)
    monkeypatch.setattr(trimesh, "load", None)  # not a triangle is read
    for use in (mesh_files.read_for_mujoco, sandbox._measure):
        with pytest.raises(AssetError, match="80 triangles, more than the limit of 79"):
            use(loose)
    (tmp_path / "text.stl").write_bytes(b"solid " + b"x" * 80 + b" facet normal 0 0 1" + b" " * 4000)
    assert mesh_files._stated_faces(tmp_path / "text.stl") == 0
