from __future__ import annotations

from pathlib import Path

import pytest
from lxml import etree

from morphkit.errors import AssetError, DescriptionError
from morphkit.formats import xml
from morphkit.formats.mjcf_include import flatten_includes
from morphkit.formats.resolve import resolve_asset


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    """A package `bot_description` with a robot in its folder `urdf`, and a secret next to the package."""
    package = tmp_path / "bot_description"
    for path in ("urdf/meshes/near.stl", "meshes/foot.stl", "urdf/other/meshes/in.stl"):
        (package / path).parent.mkdir(parents=True, exist_ok=True)
        (package / path).write_bytes(b"solid")
    (package / "package.xml").write_text("<package/>")
    (tmp_path / "secret.stl").write_bytes(b"solid")
    return package / "urdf"


@pytest.mark.parametrize(
    ("reference", "found"),
    [
        ("meshes/near.stl", "urdf/meshes/near.stl"),
        ("./meshes/near.stl", "urdf/meshes/near.stl"),
        ("meshes\\near.stl", "urdf/meshes/near.stl"),
        (" meshes/near.stl ", "urdf/meshes/near.stl"),
        ("package://bot_description/meshes/foot.stl", "meshes/foot.stl"),
        ("package://other/meshes/in.stl", "urdf/other/meshes/in.stl"),
        ("package://unknown/meshes/near.stl", "urdf/meshes/near.stl"),
        ("model://other/meshes/in.stl", "urdf/other/meshes/in.stl"),
    ],
)
def test_finds(robot: Path, reference: str, found: str) -> None:
    assert resolve_asset(reference, robot) == (robot.parent / found).resolve()


def test_absolute_paths_and_file_urls_inside_the_folder(robot: Path) -> None:
    near = (robot / "meshes/near.stl").resolve()
    assert resolve_asset(str(near), robot) == near
    assert resolve_asset(f"file://{near}", robot) == near


def test_a_named_package_may_lie_elsewhere(robot: Path, tmp_path: Path) -> None:
    reference = "package://elsewhere/secret.stl"
    with pytest.raises(AssetError):
        resolve_asset(reference, robot)
    assert resolve_asset(reference, robot, packages={"elsewhere": tmp_path}) == (tmp_path / "secret.stl").resolve()


@pytest.mark.parametrize(
    "reference",
    [
        "../../secret.stl",
        "meshes/../../../secret.stl",
        "package://bot_description/../secret.stl",
        "link.stl",
        "{secret}",
    ],
)
def test_refuses_what_lies_outside(robot: Path, tmp_path: Path, reference: str) -> None:
    (robot / "link.stl").symlink_to(tmp_path / "secret.stl")
    with pytest.raises(AssetError, match="outside, refused"):
        resolve_asset(reference.format(secret=tmp_path / "secret.stl"), robot)


def test_lists_every_path_tried(robot: Path) -> None:
    with pytest.raises(AssetError) as caught:
        resolve_asset("package://bot_description/meshes/hand.stl", robot)
    tried = str(caught.value).splitlines()[1:]
    expected = [robot.parent / "meshes", robot / "bot_description/meshes", robot / "meshes"]
    assert [line.strip() for line in tried] == [str(folder / "hand.stl") for folder in expected]


@pytest.mark.parametrize("reference", ["", "a\0b", "https://example.org/a.stl"])
def test_refuses_impossible_references(robot: Path, reference: str) -> None:
    with pytest.raises(AssetError):
        resolve_asset(reference, robot)


def flat(source: bytes, folder: Path | None) -> bytes:
    tree = flatten_includes(xml.parse(source, file="main.xml"), folder, file="main.xml")
    return etree.tostring(tree)


def test_includes_are_replaced_in_place(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts/arm.xml").write_bytes(
        b'<mujocoinclude><body name="a"/><!-- c --><include file="hand.xml"/></mujocoinclude>'
    )
    (tmp_path / "parts/hand.xml").write_bytes(b'<mujocoinclude><body name="h"/></mujocoinclude>')
    source = b'<mujoco><worldbody><geom/><include file="parts/arm.xml"/><site/></worldbody></mujoco>'
    expected = b'<mujoco><worldbody><geom/><body name="a"/><!-- c --><body name="h"/><site/></worldbody></mujoco>'
    assert flat(source, tmp_path) == expected


def test_a_file_can_be_included_once(tmp_path: Path) -> None:
    (tmp_path / "loop.xml").write_bytes(b'<mujocoinclude>\n<include file="loop.xml"/></mujocoinclude>')
    with pytest.raises(DescriptionError, match=r"loop\.xml:2: .*included again.*main\.xml:1"):
        flat(b'<mujoco><include file="loop.xml"/></mujoco>', tmp_path)


def test_bad_includes(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "out.xml").write_bytes(b"<mujocoinclude/>")
    (tmp_path / "in/bad.xml").write_bytes(b"<mujocoinclude>\n<")
    with pytest.raises(AssetError, match=r"main\.xml:2: .*gone\.xml"):
        flat(b'<mujoco>\n<include file="gone.xml"/></mujoco>', tmp_path / "in")
    with pytest.raises(AssetError, match="refused"):
        flat(b'<mujoco><include file="../out.xml"/></mujoco>', tmp_path / "in")
    with pytest.raises(DescriptionError, match=r"bad\.xml:2"):
        flat(b'<mujoco><include file="bad.xml"/></mujoco>', tmp_path / "in")
    with pytest.raises(DescriptionError, match="without file"):
        flat(b"<mujoco><include/></mujoco>", tmp_path)
    with pytest.raises(DescriptionError, match="without a folder"):
        flat(b'<mujoco><include file="out.xml"/></mujoco>', None)
