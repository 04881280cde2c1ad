"""Files are found where MuJoCo finds them."""

from __future__ import annotations

import itertools
import shutil
from pathlib import Path

import mujoco
import numpy as np
import pytest

from cli.main import run as morphkit
from morphkit.conversion.convert import convert
from morphkit.families.manifest import read_manifest
from morphkit.formats.limits import BODIES
from morphkit.registry import load
from morphkit.simulation.build import compile_plain

LIMB = '<body name="c" pos="1 0 0"><joint name="j"/><geom size=".1"/></body>'
PART = f"""<mujoco><asset><mesh name="m" file="m.obj"/></asset><worldbody><body name="b"><freejoint/>
<geom type="mesh" mesh="m"/>{LIMB}</body></worldbody></mujoco>"""
MAIN = '<mujoco>{}<include file="sub/part.xml"/></mujoco>'
FLEXCOMP = """<mujoco><compiler meshdir="meshes"/><worldbody><body name="t" pos="0 0 1"><freejoint/><geom size=".1"/>
<body name="arm" pos=".2 0 0"><joint name="a"/><geom size=".05"/></body></body>
<flexcomp name="soft" type="mesh" file="ball.obj" dim="2" mass="1" radius=".001"/></worldbody></mujoco>"""
INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
URDF = f"""<robot name="r"><mujoco><compiler meshdir="parts"/></mujoco><link name="base">{INERTIAL}</link>
<link name="a">{INERTIAL}<collision><geometry><mesh filename="leg.obj"/></geometry></collision></link>
<link name="b">{INERTIAL}</link>
<joint name="j" type="revolute"><parent link="base"/><child link="a"/><limit lower="-1" upper="1" effort="5"/></joint>
<joint name="k" type="revolute"><parent link="base"/><child link="b"/><limit lower="-1" upper="1" effort="5"/></joint>
</robot>"""


def box(size: float) -> str:
    corners = [f"v {x} {y} {z}" for x, y, z in itertools.product((-size, size), repeat=3)]
    return "\n".join([*corners, *(f"f {a} {b} {c}" for a, b, c in itertools.combinations(range(1, 9), 3))])


@pytest.fixture
def lay(tmp_path: Path):
    def lay(files: dict[str, str]) -> Path:
        for place, text in files.items():
            (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / place).write_text(text)
        return tmp_path / next(iter(files))

    return lay


@pytest.mark.parametrize(
    ("settings", "sizes", "found"),
    [
        ("", {"sub/m.obj": 2.0}, 2.0),
        ("", {"sub/m.obj": 2.0, "m.obj": 3.0}, 3.0),
        ('<compiler meshdir="meshes"/>', {"sub/m.obj": 2.0, "m.obj": 3.0}, 2.0),
        ('<compiler meshdir="meshes"/>', {"sub/m.obj": 2.0, "m.obj": 3.0, "meshes/m.obj": 4.0}, 4.0),
        ('<compiler strippath="true"/>', {"sub/m.obj": 2.0, "m.obj": 3.0}, 3.0),
        ('<compiler strippath="true" meshdir="a"/>', {"sub/m.obj": 2.0, "a/m.obj": 3.0}, 3.0),
    ],
)
@pytest.mark.parametrize("assets", ["copy", "reference"])
def test_a_mesh_that_an_included_file_names(lay, tmp_path, settings, sizes, found, assets) -> None:
    robot = lay({"main.xml": MAIN.format(settings), "sub/part.xml": PART} | {k: box(v) for k, v in sizes.items()})
    wanted = mujoco.MjModel.from_xml_path(str(robot))
    assert np.allclose(wanted.geom_aabb[0, 3:], found)
    assert np.array_equal(compile_plain(load(robot)).mesh_vert, wanted.mesh_vert)
    out = tmp_path / "out"
    assert morphkit(["ablate", str(robot), "--remove", "c", "--assets", assets, "-o", str(out), "-q"]) == 0
    cut = mujoco.MjModel.from_xml_path(str(out / "main-no-c.xml"))
    assert np.array_equal(cut.mesh_vert, wanted.mesh_vert)
    if assets == "copy":
        shutil.move(out, tmp_path / "moved" / "far")
        mujoco.MjModel.from_xml_path(str(tmp_path / "moved" / "far" / "main-no-c.xml"))


def test_a_file_in_a_folder_below_an_included_one(lay) -> None:
    """An included file can itself include, and names files from its own folder; the main file's folder comes first."""
    robot = lay(
        {
            "main.xml": MAIN.format(""),
            "sub/part.xml": '<mujoco><include file="deep/part.xml"/></mujoco>',
            "sub/deep/part.xml": PART.replace("m.obj", "../meshes/m.obj"),
            "sub/meshes/m.obj": box(2.0),
        }
    )
    wanted = mujoco.MjModel.from_xml_path(str(robot))
    assert np.array_equal(compile_plain(load(robot)).mesh_vert, wanted.mesh_vert)


def test_a_linked_include_is_where_the_link_is(lay, tmp_path) -> None:
    robot = lay({"r/main.xml": MAIN.format(""), "r/lib/part.xml": PART, "r/sub/m.obj": box(2.0)})
    (robot.parent / "sub" / "part.xml").symlink_to(robot.parent / "lib" / "part.xml")
    wanted = mujoco.MjModel.from_xml_path(str(robot))
    assert np.array_equal(compile_plain(load(robot)).mesh_vert, wanted.mesh_vert)


@pytest.mark.parametrize("name", ["/else/where/m.obj", "C:\\cad\\m.obj", "a/b/m.obj"])
def test_strippath(lay, tmp_path, name) -> None:
    text = PART.replace("<asset>", '<compiler meshdir="meshes" strippath="true"/><asset>').replace("m.obj", name)
    robot = lay({"r.xml": text, "meshes/m.obj": box(2.0)})
    wanted = mujoco.MjModel.from_xml_path(str(robot))
    assert np.array_equal(compile_plain(load(robot)).mesh_vert, wanted.mesh_vert)
    assert morphkit(["ablate", str(robot), "--remove", "c", "-o", str(tmp_path / "out"), "-q"]) == 0
    assert read_manifest(tmp_path / "out").assets.keys() == {"meshes/m.obj"}
    mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "r-no-c.xml"))


@pytest.mark.parametrize("assets", ["copy", "reference"])
def test_the_shape_of_a_flexcomp(lay, tmp_path, assets) -> None:
    robot = lay({"r.xml": FLEXCOMP, "meshes/ball.obj": box(0.1)})
    wanted = mujoco.MjModel.from_xml_path(str(robot))
    found = compile_plain(load(robot, root="t"))
    assert found.nflexvert == wanted.nflexvert == 8
    assert np.array_equal(found.body_pos, wanted.body_pos)
    out = ["-o", str(tmp_path / "out"), "-q", "--assets", assets]
    assert morphkit(["ablate", str(robot), "--root", "t", "--remove", "arm", *out]) == 0
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "r-no-arm.xml")).nflexvert == 8


def test_a_flexcomp_that_is_cut_in_mujocos_own_output(lay, tmp_path) -> None:
    text = FLEXCOMP.replace("<worldbody>", '<worldbody><replicate count="2" offset="0 3 0">').replace(
        "</body></body>", "</body></body></replicate>"
    )
    robot = lay({"r.xml": text, "meshes/ball.obj": box(0.1)})
    bodies = [body.name for body in mujoco.MjSpec.from_file(str(robot)).worldbody.bodies]
    out = ["-o", str(tmp_path / "out"), "-q", "--name", "cut"]
    assert morphkit(["ablate", str(robot), "--root", bodies[0], "--remove", "arm*", *out]) == 0
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "cut.xml")).nflexvert == 8


def test_a_flexcomp_whose_shape_is_missing_outside_or_too_large(lay, tmp_path, capsys) -> None:
    robot = lay({"robot/r.xml": FLEXCOMP, "secret.obj": box(1.0)})
    for text, reason in ((FLEXCOMP, "r.xml:3: file 'meshes/ball.obj' not found"),):
        robot.write_text(text)
        assert morphkit(["tokens", str(robot), "--root", "t"]) == 2
        assert reason in capsys.readouterr().err
        assert morphkit(["check", str(robot)]) == 1
        assert "flexcomp 'soft': file 'meshes/ball.obj' not found" in capsys.readouterr().out
    robot.write_text(FLEXCOMP.replace("ball.obj", "../../secret.obj"))
    assert morphkit(["tokens", str(robot), "--root", "t"]) == 2
    assert "outside, refused" in capsys.readouterr().err
    robot.write_text(FLEXCOMP.replace("ball.obj", "large.obj"))
    lay({"robot/meshes/large.obj": "v 0 0 0\n" * (BODIES + 1)})
    assert morphkit(["tokens", str(robot), "--root", "t"]) == 2
    assert "a flexcomp of large.obj makes 20,001 bodies; the limit is 20,000" in capsys.readouterr().err


@pytest.mark.parametrize("assets", ["copy", "reference"])
def test_meshdir_in_the_mujoco_extension_of_a_urdf(lay, tmp_path, capsys, assets) -> None:
    robot = lay({"r.urdf": URDF, "parts/leg.obj": box(2.0)})
    wanted = mujoco.MjModel.from_xml_path(str(robot))
    assert np.array_equal(compile_plain(load(robot)).mesh_vert, wanted.mesh_vert)
    assert np.array_equal(convert(load(robot)).spec.compile().mesh_vert, wanted.mesh_vert)
    assert morphkit(["ablate", str(robot), "--remove", "b", "--assets", assets, "-o", str(tmp_path / "out"), "-q"]) == 0
    cut = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "r-no-b.urdf"))
    assert np.array_equal(cut.mesh_vert, wanted.mesh_vert)


def test_a_urdf_whose_meshes_only_ros_finds_in_spite_of_its_extension(lay) -> None:
    robot = lay({"p/urdf/r.urdf": URDF.replace("leg.obj", "package://p/meshes/leg.obj")})
    lay({"p/package.xml": "", "p/meshes/leg.obj": box(2.0)})
    assert compile_plain(load(robot)).nmesh == 1


DECORATION = 'contype="0" conaffinity="0" mass="0"'


@pytest.mark.parametrize("what", [["--all", "--min-limbs", "1"], ["--remove", "c"]])
@pytest.mark.parametrize(("attributes", "words"), [("", "not compiled"), (DECORATION, "cannot load it")])
def test_a_variant_that_does_not_compile_is_an_error(lay, tmp_path, capsys, what, attributes, words) -> None:
    other = LIMB.replace('"c"', '"d"').replace('"j"', '"k"')
    text = PART.replace('mesh="m"', f'mesh="m" {attributes}').replace(LIMB, LIMB + other)
    robot = lay({"r.xml": text.replace("<freejoint/>", '<freejoint/><geom size=".1"/>')})
    assert morphkit(["ablate", str(robot), *what, "-o", str(tmp_path / "out"), "--quiet"]) == 2
    printed = capsys.readouterr().err
    assert printed.startswith("error: ")
    assert words in printed
    assert "m.obj" in printed
    assert read_manifest(tmp_path / "out").variants
    assert morphkit(["ablate", str(robot), *what, "-o", str(tmp_path / "out"), "--no-compile", "-q"]) == 0
