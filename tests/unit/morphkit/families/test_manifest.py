from __future__ import annotations

import hashlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from morphkit.ablation.ablate import Variant, ablate
from morphkit.description import Description
from morphkit.errors import AblationError, DescriptionError, OutputError
from morphkit.families.enumeration import sub_morphologies
from morphkit.families.manifest import read_manifest
from morphkit.families.write import write_family
from morphkit.registry import load, load_all


def family(limit: int | None = 3) -> tuple[Description, list[Variant]]:
    cheetah = load("cheetah")
    return cheetah, list(sub_morphologies(cheetah, limit=limit))


def content(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_schema(tmp_path):
    cheetah = load("cheetah")
    path = write_family(cheetah, [ablate(cheetah, remove=["ffoot", "bfoot"])], tmp_path / "out")
    data = json.loads(path.read_text())
    assert list(data) == ["schema_version", "tool_version", "source", "family", "task", "base", "info", "variants"]
    assert data["schema_version"] == 1
    assert data["source"] == {"file": "cheetah.xml", "sha256": cheetah.sha256, "format": "mjcf"}
    assert (data["family"], data["task"], data["base"]) == ("cheetah", "cheetah", "planar")
    assert list(data["info"]) == ["type_words", "type_matched_in", "canonical"]
    (variant,) = data["variants"]
    assert list(variant) == ["name", "file", "sha256", "removed", "spliced", "limbs", "lost"]
    assert variant["name"] == "cheetah-no-ffoot-bfoot"
    assert variant["removed"] == ["bfoot", "ffoot"]
    assert variant["sha256"] == hashlib.sha256((path.parent / variant["file"]).read_bytes()).hexdigest()
    assert variant["lost"][2] == {
        "kind": "actuator",
        "name": "bfoot",
        "limb": "bfoot",
        "reason": "refers to joint bfoot",
    }
    assert path.read_bytes().endswith(b"}\n")


def test_a_user_without_a_home_can_replace_a_family(tmp_path, monkeypatch):
    def unknown(_):
        raise KeyError("uid not found")

    monkeypatch.setattr("pwd.getpwuid", unknown)
    monkeypatch.delenv("HOME", raising=False)
    first, second = (write_family(*family(), tmp_path / "out") for _ in range(2))
    assert first == second


def test_same_bytes_twice(tmp_path):
    write_family(*family(), tmp_path / "a")
    write_family(*family(), tmp_path / "b")
    assert content(tmp_path / "a") == content(tmp_path / "b")


def test_round_trip_keeps_what_robot_toml_says(tmp_path):
    walker = load("walker")
    path = write_family(walker, sub_morphologies(walker, limit=2), tmp_path / "deep" / "out")
    manifest = read_manifest(path)
    assert manifest == read_manifest(path.parent)
    assert manifest.info.type_words == walker.info.type_words
    assert manifest.info.healthy_height == walker.info.healthy_height
    assert manifest.info.canonical["left1"]
    loaded = load_all(path)
    assert [description.name for description in loaded] == [variant.name for variant in manifest.variants]
    assert loaded[0].info == manifest.info


def test_infinite_heights_are_null(tmp_path):
    hopper = load("hopper")
    path = write_family(hopper, sub_morphologies(hopper, limit=1), tmp_path / "out")
    assert json.loads(path.read_text())["info"]["healthy_height"] == [0.95, None]
    assert read_manifest(path).info.healthy_height == (0.95, float("inf"))


def test_an_earlier_family_and_an_empty_folder_are_replaced(tmp_path):
    (tmp_path / "out").mkdir()
    cheetah, variants = family()
    write_family(cheetah, variants, tmp_path / "out")
    write_family(cheetah, variants[:1], tmp_path / "out")
    assert sorted(content(tmp_path / "out")) == ["cheetah-no-bfoot.xml", "manifest.json"]
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    assert (tmp_path / "out").stat().st_mode & 0o777 == 0o777 & ~_umask()


def _umask() -> int:
    mask = os.umask(0o022)
    os.umask(mask)
    return mask


@pytest.mark.parametrize("other", ["notes.txt", "sub/notes.txt", "empty_folder/", "manifest.json"])
def test_a_folder_with_other_files_is_left_alone(tmp_path, other):
    out = tmp_path / "out"
    file = out / other
    if other.endswith("/"):
        file.mkdir(parents=True)
    else:
        file.parent.mkdir(parents=True)
        file.write_text("{}")
    with pytest.raises(OutputError, match="out: holds"):
        write_family(*family(), out)
    assert content(out) == ({} if other.endswith("/") else {other: b"{}"})
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_files_beside_a_family_and_edited_variants_are_kept_without_force(tmp_path):
    out = tmp_path / "out"
    write_family(*family(), out)
    (out / "mine.txt").write_text("mine")
    with pytest.raises(OutputError, match=r"holds other files, such as mine\.txt"):
        write_family(*family(), out)
    (out / "mine.txt").unlink()
    (out / "cheetah-no-bfoot.xml").write_text("edited")
    with pytest.raises(OutputError, match="changed after the cut"):
        write_family(*family(), out)
    write_family(*family(), out, force=True)
    assert read_manifest(out).variants


def test_force_never_replaces_the_folder_that_holds_the_robot_or_the_work(tmp_path, monkeypatch):
    cheetah, variants = family(1)
    (tmp_path / "out" / "here").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "out" / "here")
    with pytest.raises(OutputError, match="is or holds the current folder"):
        write_family(cheetah, variants, tmp_path / "out", force=True)
    assert (tmp_path / "out" / "here").is_dir()


def test_a_file_or_link_in_the_way(tmp_path):
    (tmp_path / "out").write_text("x")
    (tmp_path / "link").symlink_to(tmp_path)
    for name in ("out", "link"):
        with pytest.raises(OutputError, match="is no folder"):
            write_family(*family(1), tmp_path / name)
    with pytest.raises(OutputError, match="cannot be written"):
        write_family(*family(1), tmp_path / "out" / "below")


def test_a_failure_halfway_leaves_nothing(tmp_path):
    cheetah, variants = family()

    def broken() -> Iterator[Variant]:
        yield variants[0]
        raise AblationError("halfway")

    with pytest.raises(AblationError, match="halfway"):
        write_family(cheetah, broken(), tmp_path / "new" / "out")
    assert list(tmp_path.iterdir()) == []


def test_two_variants_of_one_name_are_refused(tmp_path):
    cheetah, variants = family(1)
    with pytest.raises(OutputError, match=r"two variants would be written to cheetah-no-bfoot\.xml"):
        write_family(cheetah, variants * 2, tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_a_killed_run_leaves_the_old_folder(tmp_path):
    cheetah, variants = family()
    write_family(cheetah, variants, tmp_path / "out")
    before = content(tmp_path / "out")
    program = f"""
import os, signal
from pathlib import Path
from morphkit.families.enumeration import sub_morphologies
from morphkit.families.write import write_family
from morphkit.registry import load
def variants():
    yield from sub_morphologies(load("cheetah"), limit=1)
    os.kill(os.getpid(), signal.SIGKILL)
write_family(load("cheetah"), variants(), Path({str(tmp_path / "out")!r}))
"""
    killed = subprocess.run([sys.executable, "-c", program], check=False)
    assert killed.returncode == -signal.SIGKILL
    assert content(tmp_path / "out") == before


@pytest.mark.parametrize("exchange", [True, False])
def test_replacing_works_where_names_cannot_be_swapped(tmp_path, monkeypatch, exchange):
    if not exchange:
        monkeypatch.setattr("morphkit.utils.staging._exchange", lambda first, second: False)
    cheetah, variants = family()
    write_family(cheetah, variants[:2], tmp_path / "out")
    write_family(cheetah, variants[2:], tmp_path / "out")
    assert len(read_manifest(tmp_path / "out").variants) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def mesh_robot(folder: Path) -> Description:
    (folder / "meshes").mkdir()
    (folder / "meshes" / "arm.stl").write_bytes(b"solid")
    source = b"""<robot name="r"><link name="base"><visual><geometry><mesh filename="package://r/meshes/arm.stl"/></geometry>
    </visual></link><link name="arm"><visual><geometry><mesh filename="meshes/gone.stl"/></geometry></visual></link>
    <link name="hand"><visual><geometry><mesh filename="meshes/arm.stl"/></geometry></visual></link>
    <joint name="a" type="continuous"><parent link="base"/><child link="arm"/></joint>
    <joint name="h" type="continuous"><parent link="arm"/><child link="hand"/></joint></robot>"""
    (folder / "r.urdf").write_bytes(source)
    return load(folder / "r.urdf")


def test_assets_go_along_and_missing_ones_are_recorded(tmp_path):
    (tmp_path / "r").mkdir()
    robot = mesh_robot(tmp_path / "r")
    variant = ablate(robot, remove=["hand"])
    path = write_family(robot, [variant], tmp_path / "out")
    assert sorted(content(tmp_path / "out")) == ["manifest.json", "r-no-hand.urdf", "r/meshes/arm.stl"]
    manifest = read_manifest(path)
    assert list(manifest.assets) == ["r/meshes/arm.stl"]
    assert [(loss.kind, loss.name) for loss in manifest.variants[0].lost if loss.kind == "asset"] == [
        ("asset", "meshes/gone.stl")
    ]
    write_family(robot, [variant], tmp_path / "out")  # replaces itself, assets and all


def test_mjcf_assets_keep_their_folders(tmp_path):
    (tmp_path / "r" / "m").mkdir(parents=True)
    (tmp_path / "r" / "m" / "a.stl").write_bytes(b"solid")
    (tmp_path / "r" / "t.png").write_bytes(b"png")
    (tmp_path / "r" / "r.xml").write_bytes(
        b"""<mujoco><compiler meshdir="m"/>
        <asset><mesh name="a" file="a.stl"/><texture name="t" type="2d" file="t.png"/>
        </asset><worldbody><body name="b"><geom type="mesh" mesh="a"/><body name="c"><joint/><geom size=".1"/></body>
        </body></worldbody></mujoco>"""
    )
    robot = load(tmp_path / "r" / "r.xml")
    write_family(robot, [ablate(robot, remove=["c"])], tmp_path / "out")
    assert sorted(content(tmp_path / "out")) == ["m/a.stl", "manifest.json", "r-no-c.xml", "t.png"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda data: data.update(schema_version=2), "schema_version is 2, expected 1"),
        (lambda data: data.pop("variants"), "key 'variants' is missing"),
        (lambda data: data["variants"][0].pop("limbs"), "key 'limbs' is missing"),
        (lambda data: data["variants"][0].update(file="../x.xml"), "lies outside"),
        (lambda data: data["variants"][0].update(file="/x.xml"), "lies outside"),
        (lambda data: data["variants"][0].update(file="other.xml"), "is missing"),
        (lambda data: data["variants"][0].update(sha256="0"), "SHA-256 is not the one"),
        (lambda data: data.update(base="flying"), "base is 'flying'"),
        (lambda data: data.update(variants=[3]), "makes no sense"),
        (lambda data: data["info"].update(healthy_height=3), "makes no sense"),
    ],
)
def test_a_manifest_that_cannot_be_right(tmp_path, change, message):
    path = write_family(*family(1), tmp_path / "out")
    data = json.loads(path.read_text())
    change(data)
    path.write_text(json.dumps(data))
    with pytest.raises(DescriptionError, match=message):
        read_manifest(path)


@pytest.mark.parametrize("text", ["", "[1]", "{", "{}"])
def test_a_manifest_that_is_none(tmp_path, text):
    (tmp_path / "manifest.json").write_text(text)
    with pytest.raises(DescriptionError, match=r"manifest\.json"):
        read_manifest(tmp_path)


def test_a_variant_changed_by_hand_loads_alone_with_what_its_manifest_says(tmp_path):
    path = write_family(*family(1), tmp_path / "out")
    file = path.parent / "cheetah-no-bfoot.xml"
    file.write_bytes(file.read_bytes().replace(b"</mujoco>", b"<!-- mine --></mujoco>"))
    assert load(file).info.family == "cheetah"
    with pytest.raises(DescriptionError, match="SHA-256"):
        load_all(path)


def test_the_manifest_of_another_program_is_no_hindrance(tmp_path):
    (tmp_path / "manifest.json").write_text('{"short_name": "web"}')
    (tmp_path / "r.xml").write_bytes(load("cheetah").source)
    assert load(tmp_path / "r.xml").name == "r"


@pytest.mark.parametrize("what", ["folder", "manifest.json", "variant"])
def test_a_family_with_links_is_refused(tmp_path, what):
    source, variants = family()
    folder = tmp_path / "family"
    write_family(source, variants, folder)
    place = {"folder": folder, "variant": folder / variants[0].description.file}.get(what, folder / what)
    place.rename(tmp_path / "moved")
    place.symlink_to(tmp_path / "moved")
    with pytest.raises(DescriptionError, match=f"{place.name}: is a link to"):
        load_all(folder)
    with pytest.raises(OutputError):
        write_family(source, variants, folder)
    assert (tmp_path / "moved").exists()
