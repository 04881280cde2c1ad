from __future__ import annotations

import sys
import threading
from pathlib import Path

import pytest

from morphkit.errors import AssetError, ConfigError, DependencyError, DescriptionError, UnknownNameError
from morphkit.formats import xacro
from morphkit.formats.packages import parse_packages, split_reference
from morphkit.formats.resolve import resolve_asset
from morphkit.formats.xacro import parse_arguments
from morphkit.readers import read
from morphkit.registry import load
from morphkit_cli.main import run

XACRO = """<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:property name="size" value="0.3"/>
<link name="base"><visual><geometry><mesh filename="file://$(find {package})/m.stl"/></geometry></visual></link>
<xacro:macro name="leg" params="n"><link name="leg_${{n}}"/>
<joint name="j${{n}}" type="continuous">
<parent link="base"/><child link="leg_${{n}}"/><origin xyz="${{{x}}} 0 0"/></joint>
</xacro:macro>
<xacro:leg n="1"/><xacro:leg n="2"/>
</robot>"""


def package(folder: Path, *files: str, marked: bool = True) -> Path:
    folder.mkdir(parents=True)
    for file in files:
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).write_bytes(b"solid")
    if marked:
        (folder / "package.xml").write_text("<package/>")
    return folder


@pytest.mark.parametrize(
    ("reference", "expected"),
    [
        ("package://a_b/meshes/m.stl", ("a_b", "meshes/m.stl")),
        ("package:///a_b/m.stl", ("a_b", "m.stl")),
        ("model://a-b/m.stl", ("a-b", "m.stl")),
        ("file://$(find a_b)/m.stl", ("a_b", "m.stl")),
        ("$(find-pkg-share a_b)/m.stl", ("a_b", "m.stl")),
        ("meshes/m.stl", None),
        ("file:///m.stl", None),
    ],
)
def test_what_names_a_package(reference: str, expected: tuple[str, str] | None) -> None:
    assert split_reference(reference) == expected


def test_order_of_the_folders_tried(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each place is taken only where those before it lack the file."""
    robot = package(tmp_path / "ws/bot/urdf")
    beside = package(tmp_path / "ws/arm", "m.stl")
    ament = package(tmp_path / "install/share/arm", "m.stl").parents[1]
    nested = package(tmp_path / "ros/meta/arm", "m.stl").parents[1]
    named = package(tmp_path / "mine", "m.stl")
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"{tmp_path / 'nowhere'}:{nested}")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(ament))
    places = [named, nested / "meta/arm", ament / "share/arm", beside]
    for place in places:
        assert resolve_asset("package://arm/m.stl", robot, packages={"arm": named}) == place / "m.stl"
        (place / "m.stl").unlink()
    with pytest.raises(AssetError, match="--package arm=DIR") as caught:
        resolve_asset("package://arm/m.stl", robot, packages={"arm": named})
    tried = [line.strip() for line in str(caught.value).splitlines()[1:]]
    expected = [named, tmp_path / "nowhere/arm", nested / "arm", *places[1:], robot / "arm", robot]
    assert tried == [str(place / "m.stl") for place in expected]


def test_a_robot_may_use_all_of_its_own_package(tmp_path: Path) -> None:
    bot = package(tmp_path / "bot", "meshes/m.stl", "urdf/x.urdf")
    assert resolve_asset("../meshes/m.stl", bot / "urdf") == bot / "meshes/m.stl"


def test_only_meshes_and_images_are_read_from_folders_around_the_robot(tmp_path: Path) -> None:
    robot = package(tmp_path / "ws/bot")
    package(tmp_path / "ws/near", "m.stl", "secret", marked=False)
    assert resolve_asset("package://near/m.stl", robot).name == "m.stl"
    with pytest.raises(AssetError, match="outside, refused"):
        resolve_asset("package://near/secret", robot)


def test_links_may_lead_out_of_named_packages_only(tmp_path: Path) -> None:
    robot = package(tmp_path / "bot")
    target = package(tmp_path / "src", "m.stl") / "m.stl"
    built = package(tmp_path / "install")
    for folder in (robot, built):
        (folder / "m.stl").symlink_to(target)
    assert resolve_asset("package://b/m.stl", robot, packages={"b": built}) == target
    with pytest.raises(AssetError, match="outside, refused"):
        resolve_asset("m.stl", robot)


@pytest.mark.parametrize("reference", ["x" * 5000, "ring", "package://../m.stl", "package:///", "a/\x01/b"])
def test_odd_references_are_asset_errors(tmp_path: Path, reference: str) -> None:
    (tmp_path / "ring").symlink_to(tmp_path / "ring")
    with pytest.raises(AssetError, match="not found"):
        resolve_asset(reference, tmp_path)


@pytest.mark.parametrize("option", ["bot", "=here", "bot=", "bot=/nowhere/at/all", "bot=~nobody-of-that-name"])
def test_bad_package_options(option: str) -> None:
    with pytest.raises(ConfigError, match="--package"):
        parse_packages([option])


def test_xacro_is_expanded(tmp_path: Path) -> None:
    pytest.importorskip("xacro")
    (tmp_path / "r.urdf.xacro").write_text(XACRO.format(package="bot", x="2 * size"))
    bot = package(tmp_path / "elsewhere", "m.stl")
    robot = load(tmp_path / "r.urdf.xacro", packages={"bot": bot})
    assert (robot.name, robot.file, robot.format) == ("r", "r.urdf", "urdf")
    assert [limb.name for limb in read(robot).limbs] == ["base", "leg_1", "leg_2"]
    assert b'xyz="0.6 0 0"' in robot.source
    assert f"file://{bot}/m.stl".encode() in robot.source


ARGUMENTS = """<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:arg name="prefix" default="a_"/><xacro:include filename="more.xacro"/>
<link name="$(arg prefix)base_$(arg end)"/></robot>
"""


def test_macros_that_were_not_expanded_are_refused(tmp_path: Path) -> None:
    (tmp_path / "r.urdf").write_text(XACRO.format(package="bot", x="1"))
    with pytest.raises(DescriptionError, match=r"r\.urdf:\d+: <xacro:leg> stands for elements that are missing"):
        read(load(tmp_path / "r.urdf"))


def test_xacro_files_are_limited_in_size(tmp_path: Path) -> None:
    pytest.importorskip("xacro")
    with (tmp_path / "r.xacro").open("wb") as file:
        file.truncate(65 * 2**20)
    with pytest.raises(DescriptionError, match="65 MiB of XML, more than the limit"):
        load(tmp_path / "r.xacro")


def test_xacro_arguments(tmp_path: Path) -> None:
    pytest.importorskip("xacro")
    (tmp_path / "r.xacro").write_text(ARGUMENTS)
    more = '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arg name="end" default=""/></robot>'
    (tmp_path / "more.xacro").write_text(more)
    arguments = parse_arguments(["prefix:=left:=", "end:="])
    assert read(load(tmp_path / "r.xacro", xacro_args=arguments)).root.name == "left:=base_"
    with pytest.raises(UnknownNameError, match="no argument 'prefx'; did you mean 'prefix'") as caught:
        load(tmp_path / "r.xacro", xacro_args={"prefx": "b_", "end": "c"})
    assert str(caught.value).endswith("(its arguments: prefix (default 'a_'), end (default ''))")


def test_only_xacro_files_have_arguments(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="expected NAME:=VALUE"):
        parse_arguments(["prefix=b"])
    with pytest.raises(ConfigError, match=r"cheetah: is no \.xacro file"):
        load("cheetah", xacro_args={"a": "b"})


def test_commands_take_xacro_arguments(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("xacro")
    (tmp_path / "r.xacro").write_text(ARGUMENTS.replace('<xacro:include filename="more.xacro"/>', ""))
    file, argument = str(tmp_path / "r.xacro"), "--xacro-arg=end:=7"
    assert run(["tokens", file, argument]) == 2
    assert "has no argument 'end' (its arguments: prefix" in capsys.readouterr().err
    declared = ARGUMENTS.replace('<xacro:include filename="more.xacro"/>', '<xacro:arg name="end" default=""/>')
    (tmp_path / "r.xacro").write_text(declared)
    assert run(["check", file, "--quick", argument]) == 0
    assert run(["show", file, argument]) == 0
    assert "a_base_7" in capsys.readouterr().out
    assert run(["show", "cheetah", argument]) == 2
    assert "--xacro-arg is for .xacro files; cheetah is none" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (XACRO.format(package="bot", x="1"), "package 'bot' not found; say where it is with --package bot=DIR"),
        (XACRO.format(package="bot", x="unknown").replace("$(find bot)", ""), "name 'unknown' is not defined"),
        ("<robot", "unclosed token"),
        ('<!DOCTYPE r [<!ENTITY a "b">]><robot/>', "declarations are refused"),
    ],
)
def test_xacro_that_cannot_be_expanded(tmp_path: Path, text: str, reason: str) -> None:
    pytest.importorskip("xacro")
    (tmp_path / "r.xacro").write_text(text)
    with pytest.raises(DescriptionError, match=r"r\.xacro: cannot be expanded") as caught:
        load(tmp_path / "r.xacro")
    assert reason in str(caught.value)


@pytest.mark.parametrize("by", ["the clock", "its processor time"])
def test_xacro_is_stopped(by: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("xacro")
    monkeypatch.setattr(xacro, "LIMIT_S", 1)
    if by != "the clock":
        timer = threading.Timer
        monkeypatch.setattr(xacro.threading, "Timer", lambda seconds, stop: timer(60 * seconds, stop))
    (tmp_path / "r.xacro").write_text(XACRO.format(package="bot", x="9 ** 9 ** 9").replace("$(find bot)", ""))
    with pytest.raises(DescriptionError, match="more than 1 s"):
        load(tmp_path / "r.xacro")


def test_xacro_without_its_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xacro", None)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    (tmp_path / "r.xacro").write_text("<robot/>")
    with pytest.raises(DependencyError, match=r"morphkit\[xacro\]"):
        load(tmp_path / "r.xacro")
