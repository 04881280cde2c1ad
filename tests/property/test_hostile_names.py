"""Names that would steer a terminal: every command over a robot of such names prints none of them raw."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.text import Text

from morphkit.utils.printable import one_line, printable
from morphkit_cli import terminal
from morphkit_cli.common import print_json
from morphkit_cli.main import run
from morphkit_cli.progress import ProgressDisplay
from morphkit_cli.table import table
from morphkit_cli.train import _report
from morphkit_rl.training.progress import Progress, TrainSummary
from tests.support.command_output import refuse_raw

TRICKS = ("\x9b31m", "\u202e", "\u2066", "\u200b", "\n\nerror: forged", "\u2028", "\r", "\t", "\x85", "\x7f")
"""Those that XML can hold; ESC it cannot."""
IN_FILE_NAMES = ("\x1b[31m", "\x1b]0;title\x07", "\n\nerror: forged", "\u202e", "\udc9b")
ROBOTS = ("mjcf", "urdf")


def escaped(name: str) -> str:
    """A name in an XML attribute, where newlines have to be written as numbers."""
    return "".join(f"&#{ord(each)};" if ord(each) < 160 and not each.isalnum() else each for each in name)


def names(*parts: str) -> dict[str, str]:
    return {part: escaped(part + "".join(TRICKS)) for part in parts}


def mjcf() -> str:
    n = names("torso", "leg", "hip", "motor", "pad", "eye", "foot", "ankle")
    foot = f'<body name="{n["foot"]}"><joint name="{n["ankle"]}"/><geom size=".1"/></body>'
    leg = (
        f'<body name="{n["leg"]}"><joint name="{n["hip"]}"/><geom size=".1"/><body name="{n["pad"]}"><geom size=".1"/>'
        f"</body>{foot}</body>"
    )
    return (
        f'<mujoco><worldbody><body name="{n["torso"]}"><geom size=".1"/>{leg}</body></worldbody>'
        f'<actuator><motor name="{n["motor"]}" joint="{n["hip"]}"/></actuator>'
        f'<sensor><jointpos name="{n["eye"]}" joint="{n["hip"]}"/></sensor></mujoco>'
    )


def urdf() -> str:
    n = names("torso", "leg", "foot", "hip", "ankle", "package", "material", "gazebo")
    inertial = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    mesh = f'<visual><geometry><mesh filename="package://{n["package"]}/m.stl"/></geometry></visual>'
    links = "".join(f'<link name="{n[each]}">{inertial}{mesh}</link>' for each in ("torso", "leg", "foot"))
    joints = "".join(
        f'<joint name="{n[joint]}" type="revolute"><parent link="{n[parent]}"/><child link="{n[child]}"/>'
        '<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="5" velocity="5"/></joint>'
        for joint, parent, child in (("hip", "torso", "leg"), ("ankle", "leg", "foot"))
    )
    return f'<robot name="{n["torso"]}">{links}{joints}<gazebo reference="{n["gazebo"]}"/></robot>'


def commands(robot: str, foot: str, out: str) -> list[list[str]]:
    return [
        ["tokens", robot],
        ["tokens", robot, "--format", "json"],
        ["tokens", robot, "--root", foot],
        ["show", robot],
        ["check", robot],
        ["check", robot, "--quick", "--output", "sarif"],
        ["ablate", robot, "--remove", foot, "--dry-run"],
        ["ablate", robot, "--remove", foot, "--name", "cut", "--output", f"{out}/cut"],
        ["ablate", robot, "--all", "--no-compile", "--limit", "1", "--output", f"{out}/family"],
        ["ablate", robot, "--remove", foot + "x"],
        ["diff", robot, robot],
        ["convert", robot, f"{out}/converted.xml"],
    ]


def further_commands(robot: str, foot: str, out: str) -> list[list[str]]:
    """Those that do not ask for the format."""
    return [
        ["diff", robot, "hopper"],
        ["train", robot, "--run", f"{out}/run", "--hold-out", foot],
        ["train", robot, "--run", f"{out}/run", "--set", f"model.{foot}=1"],
        ["evaluate", f"{out}/none{foot}", robot],
        ["benchmark", "status", f"{out}/none{foot}"],
    ]


@pytest.mark.parametrize("kind", ROBOTS)
def test_no_command_prints_them_raw(kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    robot = tmp_path / f"r{''.join(IN_FILE_NAMES)}.{'xml' if kind == 'mjcf' else 'urdf'}"
    robot.write_text(mjcf() if kind == "mjcf" else urdf())
    foot = "foot" + "".join(TRICKS)
    wanted = commands(str(robot), foot, str(tmp_path))
    if kind == "mjcf":
        wanted += further_commands(str(robot), foot, str(tmp_path))
    for command in wanted:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            code = run(command)
        captured = capsys.readouterr()
        assert code in (0, 1, 2), command
        assert captured.out + captured.err, command
        if captured.out and command[-1] in ("json", "sarif"):
            json.loads(captured.out)
        refuse_raw(captured.out + captured.err, command)


@given(st.text(), st.text())
def test_what_is_printed(one: str, other: str) -> None:
    refuse_raw(printable(one))
    assert "\n" not in one_line(one)
    refuse_raw(table(("a", "b"), [(one, other)], fold=True, width=40))
    if one.isprintable():
        assert printable(one) == one_line(one) == one


def test_progress_and_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    name = "body" + "".join((*TRICKS, *IN_FILE_NAMES))
    with ProgressDisplay(f"training on {name}") as display:
        display.update(Progress(10, 5, 31.0, None, 0.5, 1.0, 1.0, {name: 1.0, "other": 2.0}, {}))
    summary = TrainSummary(tmp_path / name, 10, 10, 5, 31.0, {name: 1.0}, {}, 1, False)
    _report(summary, [name], None, as_json=False, quiet=False)
    captured = capsys.readouterr()
    assert "body" in captured.out
    assert "body" in captured.err
    refuse_raw(captured.out + captured.err)


def test_rich_text_and_warnings(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    terminal.show(Text("\x1b[31mred\u202e"))
    monkeypatch.setattr(warnings, "formatwarning", warnings.formatwarning)
    terminal.guard_warnings()
    shown: Callable[..., str] = warnings.formatwarning
    refuse_raw(capsys.readouterr().out + shown("a\x9b", UserWarning, "file", 1))


def test_json_has_its_own_escapes(capsys: pytest.CaptureFixture[str]) -> None:
    name = "".join((*TRICKS, *IN_FILE_NAMES))
    print_json({name: name})
    printed = capsys.readouterr().out
    refuse_raw(printed)
    assert json.loads(printed) == {name: name}
