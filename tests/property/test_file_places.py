"""Files of random include trees and random settings are found where MuJoCo finds them, before and after a cut."""

from __future__ import annotations

import itertools
import posixpath
import struct
import tempfile
from pathlib import Path

import imageio.v3
import mujoco
import numpy as np
from hypothesis import event, given, settings
from hypothesis import strategies as st

from morphkit.ablation.ablate import ablate
from morphkit.families.write import write_family
from morphkit.registry import load
from morphkit.simulation.build import compile_plain
from morphkit.simulation.spec import load_spec

FOLDERS = (".", "a", "b", "a/b", "a/b/a")
PLACES = ("", "a/", "b/", "../", "./b/../", "a\\", "none/../")
INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
ASSETS = {
    "mesh": '<mesh name="m{0}" file="{1}.obj"/>',
    "hfield": '<hfield name="h{0}" file="{1}.bin" size="1 1 1 1"/>',
    "texture": '<texture name="t{0}" type="2d" file="{1}.png"/>',
    "flexcomp": "",
}
FLEXCOMP = '<body name="s{0}"><flexcomp name="f{0}" type="mesh" dim="2" mass="1" rigid="true" file="{1}.obj"/></body>'


def box(size: float) -> bytes:
    corners = [f"v {x} {y} {z}" for x, y, z in itertools.product((-size, size), repeat=3)]
    return "\n".join([*corners, *(f"f {a} {b} {c}" for a, b, c in itertools.combinations(range(1, 9), 3))]).encode()


def heights(rows: int) -> bytes:
    return struct.pack("<2i", rows, 2) + np.arange(2 * rows, dtype="<f4").tobytes()


def picture(width: int) -> bytes:
    return bytes(imageio.v3.imwrite("<bytes>", np.zeros((width, width, 3), np.uint8), extension=".png"))


def compilers() -> st.SearchStrategy[str]:
    """A `<compiler>` that says where files are, or none."""
    folders = st.sampled_from(("meshdir", "assetdir", "texturedir"))
    words = st.dictionaries(folders, st.sampled_from(("", "a", "b/", "./a/b", "none")), max_size=2)
    strip = st.sampled_from(("", "", ' strippath="true"', ' strippath="false"'))
    made = st.builds(lambda w, s: "<compiler" + "".join(f' {k}="{v}"' for k, v in w.items()) + s + "/>", words, strip)
    return st.one_of(st.just(""), made)


@st.composite
def include_trees(draw: st.DrawFn) -> dict[str, bytes]:
    """A main file in folder `main`, files that it includes, one in another, and what they name; contents by path."""
    count = draw(st.integers(1, 4))
    places = ["main/main.xml"]
    includes: dict[int, str] = {}
    for number in range(1, count):
        owner = draw(st.integers(0, number - 1))
        start = draw(st.sampled_from((posixpath.dirname(places[owner]), "main")))
        places.append(posixpath.normpath(f"{start}/{draw(st.sampled_from(FOLDERS))}/p{number}.xml"))
        reference = posixpath.relpath(places[number], start)
        includes[owner] = includes.get(owner, "") + f'<include file="{reference}"/>'
    files = {}
    for number, place in enumerate(places):
        kind, name = draw(st.sampled_from(list(ASSETS))), draw(st.sampled_from(PLACES)) + "m"
        inside = FLEXCOMP.format(number, name) if kind == "flexcomp" else ""
        limb = f'<body name="b{number}"><joint name="j{number}"/><geom size=".1"/>{inside}</body>'
        parts = f"{draw(compilers())}<asset>{ASSETS[kind].format(number, name)}</asset>{includes.get(number, '')}"
        top = f'<body name="r{number}">{limb}<body name="cut{number}"><joint/><geom size=".1"/></body></body>'
        files[place] = f"<mujoco>{parts}<worldbody>{top}</worldbody></mujoco>".encode()
    folders = [posixpath.normpath(f"{at}/{folder}") for at in {*map(posixpath.dirname, places)} for folder in FOLDERS]
    for number, folder in enumerate(draw(st.lists(st.sampled_from(sorted(folders)), unique=True, min_size=1)), start=2):
        files |= {
            f"{folder}/m.obj": box(number),
            f"{folder}/m.bin": heights(number),
            f"{folder}/m.png": picture(number),
        }
    return files


def lay(files: dict[str, bytes], home: Path) -> None:
    for place, content in files.items():
        (home / place).parent.mkdir(parents=True, exist_ok=True)
        (home / place).write_bytes(content)


def assert_same_files(one: mujoco.MjModel, other: mujoco.MjModel) -> None:
    for array in ("mesh_vert", "flex_vert", "hfield_nrow", "tex_width"):
        np.testing.assert_array_equal(getattr(one, array), getattr(other, array))


def load_alone(path: Path) -> mujoco.MjModel | None:
    """What MuJoCo makes of a file by itself; None where it refuses it."""
    try:
        return mujoco.MjModel.from_xml_path(str(path))
    except ValueError:
        return None


@settings(max_examples=40, deadline=None, derandomize=True)
@given(include_trees())
def test_files_of_include_trees_are_where_mujoco_finds_them(files: dict[str, bytes]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder).resolve()
        lay(files, home)
        wanted = load_alone(home / "main/main.xml")
        event("compiles" if wanted is not None else "refused")
        if wanted is None:
            return
        robot = load(home / "main/main.xml", root="r0")
        assert_same_files(load_spec(robot)[0].compile(), wanted)
        for mode in ("copy", "reference"):
            manifest = write_family(robot, [ablate(robot, remove=["cut0"], name="cut")], home / mode, assets=mode)
            cut = load_alone(manifest.parent / "cut.xml")
            assert cut is not None
            assert_same_files(cut, wanted)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    st.lists(st.sampled_from(("m", "a", "m/a", "package:/p/a", ".")), unique=True),
    st.sampled_from(("leg.obj", "a/leg.obj", "../robot/a/leg.obj", "package://p/a/leg.obj", "none/../leg.obj")),
    st.sampled_from(("", 'meshdir="m"', 'assetdir="m"', 'assetdir="a" meshdir="m"', 'meshdir="none/../m/"')),
    st.sampled_from(("", 'strippath="true"', 'strippath="false"')),
)
def test_meshes_of_urdfs_are_where_mujoco_finds_them(places: list[str], name: str, folder: str, strip: str) -> None:
    compiler = f"<mujoco><compiler {folder} {strip}/></mujoco>"
    mesh = f'<collision><geometry><mesh filename="{name}"/></geometry></collision>'
    links = f'<link name="a">{INERTIAL}</link><link name="b">{INERTIAL}{mesh}</link><link name="c">{INERTIAL}</link>'
    joint = '<joint name="{0}" type="continuous"><parent link="a"/><child link="{0}"/></joint>'
    files = {f"robot/{place}/leg.obj": box(1 + number) for number, place in enumerate(places)}
    with tempfile.TemporaryDirectory() as folder_of_test:
        home = Path(folder_of_test).resolve()
        text = f'<robot name="r">{compiler}{links}{joint.format("b")}{joint.format("c")}</robot>'
        lay({**files, "robot/r.urdf": text.encode()}, home)
        wanted = load_alone(home / "robot/r.urdf")
        if wanted is None:
            return
        robot = load(home / "robot/r.urdf")
        np.testing.assert_array_equal(compile_plain(robot).mesh_vert, wanted.mesh_vert)
        for mode in ("copy", "reference"):
            manifest = write_family(robot, [ablate(robot, remove=["c"], name="cut")], home / mode, assets=mode)
            written = load_alone(manifest.parent / "cut.urdf")
            assert written is not None
            np.testing.assert_array_equal(written.mesh_vert, wanted.mesh_vert)
