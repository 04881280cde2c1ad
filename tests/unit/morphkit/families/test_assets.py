from __future__ import annotations

import hashlib
import shutil
import struct
from dataclasses import replace
from pathlib import Path

import pytest

from morphkit.ablation.ablate import ablate
from morphkit.description import Description
from morphkit.errors import AssetError
from morphkit.families.assets import AssetMode
from morphkit.families.manifest import read_manifest
from morphkit.families.write import write_family
from morphkit.formats.resolve import locate
from morphkit.registry import load, load_all
from morphkit.simulation.build import compile_plain


def stl(size: float) -> bytes:
    """A tetrahedron."""
    corners = [(0, 0, 0), (size, 0, 0), (0, size, 0), (0, 0, size)]
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    triangles = b"".join(
        struct.pack("<12fH", 0, 0, 0, *(value for index in face for value in corners[index]), 0) for face in faces
    )
    return b"\0" * 80 + struct.pack("<I", len(faces)) + triangles


INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'


def package(folder: Path) -> Path:
    """A ROS package whose URDF refers to meshes in every way; returns the file."""
    (folder / "urdf").mkdir(parents=True)
    (folder / "package.xml").write_text("<package/>")
    for number, name in enumerate(("meshes/base.stl", "urdf/near.stl", "meshes/sub/base.stl", "meshes/found.stl")):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(stl(1 + number))
    references = {
        "base": "package://dog/meshes/base.stl",
        "a": "../meshes/base.stl",
        "b": "near.stl",
        "c": "../meshes/sub/base.stl",
        "d": f"file://{folder}/meshes/found.stl",
        "e": "$(find dog)/meshes/found.stl",
        "f": "package://dog/meshes/gone.stl",
        "tail": "near.stl",
    }
    lines = ['<robot name="dog">']
    for link, reference in references.items():
        tag = "visual" if link == "f" else "collision"
        lines.append(
            f'<link name="{link}">{INERTIAL}<{tag}><geometry><mesh filename="{reference}"/></geometry></{tag}></link>'
        )
    for link in list(references)[1:]:
        lines.append(f'<joint name="{link}" type="continuous"><parent link="base"/><child link="{link}"/></joint>')
    file = folder / "urdf" / "dog.urdf"
    file.write_text("\n".join([*lines, "</robot>"]))
    return file


def used(description: Description) -> dict[str, str]:
    """Where every mesh of a URDF is found, by link, and what is in it."""
    from lxml import etree

    found = {}
    for link in etree.fromstring(description.source).iterfind("link"):
        try:
            path = locate(link.find(".//mesh").get("filename"), description)
        except AssetError:
            continue
        found[link.get("name")] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


@pytest.mark.parametrize("assets", ["copy", "reference"])
def test_variants_find_the_meshes_of_their_source(tmp_path: Path, assets: AssetMode):
    robot = load(package(tmp_path / "dog"))
    wanted = used(robot)
    assert set(wanted) == {"base", "a", "b", "c", "d", "e", "tail"}
    write_family(robot, [ablate(robot, remove=["tail"])], tmp_path / "far" / "out", assets=assets)
    (variant,) = load_all(tmp_path / "far" / "out")
    assert used(variant) == {link: digest for link, digest in wanted.items() if link != "tail"}
    assert compile_plain(variant).nmesh >= 4


def test_a_folder_with_copies_can_be_moved(tmp_path: Path):
    robot = load(package(tmp_path / "dog"))
    wanted = used(robot)
    write_family(robot, [ablate(robot, remove=["tail"])], tmp_path / "out")
    (tmp_path / "elsewhere").mkdir()
    shutil.move(tmp_path / "out", tmp_path / "elsewhere" / "moved")
    shutil.rmtree(tmp_path / "dog")
    (variant,) = load_all(tmp_path / "elsewhere" / "moved")
    assert used(variant) == {link: digest for link, digest in wanted.items() if link != "tail"}
    assert str(tmp_path).encode() not in variant.source
    manifest = read_manifest(tmp_path / "elsewhere" / "moved")
    assert sorted(manifest.assets) == [
        "assets/base.stl", "assets/found.stl", "dog/meshes/base.stl", "dog/meshes/found.stl", "near.stl",
    ]  # fmt: skip
    assert variant.source.count(b'"dog/meshes/base.stl"') == 1  # of what is there already no second copy is made
    losses = {loss.name: loss.reason for loss in manifest.variants[0].lost if loss.kind == "asset"}
    assert losses["../meshes/sub/base.stl"] == "is written as assets/base.stl"
    assert losses["package://dog/meshes/gone.stl"].startswith("file 'package://dog/meshes/gone.stl' not found")


def test_references_are_listed_and_nothing_else_outside_may_be_read(tmp_path: Path):
    robot = load(package(tmp_path / "dog"))
    path = write_family(robot, [ablate(robot, remove=["tail"])], tmp_path / "out", assets="reference")
    assert sorted(file.name for file in path.parent.iterdir()) == ["dog-no-tail.urdf", "manifest.json"]
    manifest = read_manifest(path)
    assert manifest.assets == {}
    assert "../dog/meshes/base.stl" in manifest.references
    (variant,) = load_all(path)
    assert locate("../dog/meshes/base.stl", variant) == tmp_path / "dog" / "meshes" / "base.stl"
    with pytest.raises(AssetError, match="outside, refused"):
        locate("../dog/package.xml", variant)
    (tmp_path / "dog" / "meshes" / "base.stl").write_bytes(stl(9))
    with pytest.raises(AssetError, match="outside, refused"):
        locate("../dog/meshes/base.stl", load(path.parent / "dog-no-tail.urdf"))


SCENE = b"""<mujoco>
  <compiler meshdir="../meshes" texturedir="../textures"/>
  <asset>
    <mesh file="part.stl"/>
    <mesh name="other" file="sub/part.stl"/>
    <texture name="t" type="2d" file="wood.png"/>
  </asset>
  <worldbody><body name="b"><geom type="mesh" mesh="part"/><geom type="mesh" mesh="other"/>
    <body name="c"><joint/><geom size=".1"/></body></body></worldbody>
</mujoco>"""


@pytest.mark.parametrize("assets", ["copy", "reference"])
def test_mjcf_asset_folders_beside_the_file(tmp_path: Path, assets: AssetMode):
    home = tmp_path / "robot"
    for name in ("xml", "meshes/sub", "textures"):
        (home / name).mkdir(parents=True)
    (home / "package.xml").write_text("<package/>")
    (home / "xml" / "r.xml").write_bytes(SCENE.replace(b'<texture name="t" type="2d" file="wood.png"/>', b""))
    (home / "meshes" / "part.stl").write_bytes(stl(1))
    (home / "meshes" / "sub" / "part.stl").write_bytes(stl(2))
    robot = load(home / "xml" / "r.xml")
    path = write_family(robot, [ablate(robot, remove=["c"])], tmp_path / "out", assets=assets)
    if assets == "copy":
        assert sorted(read_manifest(path).assets) == ["assets/part.stl", "assets/part_2.stl"]
        shutil.rmtree(home)
    (variant,) = load_all(path)
    model = compile_plain(variant)
    assert [model.mesh(index).name for index in range(model.nmesh)] == ["part", "other"]
    assert b"meshdir" not in variant.source


def test_models_to_attach_bring_their_own_assets(tmp_path: Path):
    home = tmp_path / "robot"
    (home / "arm" / "meshes").mkdir(parents=True)
    (home / "arm" / "meshes" / "hand.stl").write_bytes(stl(1))
    (home / "arm" / "arm.xml").write_bytes(
        b'<mujoco><compiler meshdir="meshes"/><asset><mesh file="hand.stl"/></asset><worldbody><body name="arm">'
        b'<joint/><geom type="mesh" mesh="hand"/></body></worldbody></mujoco>'
    )
    (home / "r.xml").write_bytes(
        b'<mujoco><asset><model name="arm" file="arm/arm.xml"/></asset><worldbody><body name="b"><geom size=".1"/>'
        b'<body name="c"><joint/><geom size=".1"/></body><attach model="arm" body="arm" prefix="l"/></body></worldbody>'
        b"</mujoco>"
    )
    robot = load(home / "r.xml")
    path = write_family(robot, [ablate(robot, remove=["c"])], tmp_path / "out")
    assert sorted(read_manifest(path).assets) == ["arm/arm.xml", "arm/meshes/hand.stl"]


def test_a_copy_never_takes_the_place_of_a_variant_or_of_the_manifest(tmp_path: Path):
    home = tmp_path / "robot"
    home.mkdir()
    (home / "manifest.json").write_bytes(stl(1))
    (home / "Stump.xml").write_bytes(stl(2))
    meshes = "".join(f'<mesh filename="{name}"/>' for name in ("manifest.json", "Stump.xml"))
    (home / "r.urdf").write_text(
        f'<robot name="r"><link name="base"><visual><geometry>{meshes}</geometry></visual></link><link name="arm"/>'
        '<joint name="a" type="continuous"><parent link="base"/><child link="arm"/></joint></robot>'
    )
    robot = load(home / "r.urdf")
    variant = ablate(robot, remove=["arm"], name="stump")
    variant = replace(variant, description=replace(variant.description, file="stump.xml"))
    path = write_family(robot, [variant], tmp_path / "out")
    assert sorted(read_manifest(path).assets) == ["assets/Stump.xml", "assets/manifest.json"]
    assert (path.parent / "assets" / "Stump.xml").read_bytes() == stl(2)
