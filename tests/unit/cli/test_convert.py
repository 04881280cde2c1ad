"""`morphkit convert`: what it writes and prints, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import mujoco
import pytest

import morphkit
from morphkit.conversion.convert import Conversion, convert
from morphkit.conversion.write import write_conversion
from morphkit.errors import ConfigError, OutputError
from morphkit_cli.main import run


def test_mjcf_is_one_already() -> None:
    with pytest.raises(ConfigError, match="MJCF model already"):
        convert(morphkit.load("cheetah"))


def test_output_is_not_overwritten(converted: tuple[Conversion, Path], tmp_path: Path) -> None:
    conversion, _ = converted
    (tmp_path / "out.xml").write_text("mine")
    with pytest.raises(OutputError, match="--force"):
        write_conversion(conversion, tmp_path / "out.xml")
    assert (tmp_path / "out.xml").read_text() == "mine"
    assert [path.name for path in tmp_path.iterdir()] == ["out.xml"]
    (tmp_path / "out_assets").mkdir()
    write_conversion(conversion, tmp_path / "out.xml", force=True)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.xml", "out_assets"]


def test_same_input_same_bytes(everything: Path, tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        write_conversion(convert(morphkit.load(everything)), tmp_path / name / "out.xml")
    assert (tmp_path / "a" / "out.xml").read_bytes() == (tmp_path / "b" / "out.xml").read_bytes()


def test_command(tmp_path: Path, everything: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "new" / "robot.xml"
    assert run(["convert", str(everything), str(out), "--base", "free", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    model = mujoco.MjModel.from_xml_path(str(out))
    assert told["base"] == "free"
    assert (told["bodies"], told["joints"], told["motors"]) == (model.nbody - 1, model.njnt, model.nu)
    assert told["mass"] == pytest.approx(model.body_mass.sum())
    assert told["assets"]
    assert all(Path(path).is_file() for path in told["assets"])
    assert {"kind": "gazebo", "name": "base"}.items() <= told["without_counterpart"][-1].items()
    assert run(["convert", str(everything), str(out)]) == 2
    assert "--force replaces it" in capsys.readouterr().err
    assert run(["convert", str(everything), str(out), "--force", "--no-floor"]) == 0
    text = capsys.readouterr().out
    assert "velocity limit" in text
    assert f"written: {out}" in text


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["cheetah", "out.xml"], "MJCF model already"),
        (["quadruped", "out.urdf"], "give out.xml"),
        (["no.urdf", "out.xml"], "no such file"),
    ],
)
def test_bad_input_leaves_nothing(
    arguments: list[str],
    expected: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(["convert", *arguments]) == 2
    assert expected in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_shown_conversion_is_what_is_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = (Path(__file__).parents[3] / "docs" / "convert.md").read_text("utf-8")
    monkeypatch.chdir(tmp_path)
    assert run(["convert", "quadruped", "quadruped.xml"]) == 0
    assert capsys.readouterr().out == page.split("quadruped.xml\n", 1)[1].split("```", 1)[0]
