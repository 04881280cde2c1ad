"""A robot as it is looked at: models with parts missing, poses, pictures, films and `morphkit show`."""

from __future__ import annotations

import re
import socket
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from urllib.parse import urlsplit

import mujoco
import numpy as np
import pytest
from PIL import Image

from morphkit import opengl, portraits
from morphkit.browser import HOST, BrowserViewer
from morphkit.browser_guard import own_pages_only
from morphkit.description import Description
from morphkit.dressing import geom_colour, visible_geoms
from morphkit.errors import ConfigError, DependencyError
from morphkit.markdown import fenced, plain
from morphkit.masses import limb_masses
from morphkit.mechanics import base_joints, load_mechanics
from morphkit.posing import dials, pose, swing
from morphkit.robots import load
from morphkit.surfaces import surface
from morphkit_cli.main import run

INERTIA = '<inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/>'
LINK = '<link name="{0}"><inertial><mass value="1"/>' + INERTIA + "</inertial>{1}</link>"
JOINT = (
    '<joint name="{0}" type="{1}"><origin xyz="0 0 .5"/><parent link="{2}"/><child link="{3}"/><axis xyz="0 1 0"/>{4}'
    "</joint>"
)
LIMIT = '<limit lower="{}" upper="{}" effort="1" velocity="1"/>'
BOX = '<{0}><geometry><box size=".1 .1 .4"/></geometry></{0}>'
MESH = '<{0}><geometry><mesh filename="{1}"/></geometry></{0}>'


def urdf(*elements: str, folder: Path | None = None) -> Description:
    return Description("r", "r.urdf", "urdf", f'<robot name="r">{"".join(elements)}</robot>'.encode(), folder=folder)


def mjcf(body: str, rest: str = "") -> Description:
    text = f"<mujoco><worldbody><body name='root'><geom size='.1'/>{body}</body></worldbody>{rest}</mujoco>"
    return Description("r", "r.xml", "mjcf", text.encode())


def arm(first: str = "", second: str = "", limit: str = LIMIT.format(-0.5, 1.0)) -> Description:
    return urdf(
        LINK.format("a", BOX.format("visual")),
        LINK.format("b", first),
        LINK.format("c", second),
        JOINT.format("ab", "revolute", "a", "b", limit),
        JOINT.format("bc", "revolute", "b", "c", limit),
    )


@pytest.fixture
def gl() -> None:
    try:
        opengl.open_context(8, 8).free()
    except DependencyError as error:
        pytest.skip(str(error))


# Models with parts missing.


def shapes(description: Description, body: str) -> list[str]:
    """Kinds of a body's visible shapes."""
    model = load_mechanics(description).model
    own = [geom for geom in visible_geoms(model) if model.body(model.geom_bodyid[geom]).name == body]
    return [mujoco.mjtGeom(model.geom_type[geom]).name.removeprefix("mjGEOM_").lower() for geom in own]


def test_limbs_without_shapes_are_sticks_to_their_children() -> None:
    assert shapes(arm(), "b") == ["sphere", "capsule"]
    assert shapes(arm(), "a") == ["box"]
    masses = limb_masses(load_mechanics(arm()))
    assert [mass.mass for mass in masses.values() if mass] == [1.0, 1.0, 1.0]


def test_collision_shapes_stand_in_for_missing_meshes() -> None:
    both = BOX.format("collision") + MESH.format("visual", "gone.stl")
    assert shapes(arm(both), "b") == ["box"]
    mechanics = load_mechanics(arm(both))
    assert ["gone.stl" in note for note in mechanics.notes] == [True]
    seen = BOX.format("visual") + MESH.format("collision", "gone.stl")
    assert shapes(arm(seen), "b") == ["box"]


def test_broken_meshes_and_impossible_inertias_are_left_out_and_noted(tmp_path: Path) -> None:
    (tmp_path / "broken.stl").write_bytes(b"\0" * 84)
    robot = replace(arm(MESH.format("visual", "broken.stl")), folder=tmp_path)
    mechanics = load_mechanics(robot)
    assert len(mechanics.notes) == 1
    assert "broken" in mechanics.notes[0]
    bad = replace(arm(), source=arm().source.replace(b'ixx=".1"', b'ixx="-1"', 1))
    mechanics = load_mechanics(bad)
    assert "inertia of 'a'" in mechanics.notes[0]
    assert limb_masses(mechanics)["a"] is None
    assert limb_masses(mechanics)["b"] is not None


def test_masses_of_fixed_links_belong_to_the_limb() -> None:
    robot = urdf(LINK.format("a", ""), LINK.format("b", ""), JOINT.format("ab", "fixed", "a", "b", ""))
    mass = limb_masses(load_mechanics(robot))["a"]
    assert mass is not None
    assert mass.mass == 2.0
    assert mass.centre == pytest.approx((0, 0, 0.25))
    assert mass.moments == pytest.approx((0.2, 0.2 + 2 * 0.25**2, 0.2 + 2 * 0.25**2))


@pytest.mark.parametrize("name", ["cheetah", "arm"])
def test_masses_agree_with_the_simulator(name: str) -> None:
    from morphkit.simulation import build

    model = build(load(name)).model
    masses = limb_masses(load_mechanics(load(name), shapes=False))
    assert sum(mass.mass for mass in masses.values() if mass) == pytest.approx(model.body_mass.sum(), rel=1e-12)


def test_the_floor_is_right_below_the_robot() -> None:
    mechanics = load_mechanics(arm(BOX.format("visual"), BOX.format("visual")))
    assert mechanics.model.geom("morphkit_floor").pos[2] == pytest.approx(-0.2)
    data = mujoco.MjData(mechanics.model)
    mujoco.mj_kinematics(mechanics.model, data)
    assert data.geom("morphkit_floor").xpos[2] == pytest.approx(-0.2)


def test_colours_of_the_file_are_kept_and_others_tell_limbs_apart() -> None:
    model = load_mechanics(mjcf("<body name='x'><joint/><geom name='g' size='.1' rgba='1 0.5 0.25 1'/></body>")).model
    assert geom_colour(model, model.geom("g").id) == pytest.approx([1, 0.5, 0.25, 1])
    plain = load_mechanics(arm(BOX.format("visual"), BOX.format("visual"))).model
    colours = {tuple(geom_colour(plain, geom)) for geom in visible_geoms(plain) if plain.geom_bodyid[geom] > 0}
    assert len(colours) == 3


def test_base_joints() -> None:
    assert [joint.name for joint in base_joints(load_mechanics(load("cheetah")))] == ["rootx", "rootz", "rooty"]
    assert base_joints(load_mechanics(arm())) == ()


# Poses.


def test_dials_are_in_degrees_and_metres_and_start_within_their_limits() -> None:
    slide = '<joint name="s" type="prismatic"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>{}</joint>'
    robot = urdf(
        LINK.format("a", ""),
        LINK.format("b", ""),
        LINK.format("c", ""),
        slide.format(LIMIT.format(0.1, 0.4)),
        JOINT.format("bc", "continuous", "b", "c", ""),
    )
    first, second = dials(load_mechanics(robot))
    assert (first.name, first.limb, first.unit, first.low, first.high, first.start) == ("s", "b", "m", 0.1, 0.4, 0.1)
    assert (second.unit, second.low, second.high, second.start) == ("°", -180, 180, 0)
    assert "rootx" not in [dial.name for dial in dials(load_mechanics(load("cheetah")))]


def test_a_pose_turns_joints_by_degrees() -> None:
    mechanics = load_mechanics(arm())
    data = mujoco.MjData(mechanics.model)
    data.qpos[:] = pose(mechanics, {"ab": 30.0, "nothing": 1.0})
    mujoco.mj_kinematics(mechanics.model, data)
    angle = np.radians(30)
    assert data.body("c").xpos - data.body("b").xpos == pytest.approx([np.sin(angle) / 2, 0, np.cos(angle) / 2])


def test_mimic_joints_follow() -> None:
    mimic = LIMIT.format(-2, 2) + '<mimic joint="ab" multiplier="-2" offset=".1"/>'
    robot = urdf(
        *(LINK.format(name, "") for name in "abc"),
        JOINT.format("ab", "revolute", "a", "b", LIMIT.format(-1, 1)),
        JOINT.format("bc", "revolute", "b", "c", mimic),
    )
    mechanics = load_mechanics(robot)
    assert [dial.name for dial in dials(mechanics)] == ["ab"]
    assert pose(mechanics, {"ab": np.degrees(0.5)}) == pytest.approx([0.5, -0.9])


def test_ball_joints_have_three_dials() -> None:
    mechanics = load_mechanics(mjcf("<body name='x'><joint name='b' type='ball'/><geom size='.1'/></body>"))
    assert [dial.name for dial in dials(mechanics)] == ["b x", "b y", "b z"]
    half = np.radians(20)
    assert pose(mechanics, {"b y": 40.0}) == pytest.approx([np.cos(half), 0, np.sin(half), 0])


def test_key_frames_are_start_poses() -> None:
    body = "<body name='x'><joint name='j' range='-90 90'/><geom size='.1'/></body>"
    mechanics = load_mechanics(mjcf(body, "<keyframe><key qpos='.25'/></keyframe>"))
    assert mechanics.start == pytest.approx([0.25])
    assert dials(mechanics)[0].start == pytest.approx(np.degrees(0.25))


def test_a_swing_reaches_both_ends_and_comes_back() -> None:
    dial = dials(load_mechanics(arm()))[0]
    values = swing(dial, 301)
    assert (values[0], values[-1]) == pytest.approx((0, 0))
    assert (min(values), max(values)) == pytest.approx((dial.low, dial.high), abs=0.1)


# Surfaces for viewers that draw triangles.


@pytest.mark.parametrize(
    ("geom", "volume"),
    [
        ("type='sphere' size='.5'", 4 / 3 * np.pi * 0.125),
        ("type='ellipsoid' size='.5 .25 1'", 4 / 3 * np.pi * 0.125),
        ("type='box' size='.5 .25 1'", 1.0),
        ("type='cylinder' size='.5 1'", 2 * np.pi * 0.25),
        ("type='capsule' size='.5 1'", 2 * np.pi * 0.25 + 4 / 3 * np.pi * 0.125),
    ],
)
def test_surfaces_enclose_the_shape(geom: str, volume: float) -> None:
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody><geom {geom}/></worldbody></mujoco>")
    mesh = surface(model, 0)
    assert mesh.volume == pytest.approx(volume, rel=0.03)
    assert mesh.bounds.mean(axis=0) == pytest.approx([0, 0, 0], abs=1e-6)


def test_meshes_keep_their_triangles_and_planes_have_none() -> None:
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><asset><mesh name='m' vertex='0 0 0 1 0 0 0 1 0 0 0 1'/></asset><worldbody>"
        "<geom type='mesh' mesh='m'/><geom type='plane' size='1 1 1'/></worldbody></mujoco>"
    )
    assert surface(model, 0).volume == pytest.approx(1 / 6)
    assert surface(model, 1) is None


# Names in the browser.


@pytest.mark.parametrize("name", ["{alert(1)}", "<b>x</b>", "a_b*c", "[x](http://y)", "`x`", "a\n# b"])
def test_names_stay_text_in_markdown(name: str) -> None:
    text = plain(name)
    assert "\n" not in text
    assert not re.search(r"(?<!\\)[`*_{}\[\]<>#]", text)
    assert text.replace("\\", "") == " ".join(name.split())


def test_code_cannot_end_its_block() -> None:
    assert fenced("a").splitlines() == ["```", "a", "```"]
    assert fenced("a\n````\n{b}").splitlines() == ["`````", "a", "````", "{b}", "`````"]


# Pictures, films and the command.


@pytest.mark.usefixtures("gl")
def test_portrait_shows_the_whole_robot() -> None:
    red = "<geom type='capsule' size='.05' fromto='0 0 0 0 0 2' rgba='1 0 0 1'/>"
    picture = portraits.portrait(load_mechanics(mjcf(red)), width=120, height=90).astype(int)
    rows = np.nonzero((picture[..., 0] > 120) & (picture[..., 1] < 60))[0]
    assert 2 < rows.min() < 15
    assert rows.max() > 55


@pytest.mark.usefixtures("gl")
def test_a_film_has_a_caption_and_marks_what_moves(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(portraits, "_FEWEST", 3)
    monkeypatch.setattr(portraits, "_MOST", 3)
    mechanics = load_mechanics(arm(BOX.format("visual"), BOX.format("visual")))
    shots = portraits.swing_shots(mechanics)
    assert [dial.name for dial, _ in shots] == ["ab"] * 3 + ["bc"] * 3
    frames = list(portraits.film(mechanics, shots, width=120, height=100))
    assert {frame.shape for frame in frames} == {(100, 120, 3)}
    marked = [((f[:80, :, 0] > 200) & (f[:80, :, 1] < 150)).sum() for f in frames]
    assert min(marked) > 20
    assert not np.array_equal(frames[0][90:], frames[3][90:])


def test_nothing_to_swing_is_an_error() -> None:
    with pytest.raises(ConfigError, match="no joint to swing"):
        portraits.swing_shots(load_mechanics(urdf(LINK.format("a", ""))))


@pytest.mark.usefixtures("gl")
def test_command_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["show", "cheetah", "--png", str(tmp_path / "c.png")]) == 0
    assert Image.open(tmp_path / "c.png").size == (960, 720)
    assert capsys.readouterr().out == ""


def test_command_prints_the_tree_with_masses(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["show", "cheetah"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "cheetah  MJCF · planar base · 7 limbs · 6 joints · 6 actuators · 21.18 kg"
    assert "    ├── bthigh  thigh  2.336 kg" in lines
    assert "    slide rootx unlimited" in lines


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--png", "robot.jpg"], "must end in .png"),
        (["--gif", "robot.png"], "must end in .gif or .mp4"),
        (["--port", "8000"], "--port belongs to --web"),
    ],
)
def test_wrong_usage(arguments: list[str], expected: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["show", "cheetah", *arguments]) == 2
    assert expected in capsys.readouterr().err


def test_a_taken_port_is_an_error(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("viser")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert run(["show", "arm", "--web", "--port", str(port)]) == 2
    assert f"port {port} is taken" in capsys.readouterr().err


@pytest.fixture(scope="module")
def viewer() -> Iterator[BrowserViewer]:
    pytest.importorskip("viser")
    with socket.socket() as probe:
        probe.bind((HOST, 0))
        port = probe.getsockname()[1]
    shown = BrowserViewer(load("cheetah_3_balanced"), command=["morphkit"], port=port)
    yield shown
    shown.close()


@pytest.mark.parametrize(
    ("origin", "accepted"),
    [
        ("http://127.0.0.1:{port}", True),
        ("http://localhost:9000", True),
        ("https://example.com", False),
        ("http://127.0.0.1.example.com", False),
        ("http://localhost:80@example.com", False),
        ("null", False),
        (None, False),
    ],
)
def test_only_pages_from_this_machine_can_connect(viewer: BrowserViewer, origin: str | None, accepted: bool) -> None:
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    address = urlsplit(viewer.url)
    protocol = f"viser-v{sys.modules['viser'].__version__}"
    origin = origin and origin.format(port=address.port)
    if accepted:
        with connect(f"ws://{address.netloc}", origin=origin, subprotocols=[protocol], max_size=None) as page:
            assert page.recv(timeout=10)
    else:
        with pytest.raises(InvalidStatus) as refused:
            connect(f"ws://{address.netloc}", origin=origin, subprotocols=[protocol])
        assert refused.value.response.status_code == 403


def test_a_viser_that_cannot_be_guarded_is_refused() -> None:
    pytest.importorskip("viser")
    with pytest.raises(DependencyError, match="other sites"), own_pages_only():
        pass


def test_without_viser_the_message_says_how_to_get_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "viser", None)
    assert run(["show", "cheetah", "--web"]) == 2
    assert 'pip install "morphkit[viewer]"' in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "code"), [(["show", "cheetah_3_balanced"], 0), (["diff", "cheetah", "cheetah_3_balanced"], 1)]
)
def test_documentation_shows_what_is_printed(
    arguments: list[str], code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(arguments) == code
    printed = [line.rstrip() for line in capsys.readouterr().out.splitlines()]
    page = (Path(__file__).parents[2] / "docs" / "viewing.md").read_text(encoding="utf-8")
    shown = page.split(f"$ morphkit {' '.join(arguments)}\n", 1)[1].split("```", 1)[0]
    assert printed == shown.splitlines()
