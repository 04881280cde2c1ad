"""`morphkit show`: pictures, films, the tree with masses, and wrong usage."""

from __future__ import annotations

import socket
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from morphkit.errors import ConfigError
from morphkit.simulation.inspection_model import load_mechanics
from morphkit.viewer import joint_sweep
from morphkit_cli.main import run
from tests.support.small_robots import BOX, LINK, arm, mjcf, urdf


@pytest.mark.usefixtures("gl")
def test_portrait_shows_the_whole_robot() -> None:
    red = "<geom type='capsule' size='.05' fromto='0 0 0 0 0 2' rgba='1 0 0 1'/>"
    picture = joint_sweep.portrait(load_mechanics(mjcf(red)), width=120, height=90).astype(int)
    rows = np.nonzero((picture[..., 0] > 120) & (picture[..., 1] < 60))[0]
    assert 2 < rows.min() < 15
    assert rows.max() > 55


@pytest.mark.usefixtures("gl")
def test_a_film_has_a_caption_and_marks_what_moves(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(joint_sweep, "_FEWEST", 3)
    monkeypatch.setattr(joint_sweep, "_MOST", 3)
    mechanics = load_mechanics(arm(BOX.format("visual"), BOX.format("visual")))
    shots = joint_sweep.swing_shots(mechanics)
    assert [dial.name for dial, _ in shots] == ["ab"] * 3 + ["bc"] * 3
    frames = list(joint_sweep.film(mechanics, shots, width=120, height=100))
    assert {frame.shape for frame in frames} == {(100, 120, 3)}
    marked = [((f[:80, :, 0] > 200) & (f[:80, :, 1] < 150)).sum() for f in frames]
    assert min(marked) > 20
    assert not np.array_equal(frames[0][90:], frames[3][90:])


def test_nothing_to_swing_is_an_error() -> None:
    with pytest.raises(ConfigError, match="no joint to swing"):
        joint_sweep.swing_shots(load_mechanics(urdf(LINK.format("a", ""))))


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
    page = (Path(__file__).parents[3] / "docs" / "viewing.md").read_text(encoding="utf-8")
    shown = page.split(f"$ morphkit {' '.join(arguments)}\n", 1)[1].split("```", 1)[0]
    assert printed == shown.splitlines()
