"""Mutated mesh and image files are refused in words, in every format: no traceback, nothing in a log."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from morphkit.conversion.convert import convert
from morphkit.description import Description
from morphkit.errors import AssetError, MorphkitError
from morphkit.simulation.build import compile_plain
from morphkit.simulation.mesh_files import load_mesh
from morphkit.validation.check import check
from tests.support.mutated_shapes import FIELD, FORMATS, IMAGES, URDF, image, mutants, whole


def refused_in_words(action) -> None:
    try:
        action()
    except MorphkitError as error:
        assert str(error)  # noqa: PT017 - any of them will do


def solid(path: Path) -> None:
    mesh = load_mesh(path)
    assert mesh.bounds.shape == (2, 3)


quick = settings(
    max_examples=25, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@pytest.mark.parametrize("kind", FORMATS)
def test_a_whole_shape_is_read(kind: str, tmp_path: Path) -> None:
    path = tmp_path / f"m.{kind}"
    path.write_bytes(whole(kind))
    assert len(load_mesh(path).faces) == 12


@pytest.mark.parametrize("kind", FORMATS)
@quick
@given(data=st.data())
def test_mutated_shapes(kind: str, tmp_path: Path, data: st.DataObject, capfd, caplog) -> None:
    path = tmp_path / f"m.{kind}"
    path.write_bytes(data.draw(mutants(whole(kind))))
    refused_in_words(lambda: solid(path))
    refused_in_words(lambda: convert(Description("r", "r.urdf", "urdf", URDF.format(path.name).encode(), tmp_path)))
    assert "Traceback" not in capfd.readouterr().err
    assert not [record for record in caplog.records if record.name.startswith("trimesh")]


@pytest.mark.parametrize("kind", IMAGES)
@quick
@given(data=st.data())
def test_mutated_images(kind: str, tmp_path: Path, data: st.DataObject) -> None:
    path = tmp_path / f"i.{kind}"
    path.write_bytes(data.draw(mutants(image(kind))))
    for asset, more in (("hfield", 'size="1 1 1 1"'), ("texture", 'type="2d"')):
        source = FIELD.format(asset, more, path.name).encode()
        robot = Description("r", "r.xml", "mjcf", source, tmp_path)
        refused_in_words(lambda robot=robot: compile_plain(robot))


@pytest.mark.parametrize("corners", ["v 0 0\n", "v 0\n", "v\n"])
def test_an_obj_whose_vertices_lack_coordinates(tmp_path: Path, corners: str) -> None:
    (tmp_path / "m.obj").write_text(corners + "f 1 1 1\n")
    with pytest.raises(AssetError, match=r"m\.obj: cannot be read as a mesh|holds no triangles"):
        load_mesh(tmp_path / "m.obj")
    (tmp_path / "r.urdf").write_text(URDF.format("m.obj"))
    assert check(tmp_path / "r.urdf").count("error")


@pytest.mark.parametrize("index", [8, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF])
def test_a_glb_with_a_face_beyond_its_vertices(tmp_path: Path, index: int) -> None:
    content = whole("glb")
    face = struct.pack("<3I", *trimesh.creation.box().faces[0])
    assert content.count(face) == 1
    (tmp_path / "m.glb").write_bytes(content.replace(face, struct.pack("<I", index) + face[4:]))
    with pytest.raises(MorphkitError, match=r"m\.glb: cannot be read as a mesh: a face names a vertex that is not"):
        convert(Description("r", "r.urdf", "urdf", URDF.format("m.glb").encode(), tmp_path))
