"""Tree in the terminal, pictures, videos, and what is said where OpenGL is missing."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from rich.console import Console

from morphkit import opengl, pictures, viewing
from morphkit.description import Description
from morphkit.errors import ConfigError, DependencyError, OutputError
from morphkit.morphology import Actuator, Joint, Limb, Morphology
from morphkit.rendering import model_frames

WALKING_BOX = """
<mujoco>
  <worldbody>
    {floor}
    <body name="box" pos="0 0 {height}">
      <joint name="x" type="slide" axis="1 0 0"/>
      <joint name="z" type="slide" axis="0 0 1"/>
      <geom type="box" size=".3 .1 .1" rgba="1 0 0 1"/>
    </body>
  </worldbody>
</mujoco>
"""


def box(height: float = 0.5, floor: bool = True) -> mujoco.MjModel:
    plane = '<geom type="plane" size="9 9 1"/>' if floor else ""
    return mujoco.MjModel.from_xml_string(WALKING_BOX.format(floor=plane, height=height))


@dataclass
class FakeSimulation:
    """What pictures take of a simulation."""

    model: Any
    base: str = "planar"
    limb_body: np.ndarray = field(default_factory=lambda: np.array([1]))
    description: Description = field(default_factory=lambda: Description("box", "box.xml", "mjcf", b""))


@pytest.fixture
def gl() -> None:
    try:
        opengl.open_context(8, 8).free()
    except DependencyError as error:
        pytest.skip(str(error))


def redness(picture: np.ndarray) -> np.ndarray:
    """Where the red box is, bool, shape (height, width)."""
    red, green, blue = np.moveaxis(picture.astype(int), -1, 0)
    return (red > 90) & (green < red / 2) & (blue < red / 2)


# Tree.


def printed(morphology: Morphology) -> str:
    console = Console(width=120, color_system=None)
    with console.capture() as capture:
        console.print(viewing.tree(morphology))
    return capture.get()


def robot() -> Morphology:
    shoulder = (Joint("yaw", "hinge", True, -np.pi / 2, np.pi), Joint("lift", "slide", True, -0.25, 0.5))
    return Morphology(
        name="arm[1]",
        file="arm.xml",
        format="mjcf",
        sha256="0" * 64,
        base="fixed",
        family=None,
        task=None,
        type_words=(),
        limbs=(
            Limb("base", None, (), ("base",)),
            Limb("shoulder", "base", shoulder, ("shoulder", "plate"), "shoulder"),
            Limb("hand", "shoulder", (Joint("spin", "hinge", False, 0, 0),), ("hand",)),
        ),
        actuators=(
            Actuator("m_yaw", "shoulder", "yaw", -1, 1, "1"),
            Actuator("m_lift", "shoulder", "lift", -20, 20, "N"),
            Actuator("m_hand", "hand", "spin", -np.inf, np.inf, "N*m"),
            Actuator("tendon", None, None, 0, 1, "1"),
        ),
    )


def test_tree_shows_limbs_joints_and_actuators_with_units() -> None:
    assert printed(robot()).splitlines() == [
        "arm[1]  MJCF · fixed base · 3 limbs · 3 joints · 4 actuators",
        "├── base",
        "│   └── shoulder  shoulder",
        "│       hinge yaw -90.0 to 180.0°  actuator m_yaw -1 to 1",
        "│       slide lift -0.25 to 0.5 m  actuator m_lift -20 to 20 N",
        "│       fixed to it: plate",
        "│       └── hand",
        "│           hinge spin unlimited  actuator m_hand unbounded N*m",
        "└── actuators that drive no single limb",
        "    └── actuator tendon 0 to 1",
    ]


# Pictures.


@pytest.mark.usefixtures("gl")
def test_pictures_have_the_asked_for_shape_and_show_the_robot() -> None:
    frames = viewing.render(FakeSimulation(box()), np.zeros((2, 2)), width=64, height=48)  # type: ignore[arg-type]
    assert frames.shape == (2, 48, 64, 3)
    assert frames.dtype == np.uint8
    assert redness(frames[0]).mean() > 0.02
    start = viewing.render(FakeSimulation(box()), width=64, height=48)  # type: ignore[arg-type]
    np.testing.assert_array_equal(start, frames[:1])


@pytest.mark.usefixtures("gl")
def test_a_picture_may_be_larger_than_the_model_s_frame_buffer() -> None:
    assert next(iter(model_frames(box(), width=1000, height=700))).shape == (700, 1000, 3)


@pytest.mark.usefixtures("gl")
def test_the_camera_follows_the_root_while_the_floor_moves_by() -> None:
    here, there = model_frames(box(), np.array([[0, 0], [20.3, 0]]), base="planar", width=96, height=72)
    for picture in (here, there):
        columns = np.nonzero(redness(picture).any(axis=0))[0]
        assert abs(columns.mean() - 47.5) < 3
    assert (here != there)[~redness(here)].mean() > 0.05  # The tiles are elsewhere.


@pytest.mark.usefixtures("gl")
def test_up_is_up() -> None:
    low, high = model_frames(box(), np.array([[0, 0], [0, 0.3]]), base="planar", width=96, height=72)
    assert np.nonzero(redness(high).any(axis=1))[0].mean() < np.nonzero(redness(low).any(axis=1))[0].mean() - 5
    assert low[:8].mean() > 150  # A bright sky, though the model has none.


@pytest.mark.usefixtures("gl")
def test_drawing_leaves_the_simulation_s_model_alone() -> None:
    model = box()
    before = (model.vis.global_.offwidth, float(model.stat.extent), model.vis.headlight.ambient.copy())
    list(model_frames(model, width=64, height=48))
    assert (model.vis.global_.offwidth, float(model.stat.extent)) == before[:2]
    np.testing.assert_array_equal(model.vis.headlight.ambient, before[2])


@pytest.mark.usefixtures("gl")
def test_states_that_are_not_finite_are_left_out() -> None:
    states = np.array([[0, 0], [np.nan, 0], [0, np.inf]])
    assert len(list(model_frames(box(), states, width=32, height=24))) == 1
    with pytest.raises(ConfigError, match="no state to draw"):
        list(model_frames(box(), states[1:], width=32, height=24))


def test_states_of_another_robot_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"shape \(1, 3\), expected \(n, 2\)"):
        next(model_frames(box(), np.zeros(3)))


@pytest.mark.usefixtures("gl")
def test_a_urdf_s_collision_shapes_hide_behind_its_visuals() -> None:
    model = mujoco.MjModel.from_xml_string("""
      <mujoco><worldbody><body name="root"><freejoint/>
        <geom type="sphere" size=".5" rgba="1 0 0 1"/>
        <geom type="sphere" size=".3" rgba="0 0 1 1" contype="0" conaffinity="0" group="1" mass="0"/>
      </body></worldbody></mujoco>""")
    for kind, shows_red in (("urdf", False), ("mjcf", True)):
        simulation = FakeSimulation(model, "free", description=Description("r", "r", kind, b""))  # type: ignore[arg-type]
        assert redness(viewing.render(simulation, width=64, height=48)[0]).any() == shows_red  # type: ignore[arg-type]


@pytest.mark.parametrize(("fps", "kept", "left"), [(125.0, 20, 25.0), (25.0, 100, 25.0), (30.0, 100, 30.0)])
def test_resample_keeps_the_speed(fps: float, kept: int, left: float) -> None:
    states, new = viewing.resample(np.arange(100.0)[:, None], fps)
    assert (len(states), new) == (kept, left)
    assert states[1, 0] / fps == pytest.approx(1 / new)


# No OpenGL.


def test_missing_opengl_names_the_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(name: str) -> None:
        raise AttributeError("'NoneType' object has no attribute 'eglQueryString'")

    monkeypatch.setattr(opengl.importlib, "import_module", fail)
    with pytest.raises(DependencyError, match=r"(?s)eglQueryString.*apt-get install libegl1 libgl1-mesa-dri"):
        next(model_frames(box()))


@pytest.mark.skipif(sys.platform != "linux", reason="EGL is the Linux way")
def test_a_machine_without_egl_drivers_gets_the_message_and_no_crash() -> None:
    code = (
        "import mujoco; from morphkit.rendering import model_frames\n"
        "from morphkit.errors import DependencyError\n"
        "try: next(model_frames(mujoco.MjModel.from_xml_string('<mujoco><worldbody><body/></worldbody></mujoco>')))\n"
        "except DependencyError as error: print(error)"
    )
    hidden = ("DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL")
    environment = {key: value for key, value in os.environ.items() if key not in hidden}
    environment["__EGL_VENDOR_LIBRARY_FILENAMES"] = "/dev/null"
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0
    assert "libegl1 libgl1-mesa-dri" in done.stdout
    assert "Traceback" not in done.stderr


@pytest.mark.usefixtures("gl")
def test_egl_is_found_without_a_display_even_after_mujoco_was_imported() -> None:
    code = (
        "import mujoco; from morphkit.rendering import model_frames; "
        "next(model_frames(mujoco.MjModel.from_xml_string('<mujoco><worldbody><body/></worldbody></mujoco>')))"
    )
    environment = {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "MUJOCO_GL")}
    subprocess.run([sys.executable, "-c", code], env=environment, check=True, timeout=60)


# Files.


def frames(count: int = 10, size: tuple[int, int] = (48, 64)) -> np.ndarray:
    """A white square that moves over black."""
    result = np.zeros((count, *size, 3), np.uint8)
    for index in range(count):
        result[index, 10:20, 4 * index : 4 * index + 10] = 255
    return result


def test_png_keeps_every_pixel(tmp_path: Path) -> None:
    image = pytest.importorskip("PIL.Image")
    picture = np.random.default_rng(0).integers(0, 256, (5, 7, 3), dtype=np.uint8)
    viewing.write_png(picture, tmp_path / "new" / "a.png")
    np.testing.assert_array_equal(np.array(image.open(tmp_path / "new" / "a.png")), picture)


@pytest.mark.parametrize("fps", [25.0, 30.0, 125.0])
def test_gif_lasts_as_long_as_the_states(fps: float, tmp_path: Path) -> None:
    image = pytest.importorskip("PIL.Image")
    gif = image.open(viewing.write_video(iter(frames()), tmp_path / "a.gif", fps))
    total = 0
    for index in range(gif.n_frames):
        gif.seek(index)
        total += gif.info["duration"]
    assert total / 1000 == pytest.approx(10 / fps, abs=0.04)
    assert gif.size == (64, 48)
    assert gif.info["loop"] == 0
    shown = np.array(gif.convert("RGB"))
    assert np.abs(shown.astype(int) - frames()[9]).mean() < 5


def test_mp4_has_all_frames_at_the_right_speed(tmp_path: Path) -> None:
    imageio = pytest.importorskip("imageio.v2")
    pytest.importorskip("imageio_ffmpeg")
    path = viewing.write_video(frames(), tmp_path / "a.mp4", 25.0)
    with imageio.get_reader(path) as reader:
        data = reader.get_meta_data()
        pictures_back = [np.asarray(picture) for picture in reader]
    assert (data["fps"], data["size"], len(pictures_back)) == (25.0, (64, 48), 10)
    assert np.abs(pictures_back[9].astype(int) - frames()[9]).mean() < 8


def test_another_ending_is_refused_before_any_frame_is_drawn(tmp_path: Path) -> None:
    def never() -> Iterator[np.ndarray]:
        raise AssertionError("a frame was drawn")
        yield

    with pytest.raises(ConfigError, match=r"must end in \.gif or \.mp4, not in '\.avi'"):
        viewing.write_video(never(), tmp_path / "a.avi", 25.0)
    with pytest.raises(ConfigError, match=r"must end in \.gif or \.mp4"):
        viewing.check_video_path(tmp_path / "video")


@pytest.mark.parametrize(("count", "fps"), [(0, 25.0), (3, 0.0), (3, float("nan"))])
def test_a_video_of_nothing_is_refused(count: int, fps: float, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="frame"):
        viewing.write_video(frames(count), tmp_path / "a.gif", fps)


@pytest.mark.parametrize("suffix", ["gif", "mp4"])
def test_a_failure_half_way_leaves_the_old_file_and_nothing_else(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a.{suffix}"
    path.write_bytes(b"old")

    def some() -> Iterator[np.ndarray]:
        yield from frames(3)
        raise RuntimeError("stop")

    with pytest.raises(RuntimeError, match="stop"):
        viewing.write_video(some(), path, 25.0)
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]
    assert path.read_bytes() == b"old"


def test_a_folder_that_cannot_be_made_is_an_output_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot write"):
        viewing.write_png(frames()[0], tmp_path / "file" / "a.png")


@pytest.mark.parametrize(
    ("module", "name"), [("PIL.Image", "a.gif"), ("imageio", "a.mp4"), ("imageio_ffmpeg", "a.mp4")]
)
def test_a_missing_package_names_the_extra(
    module: str, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(DependencyError, match=r'pip install "morphkit\[viewer\]"'):
        viewing.check_video_path(tmp_path / name)


@pytest.mark.usefixtures("gl")
def test_family_sheet_shows_every_body_to_one_scale(tmp_path: Path) -> None:
    image = pytest.importorskip("PIL.Image")
    pytest.importorskip("matplotlib")
    bodies = [FakeSimulation(box(height)) for height in (0.5, 0.6, 0.7)]
    sheet = viewing.family_sheet(bodies, tmp_path / "family.png", width=120, height=100)  # type: ignore[arg-type]
    picture = np.array(image.open(sheet).convert("RGB"))
    assert picture.shape == (260, 240, 3)
    red = redness(picture)
    quarters = [red[:130, :120], red[:130, 120:], red[130:, :120], red[130:, 120:]]
    shares = [quarter.mean() for quarter in quarters]
    assert shares[3] == 0
    assert min(shares[:3]) > 0.8 * max(shares[:3]) > 0.01


def test_a_family_sheet_of_nobody_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="at least one body"):
        viewing.family_sheet([], tmp_path / "family.png")


def test_viewing_imports_no_heavy_package() -> None:
    code = "import sys, morphkit.viewing; print({'mujoco', 'matplotlib', 'imageio', 'PIL', 'torch'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.strip() == "set()"


def test_the_temporary_file_keeps_the_ending(tmp_path: Path) -> None:
    seen: list[Path] = []

    def write(target: Path) -> None:
        seen.append(target)
        target.write_bytes(b"x")

    pictures.write_in_one_step(tmp_path / "a.mp4", write)
    assert seen[0].suffix == ".mp4"
    assert (tmp_path / "a.mp4").read_bytes() == b"x"
