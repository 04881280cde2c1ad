"""How often a command parses XML: each source file once, and each file that it writes once, to check it."""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from lxml import etree

from morphkit_cli.main import run

LEG = (
    '<mujocoinclude><body name="leg"><joint name="hip"/><geom size=".1"/>'
    '<body name="foot"><joint name="ankle"/><geom size=".1"/></body></body></mujocoinclude>'
)
INCLUDING = (
    '<mujoco><worldbody><body name="torso"><freejoint/><geom size=".1"/><include file="leg.xml"/></body></worldbody>'
    '<actuator><motor joint="hip"/></actuator></mujoco>'
)
XACRO = (
    '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="arm"><xacro:property name="r" value="1"/>'
    '<link name="base"/><link name="hand"/><joint name="turn" type="continuous"><parent link="base"/>'
    '<child link="hand"/><axis xyz="0 0 ${r}"/></joint></robot>'
)


@pytest.fixture
def parses(monkeypatch: pytest.MonkeyPatch) -> Counter[bytes]:
    """How often lxml has parsed each text of this process."""
    counts: Counter[bytes] = Counter()
    real: Callable[..., Any] = etree.parse

    def parse(source: Any, *arguments: Any, **options: Any) -> Any:
        if isinstance(source, io.BytesIO):
            counts[source.getvalue()] += 1
        return real(source, *arguments, **options)

    monkeypatch.setattr("lxml.etree.parse", parse)
    return counts


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "leg.xml").write_text(LEG)
    (tmp_path / "main.xml").write_text(INCLUDING)
    (tmp_path / "arm.urdf.xacro").write_text(XACRO)
    monkeypatch.chdir(tmp_path)
    return tmp_path


SHIPPED = Path(__file__).parents[3] / "robots"
CHEETAH = SHIPPED / "cheetah" / "cheetah.xml"
QUADRUPED = SHIPPED / "quadruped" / "quadruped.urdf"


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("robot", [CHEETAH, QUADRUPED, Path("main.xml")], ids=lambda path: path.name)
@pytest.mark.parametrize(
    "command",
    [["tokens"], ["show"], ["check", "--quick"], ["diff"], ["ablate", "--all", "-o", "out"]],
    ids=lambda command: command[0],
)
def test_a_source_is_parsed_once(command: list[str], robot: Path, parses: Counter[bytes]) -> None:
    arguments = [str(robot)] * (2 if command[0] == "diff" else 1)
    assert run([command[0], *arguments, *command[1:]]) == 0
    assert parses[robot.read_bytes()] == 1
    if robot.name == "main.xml":
        assert parses[Path("leg.xml").read_bytes()] == 1


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("robot", ["cheetah", "quadruped", "main.xml"])
def test_a_variant_is_parsed_once_where_it_is_checked(robot: str, parses: Counter[bytes]) -> None:
    limb = {"cheetah": "bfoot", "quadruped": "FL_calf", "main.xml": "leg"}[robot]
    assert run(["ablate", robot, "--remove", limb, "-o", "out"]) == 0
    (variant,) = [path for path in Path("out").iterdir() if path.suffix in (".xml", ".urdf")]
    assert parses[variant.read_bytes()] == 1
    assert max(parses.values()) == 1


@pytest.mark.usefixtures("folder")
def test_a_conversion_parses_the_urdf_once(parses: Counter[bytes]) -> None:
    assert run(["convert", str(QUADRUPED), "out.xml"]) == 0
    assert parses[QUADRUPED.read_bytes()] == 1
    assert max(parses.values()) == 1


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("command", ["tokens", "check"])
def test_what_xacro_makes_is_parsed_once(command: str, parses: Counter[bytes]) -> None:
    pytest.importorskip("xacro")
    assert run([command, "arm.urdf.xacro"]) == 0
    assert max(parses.values()) == 1


def test_preparing_a_robot_for_training_parses_it_once(parses: Counter[bytes]) -> None:
    from morphkit.registry import load
    from morphkit_rl.envs.robot import prepare

    prepare(load(CHEETAH))
    assert parses[CHEETAH.read_bytes()] == 1
