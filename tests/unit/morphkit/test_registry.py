"""Finding robots: by name, by path, in folders; and refusing what is none."""

from __future__ import annotations

import hashlib
import json
import math
import os
import subprocess
import sys
from pathlib import Path

import pytest

from morphkit import registry
from morphkit.description import Description
from morphkit.errors import DescriptionError, UnknownNameError
from morphkit.readers import read

MJCF = b'<mujoco><worldbody><body name="torso"/></worldbody></mujoco>\n'
URDF = b'<?xml version="1.0"?>\n<robot name="r"><link name="base"/></robot>\n'
TOML = """
description = "a robot"
license = "MIT"
file = "two legs.xml"
family = "biped"
type_words = [["torso"], ["hip", "thigh"]]
type_matched_in = "joint"
task = "locomotion"
base = "planar"
healthy_height = [0.5, inf]
expert_return = 12
[canonical]
l1 = "left thigh"
[recipes.hopping]
remove = ["l1"]
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "two legs.xml").write_bytes(MJCF)
    (tmp_path / "other.urdf").write_bytes(URDF)
    (tmp_path / "robot.toml").write_text(TOML)
    return tmp_path


def test_shipped_robots_come_by_name_with_their_info() -> None:
    cheetah = registry.load("cheetah")
    assert (cheetah.name, cheetah.file, cheetah.format) == ("cheetah", "cheetah.xml", "mjcf")
    assert (cheetah.info.family, cheetah.info.base) == ("cheetah", "planar")
    assert cheetah.info.type_words == (("torso",), ("thigh",), ("shin",), ("foot",))
    assert cheetah.sha256 == hashlib.sha256(cheetah.source).hexdigest()


def test_shipped_lists_every_robot_once_sorted_and_each_loads_by_its_name_and_file() -> None:
    shipped = registry.shipped()
    names = [description.name for description in shipped]
    assert names == sorted(set(names))
    assert {"cheetah", "walker", "humanoid_2d", "hopper", "quadruped", "planar_cheetah", "arm"} <= set(names)
    for description in shipped:
        assert description.folder is not None
        assert registry.load(description.name) == description
        assert registry.load(description.folder / description.file) == description


def test_the_benchmark_has_thirty_two_bodies() -> None:
    bodies = [name for robot in ("cheetah", "walker", "humanoid_2d", "hopper") for name in registry.recipes(robot)]
    assert len(bodies) == len(set(bodies)) == 32


def test_a_recipe_without_cuts_is_the_full_robot_under_its_name() -> None:
    full = registry.load("cheetah_7_full")
    assert (full.name, full.file) == ("cheetah_7_full", "cheetah_7_full.xml")
    assert full.source == registry.load("cheetah").source
    assert full.info.expert_return == 6716.04


def test_a_recipe_is_cut_from_the_full_robot() -> None:
    hopper = registry.load("hopper_4")
    assert (hopper.name, hopper.file, hopper.info.healthy_height) == ("hopper_4", "hopper_4.xml", (0.6, math.inf))
    assert hopper.info.expert_return == 4687.14
    assert [limb.name for limb in read(hopper).limbs] == ["torso", "thigh", "leg", "foot"]


def test_a_file_takes_the_info_of_the_toml_that_names_it_and_no_other(folder: Path) -> None:
    named = registry.load(folder / "two legs.xml")
    assert (named.name, named.format, named.folder) == ("two legs", "mjcf", folder)
    assert named.info.type_matched_in == "joint"
    assert named.info.healthy_height == (0.5, math.inf)
    assert named.info.canonical == {"l1": "left thigh"}
    other = registry.load(str(folder / "other.urdf"))
    assert (other.name, other.format, other.info.family) == ("other", "urdf", None)


def test_a_folder_with_a_robot_toml_is_a_robot(folder: Path) -> None:
    assert registry.load(folder) == registry.load(folder / "two legs.xml") == registry.load(folder / "robot.toml")
    assert len(registry.load_all(folder)) == 1


def test_a_folder_of_files_gives_them_all_but_not_one(folder: Path) -> None:
    (folder / "robot.toml").unlink()
    (folder / "notes.txt").write_text("no robot")
    assert [found.name for found in registry.load_all(folder)] == ["other", "two legs"]
    with pytest.raises(DescriptionError, match="holds 2 robots where one is expected"):
        registry.load(folder)


def test_the_format_is_told_by_the_root_element_not_by_the_suffix(tmp_path: Path) -> None:
    (tmp_path / "robot.xml").write_bytes(URDF)
    assert registry.load(tmp_path / "robot.xml").format == "urdf"


def test_a_link_to_a_file_is_followed(folder: Path, tmp_path: Path) -> None:
    link = tmp_path / "link.xml"
    link.symlink_to(folder / "two legs.xml")
    assert registry.load(link).name == "link"


def test_the_root_is_passed_on(folder: Path) -> None:
    assert registry.load(folder / "other.urdf", root="base").root == "base"


@pytest.mark.parametrize(
    ("target", "message"),
    [
        ("cheetha", "cheetha: no such robot or file; did you mean 'cheetah'"),
        ("cheetah_3_balancd", "did you mean 'cheetah_3_balanced'"),
        ("x.xml", "x.xml: no such file"),
        ("no/such/robot.urdf", "no/such/robot.urdf: no such file: there is no folder no/such"),
        ("zzzzzzzz", "shipped robots: arm, cheetah, hopper"),
    ],
)
def test_unknown_robots_are_named_with_the_nearest(target: str, message: str) -> None:
    with pytest.raises(UnknownNameError) as error:
        registry.load(target)
    assert message in str(error.value)


def test_a_missing_file_names_the_nearest_beside_it(folder: Path) -> None:
    with pytest.raises(UnknownNameError, match=r"did you mean '.*/other\.urdf'"):
        registry.load(folder / "othre.urdf")


def test_a_path_is_compared_with_what_lies_there_and_never_with_robots(folder: Path) -> None:
    (folder / "cheetahs").mkdir()
    with pytest.raises(UnknownNameError, match=r"did you mean '.*/cheetahs'") as error:
        registry.load(folder / "cheetah")
    with pytest.raises(UnknownNameError) as other:
        registry.load(folder / "walker_2_mian.xml")
    assert "did you mean" not in str(other.value)
    assert "shipped" not in f"{error.value}{other.value}"


def test_recipes_of_an_unknown_robot() -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'walker'"):
        registry.recipes("wakler")


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (b"", "empty"),
        (b"  \n", "empty"),
        (b"robot: no\n", "not well-formed"),
        (b"<robot><link></robot>", "not well-formed"),
        (b"\n<sdf/>", r"bad\.xml:2: root element <sdf>"),
    ],
)
def test_files_that_are_no_robots_are_refused(tmp_path: Path, source: bytes, message: str) -> None:
    (tmp_path / "bad.xml").write_bytes(source)
    with pytest.raises(DescriptionError, match=message):
        registry.load(tmp_path / "bad.xml")


def test_a_path_that_the_system_refuses_is_an_error_of_ours() -> None:
    with pytest.raises(DescriptionError, match="cannot be read: File name too long"):
        registry.load("<mujoco>" * 200)


def test_what_is_no_regular_file_is_refused() -> None:
    with pytest.raises(DescriptionError, match="/dev/null: is no regular file"):
        registry.load("/dev/null")


def test_an_empty_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match=r"holds no robot\.toml, no manifest\.json and no \.urdf or \.xml"):
        registry.load_all(tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("family", "familly", "unknown key 'familly'; did you mean 'family'"),
        ("remove", "removes", r"\[recipes.hopping\]: unknown key 'removes'; did you mean 'remove'"),
        ('file = "two legs.xml"', "", 'the key "file" is missing'),
        ("two legs.xml", "../robot.xml", "file must be a .urdf or .xml file in the folder"),
        ("two legs.xml", "gone.xml", "its file 'gone.xml' does not exist"),
        ('"planar"', '"wheeled"', "base must be one of free, planar, fixed, not 'wheeled'"),
        ("[0.5, inf]", "[2, 1]", "healthy_height must be a pair"),
        ("[0.5, inf]", "[nan, 1]", "healthy_height must be a number"),
        ("= 12", "= true", "expert_return must be a number, not True"),
        ('["torso"]', '["torso"],["a"],["b"],["c"]', "type_words must be at most 4 groups"),
        ('["torso"]', '["thigh"]', "type_words must be groups of distinct words"),
        ('l1 = "left thigh"', 'l1 = "thigh"\nl2 = "Thigh"', "canonical must be plain words that no two limbs share"),
        ('["l1"]', '"l1"', "remove must be a list of names, not 'l1'"),
        ("[canonical]", "[canonical", "cannot be read as TOML"),
    ],
)
def test_a_robot_toml_that_makes_no_sense_is_refused(folder: Path, old: str, new: str, message: str) -> None:
    assert old in TOML
    (folder / "robot.toml").write_text(TOML.replace(old, new, 1))
    with pytest.raises(DescriptionError, match=r"robot\.toml") as error:
        registry.load(folder)
    assert message.replace("\\", "") in str(error.value)


@pytest.mark.skipif(sys.platform == "darwin", reason="its file systems take UTF-8 names only")
def test_a_file_name_in_another_encoding_becomes_a_name_that_can_be_printed(tmp_path: Path) -> None:
    path = Path(os.fsdecode(os.fsencode(tmp_path / "gr") + "ö".encode("latin-1") + b"\xdfe.xml"))
    path.write_bytes(MJCF)
    robot = registry.load(path)
    assert (robot.name, robot.file) == ("gr\ufffd\ufffde", "gr\ufffd\ufffde.xml")
    assert registry.load_all(path)[0].name.encode()


def test_finding_robots_loads_no_heavy_package() -> None:
    code = (
        "import sys, morphkit, morphkit.registry; morphkit.load('quadruped'); "
        "print([m for m in ('mujoco', 'yourdfpy', 'torch', 'transformers', 'trimesh', 'numpy') if m in sys.modules])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


def write_manifest(folder: Path, *files: str) -> None:
    variants = [
        {
            "name": f"variant-{i}",
            "file": file,
            "sha256": hashlib.sha256((folder / file).read_bytes()).hexdigest(),
            "removed": [],
            "spliced": [],
            "limbs": ["torso"],
            "lost": [],
        }
        for i, file in enumerate(files)
    ]
    manifest = {
        "schema_version": 1,
        "tool_version": "0.1.0",
        "source": {"file": "two legs.xml", "sha256": "0" * 64, "format": "mjcf"},
        "family": "biped",
        "task": "locomotion",
        "base": "planar",
        "info": {"type_words": [["torso"]], "type_matched_in": "body", "canonical": {"l1": "left thigh"}},
        "variants": variants,
    }
    (folder / "manifest.json").write_text(json.dumps(manifest))


@pytest.fixture
def family(folder: Path) -> Path:
    (folder / "robot.toml").unlink()
    (folder / "two.xml").write_bytes(MJCF.replace(b"<mujoco>", b'<mujoco model="two">'))
    write_manifest(folder, "two legs.xml", "two.xml")
    return folder


def names(found: list[Description]) -> list[str]:
    return [description.name for description in found]


def test_a_family_gives_its_variants_in_the_order_of_its_manifest(family: Path) -> None:
    found = registry.load_all(family)
    assert names(found) == names(registry.load_all(family / "manifest.json")) == ["variant-0", "variant-1"]
    assert (found[0].info.family, found[0].info.task, found[0].info.base) == ("biped", "locomotion", "planar")
    assert found[0].info.canonical == {"l1": "left thigh"}


def test_a_file_takes_the_info_of_the_manifest_that_lists_it(family: Path) -> None:
    assert registry.load(family / "two.xml") == registry.load_all(family)[1]
    assert registry.load(family / "other.urdf").info.family is None


def test_a_variant_that_was_changed_is_refused(family: Path) -> None:
    (family / "two.xml").write_bytes(MJCF + b"<!-- changed -->")
    with pytest.raises(DescriptionError, match="SHA-256"):
        registry.load_all(family)
    assert registry.load(family / "two.xml").name == "variant-1"
