"""Models that a model attaches: their files start in their own folders, as in MuJoCo."""

from __future__ import annotations

from pathlib import Path

import mujoco
import pytest

from morphkit.ablation.ablate import ablate
from morphkit.errors import AssetError
from morphkit.families.manifest import read_manifest
from morphkit.families.write import write_family
from morphkit.readers import read
from morphkit.registry import load, load_all
from morphkit.simulation.build import compile_plain
from morphkit.validation.check import check

PARENT = """<mujoco><compiler meshdir="parent"/>
<asset><mesh name="box" file="box.stl"/><model name="arm" file="arms/arm.xml"/></asset>
<worldbody><body name="base"><geom type="mesh" mesh="box"/>
<body name="tail"><joint name="wag"/><geom size=".1"/></body>
<attach model="arm" body="arm" prefix="l_"/></body></worldbody></mujoco>
"""
ARM = """<mujoco><compiler meshdir="meshes" texturedir="pictures"/>
<include file="parts.xml"/>
<asset><model name="hand" file="hands/hand.xml"/><texture name="t" type="2d" file="t.png"/>
<hfield name="h" file="h.png" size="1 1 1 1"/></asset>
<worldbody><body name="arm"><joint name="lift"/><geom type="mesh" mesh="box"/>
<attach model="hand" body="hand" prefix="h_"/></body></worldbody></mujoco>
"""
PARTS = '<mujocoinclude><asset><mesh name="box" file="box.stl"/></asset></mujocoinclude>'
HAND = """<mujoco><compiler meshdir="../../common"/><asset><mesh name="box" file="box.stl"/></asset>
<worldbody><body name="hand"><joint name="turn"/><geom type="mesh" mesh="box"/></body></worldbody></mujoco>
"""
SIZES = {"parent/box.stl": 1.0, "arms/meshes/box.stl": 0.5, "common/box.stl": 0.25, "box.stl": 2.0}


@pytest.fixture
def robot(tmp_path: Path, make_box) -> Path:
    home = tmp_path / "robot"
    texts = {"r.xml": PARENT, "arms/arm.xml": ARM, "arms/parts.xml": PARTS, "arms/hands/hand.xml": HAND}
    for name, text in texts.items():
        (home / name).parent.mkdir(parents=True, exist_ok=True)
        (home / name).write_text(text)
    for name, size in SIZES.items():
        make_box(home / name, size)
    make_picture(home / "arms/pictures/t.png")
    make_picture(home / "arms/meshes/h.png")
    return home


@pytest.fixture
def make_box():
    import trimesh

    def make(path: Path, size: float) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        trimesh.creation.box((size, size, size)).export(path)

    return make


def make_picture(path: Path) -> None:
    from PIL import Image

    path.parent.mkdir(parents=True, exist_ok=True)
    picture = Image.new("L", (8, 8))
    picture.putpixel((1, 1), 255)
    picture.save(path)


def masses(model: mujoco.MjModel) -> dict[str, float]:
    return {model.body(i).name: round(float(model.body_mass[i]), 6) for i in range(1, model.nbody)}


def test_files_of_attached_models_are_those_that_mujoco_finds(robot: Path) -> None:
    description = load(robot / "r.xml")
    assert [limb.name for limb in read(description).limbs] == ["base", "tail", "l_arm", "l_h_hand"]
    plain = mujoco.MjModel.from_xml_path(str(robot / "r.xml"))
    assert masses(compile_plain(description)) == masses(plain)
    assert masses(plain)["l_h_hand"] == 1000 * 0.25**3
    assert check(robot / "r.xml").count("error") == 0


@pytest.mark.parametrize("assets", ["copy", "reference"])
@pytest.mark.parametrize(
    ("remove", "left"), [("tail", ["base", "l_arm", "l_h_hand"]), ("l_h_hand", ["base", "tail", "l_arm"])]
)
def test_variants_find_the_files_of_attached_models(robot: Path, tmp_path: Path, assets, remove: str, left) -> None:
    plain = masses(mujoco.MjModel.from_xml_path(str(robot / "r.xml")))
    description = load(robot / "r.xml")
    variant = ablate(description, remove=[remove])
    assert str(robot).encode() not in variant.description.source
    path = write_family(description, [variant], tmp_path / "out", assets=assets)
    if assets == "copy":
        path = (tmp_path / "out").rename(tmp_path / "moved") / path.name
        robot.rename(tmp_path / "gone")
    assert not [
        loss for loss in read_manifest(path).variants[0].lost if loss.kind == "asset" and "written" not in loss.reason
    ]
    (loaded,) = load_all(path)
    assert masses(compile_plain(loaded)) == {name: plain[name] for name in left}


def test_missing_files_of_attached_models_are_named(robot: Path) -> None:
    (robot / "arms/meshes/box.stl").unlink()
    assert len(read(load(robot / "r.xml")).limbs) == 4
    (finding,) = [each for each in check(robot / "r.xml", deep=False).findings if each.rule == "mesh-missing"]
    assert "model 'arm'" in finding.message
    assert "arms/meshes/box.stl" in finding.message
    assert finding.line == 2
    with pytest.raises(AssetError, match=r"box\.stl' is needed in simulation"):
        compile_plain(load(robot / "r.xml"))
    (robot / "arms/parts.xml").unlink()
    assert [each.rule for each in check(robot / "r.xml", deep=False).findings if each.severity == "error"] == [
        "include-missing"
    ]


def test_files_of_attached_models_stay_inside(robot: Path, make_box) -> None:
    """What MuJoCo would read from anywhere, a file from a stranger may not."""
    make_box(robot.parent / "outside.stl", 1.0)
    (robot / "arms/hands/hand.xml").write_text(HAND.replace("box.stl", "../../outside.stl"))
    mujoco.MjModel.from_xml_path(str(robot / "r.xml"))
    with pytest.raises(AssetError, match="refused"):
        compile_plain(load(robot / "r.xml"))


def test_a_urdf_is_attached_with_its_meshes(tmp_path: Path, make_box) -> None:
    make_box(tmp_path / "arm files/meshes/box.stl", 0.5)
    shape = '<collision><geometry><mesh filename="meshes/box.stl"/></geometry></collision>'
    inertial = '<inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    (tmp_path / "arm files/ärm.urdf").write_text(
        f'<robot name="arm"><link name="arm">{inertial}{shape}</link><link name="hand">{inertial}{shape}</link>\n'
        '<joint name="turn" type="continuous"><parent link="arm"/><child link="hand"/></joint></robot>'
    )
    (tmp_path / "r.xml").write_text(
        '<mujoco><asset><model name="m" file="arm files/ärm.urdf"/></asset><worldbody><body name="base">'
        '<geom size=".1"/><attach model="m" body="arm" prefix="l_"/></body></worldbody></mujoco>'
    )
    description = load(tmp_path / "r.xml")
    model = compile_plain(description)
    assert (model.nmesh, masses(model)["l_hand"]) == (1, 2.0)
    origins = [(each.given, each.original, each.where) for each in read(description).origins]
    assert origins[1:] == [
        ("l_arm", "arm", "ärm.urdf:1"),
        ("l_hand", "hand", "ärm.urdf:1"),
        ("l_turn", "turn", "ärm.urdf:2"),
    ]
