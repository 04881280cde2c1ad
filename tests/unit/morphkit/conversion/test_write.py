"""Conversions into folders of strangers."""

from __future__ import annotations

import json
from pathlib import Path

import mujoco
import pytest
from lxml import etree

from morphkit.conversion.convert import convert
from morphkit.conversion.write import convert_to, write_conversion
from morphkit.errors import DescriptionError, OutputError
from morphkit.registry import load
from tests.support.heavy_robots import doubling_dae, urdf_with_mesh
from tests.support.small_robots import arm


@pytest.mark.parametrize("link", [False, True])
def test_what_a_killed_conversion_is_said_to_have_placed_is_removed_only_if_it_is_of_its_making(
    tmp_path: Path, link: bool
) -> None:
    mine = tmp_path / "mine"
    mine.write_text("mine")
    folder = tmp_path / "received"
    stage = folder / ".robot.xml-abc.morphkit"
    stage.mkdir(parents=True)
    (folder / "robot_assets").mkdir()
    names = ["../../mine", str(mine), "notes", "..", 5, None, ["a"], "part-01234567.obj"]
    for name in ("notes", "part-01234567.obj"):
        (folder / "robot_assets" / name).write_text("mine")
    (stage / "lock").write_text("morphkit writes robot.xml")
    placed = tmp_path / "placed" if link else stage / "placed"
    placed.write_text(json.dumps(names))
    if link:
        (stage / "placed").symlink_to(placed)
    write_conversion(convert(arm()), folder / "robot.xml", force=True)
    assert mine.read_text() == "mine"
    assert not stage.exists()
    (folder / "robot.xml").unlink()


def test_a_list_of_placed_files_that_makes_no_sense_is_passed_over(tmp_path: Path) -> None:
    stage = tmp_path / ".robot.xml-abc.morphkit"
    for text in ("{", "[" * 5000, "\xff", "5", "{}"):
        stage.mkdir()
        (tmp_path / "robot_assets").mkdir(exist_ok=True)
        (stage / "lock").write_text("morphkit writes robot.xml")
        (stage / "placed").write_bytes(text.encode("latin-1"))
        write_conversion(convert(arm()), tmp_path / "robot.xml", force=True)
        assert not stage.exists()


def test_robots_with_costly_meshes_are_converted_within_limits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "r.urdf").write_text(urdf_with_mesh("m.dae"))
    (tmp_path / "m.dae").write_text(doubling_dae(2))
    robot = load(tmp_path / "r.urdf")
    report, (model, *meshes) = convert_to(tmp_path / "r.xml", robot, base="free")
    assert (report.bodies, report.joints, report.base) == (2, 2, "free")
    assert mujoco.MjModel.from_xml_path(str(model)).nmesh == len(meshes) == 1
    with pytest.raises(OutputError, match="exists"):
        convert_to(tmp_path / "r.xml", robot)
    (tmp_path / "m.dae").write_text(doubling_dae(10, faces=4000))
    monkeypatch.setenv("MORPHKIT_LIMITS", "0.001")
    with pytest.raises(DescriptionError, match=r"r\.urdf: cannot be used: .* MORPHKIT_LIMITS=10"):
        convert_to(tmp_path / "other.xml", robot)
    assert not (tmp_path / "other.xml").exists()


def test_control_characters_of_a_file_name_are_written_out(tmp_path: Path) -> None:
    (tmp_path / "a\b--.urdf").write_text('<robot name="r"><link name="a"/></robot>')
    convert_to(tmp_path / "out.xml", load(tmp_path / "a\b--.urdf"))
    assert etree.parse(tmp_path / "out.xml").getroot().get("model") == r"a\x08--"
