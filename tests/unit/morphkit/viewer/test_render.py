"""Pictures of simulated robots: what they show, from where, and how large."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from morphkit.description import Description
from morphkit.errors import ConfigError
from morphkit.viewer.media import family_sheet
from morphkit.viewer.render import model_frames, render
from tests.support.walking_box import WALKING_BOX, box


@dataclass
class FakeSimulation:
    """What pictures take of a simulation."""

    model: Any
    base: str = "planar"
    limb_body: np.ndarray = field(default_factory=lambda: np.array([1]))
    description: Description = field(default_factory=lambda: Description("box", "box.xml", "mjcf", b""))

    @property
    def start(self) -> np.ndarray:
        return np.array(self.model.qpos0)


def redness(picture: np.ndarray) -> np.ndarray:
    """Where the red box is, bool, shape (height, width)."""
    red, green, blue = np.moveaxis(picture.astype(int), -1, 0)
    return (red > 90) & (green < red / 2) & (blue < red / 2)


@pytest.mark.usefixtures("gl")
def test_pictures_have_the_asked_for_shape_and_show_the_robot() -> None:
    frames = render(FakeSimulation(box()), np.zeros((2, 2)), width=64, height=48)  # type: ignore[arg-type]
    assert frames.shape == (2, 48, 64, 3)
    assert frames.dtype == np.uint8
    assert redness(frames[0]).mean() > 0.02
    start = render(FakeSimulation(box()), width=64, height=48)  # type: ignore[arg-type]
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
@pytest.mark.parametrize("texrepeat", ['texuniform="true" texrepeat="1 1"', 'texrepeat="18 18"'])
def test_a_floor_with_a_pattern_goes_on_where_its_drawing_would_end(texrepeat: str) -> None:
    assets = f"""<asset>
        <texture name="t" type="2d" builtin="checker" rgb1="0 .9 0" rgb2="0 .5 0" width="64" height="64"/>
        <material name="m" texture="t" {texrepeat}/></asset>"""
    floor = '<geom type="plane" size="9 9 1" material="m"/>'
    source = WALKING_BOX.format(floor=floor, height=0.5).replace("<worldbody>", f"{assets}<worldbody>")
    model = mujoco.MjModel.from_xml_string(source)
    here, there = model_frames(model, np.array([[0, 0], [60, 0]]), base="planar", width=96, height=72)
    for picture in (here, there):
        red, green, blue = np.moveaxis(picture[-16:].astype(int), -1, 0)
        assert ((green > 1.5 * red) & (green > 1.5 * blue)).mean() > 0.8
    assert np.abs(here[-16:].astype(int) - there[-16:]).mean() < 6  # 60 m on, the same squares lie there


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
        assert redness(render(simulation, width=64, height=48)[0]).any() == shows_red  # type: ignore[arg-type]


@pytest.mark.usefixtures("gl")
def test_family_sheet_shows_every_body_to_one_scale(tmp_path: Path) -> None:
    image = pytest.importorskip("PIL.Image")
    pytest.importorskip("matplotlib")
    bodies = [FakeSimulation(box(height)) for height in (0.5, 0.6, 0.7)]
    sheet = family_sheet(bodies, tmp_path / "family.png", width=120, height=100)  # type: ignore[arg-type]
    picture = np.array(image.open(sheet).convert("RGB"))
    assert picture.shape == (260, 240, 3)
    red = redness(picture)
    quarters = [red[:130, :120], red[:130, 120:], red[130:, :120], red[130:, 120:]]
    shares = [quarter.mean() for quarter in quarters]
    assert shares[3] == 0
    assert min(shares[:3]) > 0.8 * max(shares[:3]) > 0.01


def test_a_family_sheet_of_nobody_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="at least one body"):
        family_sheet([], tmp_path / "family.png")
