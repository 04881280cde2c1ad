"""Every bad input: one clear message on stderr, exit code 2, and no output left behind."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from .conftest import Run, listing

INERTIAL = (
    '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    '<collision><geometry><sphere radius="0.1"/></geometry></collision>'
)


def joint(name: str, parent: str, child: str) -> str:
    return (
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        '<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>\n'
    )


def urdf(links: list[str], *joints: str) -> str:
    body = "".join(f'<link name="{link}">{INERTIAL}</link>\n' for link in links)
    return f'<robot name="r">\n{body}{"".join(joints)}</robot>\n'


FILES = {
    "empty file": ("empty.xml", "", "empty"),
    "not XML": ("robot.xml", "this is no XML", "robot.xml:1"),
    "binary": ("robot.urdf", "\x00\x01\x02", "robot.urdf"),
    "cut short": ("robot.xml", "<mujoco>\n<worldbody>\n<body", "robot.xml:3"),
    "other root element": ("robot.xml", "<html></html>", "html"),
    "no body": ("robot.xml", "<mujoco><worldbody/></mujoco>", "body"),
    "missing parent link": ("r.urdf", urdf(["a", "b"], joint("j", "ghost", "b")), "ghost"),
    "missing child link": ("r.urdf", urdf(["a", "b"], joint("j", "a", "ghost")), "ghost"),
    "cycle": (
        "r.urdf",
        urdf(["a", "b", "c"], joint("i", "a", "b"), joint("j", "b", "c"), joint("k", "c", "b")),
        "b",
    ),
    "closed cycle without a root": ("r.urdf", urdf(["a", "b"], joint("i", "a", "b"), joint("j", "b", "a")), "cycle"),
    "two links of one name": ("r.urdf", urdf(["a", "b", "b"], joint("j", "a", "b")), "r.urdf:4"),
    "two bodies of one name": (
        "robot.xml",
        '<mujoco><worldbody><body name="a"><geom size="1"/>\n<body name="b"><joint/><geom size="1"/></body>\n'
        '<body name="b"><joint/><geom size="1"/></body></body></worldbody></mujoco>',
        "robot.xml:3",
    ),
    "several roots": ("r.urdf", urdf(["a", "b"]), "--root"),
    "entity expansion": (
        "robot.xml",
        '<!DOCTYPE mujoco [<!ENTITY a "aaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]>\n'
        '<mujoco model="&b;"><worldbody><body name="t"><geom size="1"/></body></worldbody></mujoco>',
        "entit",
    ),
    "external entity": (
        "robot.xml",
        '<!DOCTYPE mujoco [<!ENTITY secret SYSTEM "file:///etc/hostname">]>\n'
        "<mujoco><worldbody><body name='t'><geom size='1'/>&secret;</body></worldbody></mujoco>",
        "entit",
    ),
    "missing include": (
        "robot.xml",
        '<mujoco><include file="nowhere.xml"/><worldbody><body name="t"><geom size="1"/></body></worldbody></mujoco>',
        "nowhere.xml",
    ),
    "include that leaves the folder": (
        "robot.xml",
        '<mujoco><include file="../../etc/hostname"/><worldbody><body name="t"/></worldbody></mujoco>',
        "../../etc/hostname",
    ),
}


@pytest.mark.parametrize("case", FILES)
@pytest.mark.parametrize("command", ["tokens", "ablate"])
def test_bad_file(in_process: Run, tmp_path: Path, command: str, case: str) -> None:
    name, text, expected = FILES[case]
    (tmp_path / name).write_text(text)
    cut = ["--all"] if command == "ablate" else []
    done = in_process(command, name, *cut, "--output", "out", code=2)
    assert done.stdout == ""
    assert done.stderr.startswith("error: ")
    assert expected.lower() in done.stderr.lower()
    assert listing(tmp_path) == {name}


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["tokens", "chetah"], "cheetah"),
        (["tokens", "nowhere/robot.urdf"], "nowhere/robot.urdf"),
        (["ablate", "cheetah", "--remove", "ffot"], "ffoot"),
        (["ablate", "cheetah", "--splice", "fshn"], "fshin"),
        (["ablate", "cheetah", "--remove", "x*"], "bthigh"),
        (["ablate", "cheetah", "--remove", "torso"], "root"),
        (["ablate", "cheetah", "--splice", "torso"], "root"),
        (["ablate", "cheetah", "--remove", "*"], "root"),
        (["ablate", "cheetah", "--all", "--min-limbs", "9"], "--min-limbs"),
        (["ablate", "cheetah", "--remove", "ffoot", "--name", "../escape"], "escape"),
        (["ablate", "cheetah", "--remove", "ffoot", "--output", "/proc/nowhere"], "/proc/nowhere"),
        (["tokens", "cheetah", "--output", "nowhere/tokens.json"], "nowhere"),
        (["tokens", "cheetah", "--root", "nose"], "nose"),
    ],
)
def test_bad_request(in_process: Run, tmp_path: Path, arguments: list[str], expected: str) -> None:
    done = in_process(*arguments, code=2)
    assert done.stdout == ""
    assert done.stderr.startswith("error: ")
    assert expected in done.stderr
    assert listing(tmp_path) == set()
    assert not (tmp_path.parent / "escape").exists()


def test_the_installed_command_says_the_same(morphkit: Run, in_process: Run, tmp_path: Path) -> None:
    (tmp_path / "robot.xml").write_text("this is no XML")
    arguments = ("ablate", "robot.xml", "--all", "--output", "out")
    installed, here = morphkit(*arguments, code=2), in_process(*arguments, code=2)
    assert (installed.stdout, installed.stderr) == (here.stdout, here.stderr)


def test_folder_that_holds_other_files_is_kept(in_process: Run, tmp_path: Path) -> None:
    (tmp_path / "family").mkdir()
    (tmp_path / "family" / "thesis.tex").write_text("years of work")
    done = in_process("ablate", "cheetah", "--all", "--output", "family", code=2)
    assert done.stderr.startswith("error: ")
    assert "family" in done.stderr
    assert listing(tmp_path) == {"family", "family/thesis.tex"}


def test_file_in_the_place_of_the_folder_is_kept(in_process: Run, tmp_path: Path) -> None:
    (tmp_path / "family").write_text("years of work")
    assert in_process("ablate", "cheetah", "--all", "--output", "family", code=2).stderr.startswith("error: ")
    assert (tmp_path / "family").read_text() == "years of work"


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_unwritable_folder(morphkit: Run, tmp_path: Path) -> None:
    (tmp_path / "locked").mkdir(mode=0o555)
    done = morphkit("ablate", "cheetah", "--all", "--output", "locked/family", code=2)
    assert done.stderr.startswith("error: ")
    assert listing(tmp_path / "locked") == set()


def test_missing_mesh_where_it_is_needed(in_process: Run, tmp_path: Path) -> None:
    robot = urdf(["a", "b"], joint("j", "a", "b")).replace(
        '<sphere radius="0.1"/>', '<mesh filename="meshes/arm.stl"/>'
    )
    (tmp_path / "r.urdf").write_text(robot)
    in_process("tokens", "r.urdf")  # names and limits need no mesh
    done = in_process("train", "r.urdf", "--run", "run", "--steps", 10, code=2)
    assert done.stderr.startswith("error: ")
    assert "arm.stl" in done.stderr
    assert not (tmp_path / "run").exists()


def test_robot_without_actuators_cannot_be_trained(in_process: Run, tmp_path: Path) -> None:
    (tmp_path / "rag.xml").write_text(
        '<mujoco><worldbody><body name="torso"><freejoint/><geom size="0.1"/>'
        '<body name="arm"><joint name="hinge" axis="0 1 0"/><geom size="0.1"/></body></body></worldbody></mujoco>'
    )
    assert "no actuators" in in_process("tokens", "rag.xml").stdout
    done = in_process("train", "rag.xml", "--run", "run", "--steps", 10, code=2)
    assert done.stderr.startswith("error: ")
    assert "actuator" in done.stderr
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["evaluate", "nowhere", "cheetah"], "nowhere"),
        (["evaluate", "nowhere", "cheetah", "--video", "missing/film.mp4"], "missing"),
        (["train", "--run", "nowhere", "--resume"], "nowhere"),
        (["train", "cheetah", "--run", "run", "--hold-out", "chetah", "--steps", "10"], "cheetah"),
        (["train", "cheetah", "--run", "run", "--preset", "defult", "--steps", "10"], "default"),
        (["train", "cheetah", "--run", "run", "--preset", "", "--steps", "10"], "no preset ''"),
        (["train", "cheetah", "--run", "run", "--set", "td3.tua=0.1", "--steps", "10"], "tau"),
        (["train", "cheetah", "--run", "run", "--set", "td3.tau", "--steps", "10"], "td3.tau"),
        (["train", "cheetah", "--run", "run", "--task", "locomotoin", "--steps", "10"], "locomotion"),
    ],
)
def test_bad_learning_request(in_process: Run, tmp_path: Path, arguments: list[str], expected: str) -> None:
    done = in_process(*arguments, code=2)
    assert done.stdout == ""
    assert "error: " in done.stderr
    assert expected in done.stderr
    assert listing(tmp_path) == set()


@pytest.mark.parametrize(
    "arguments",
    [["convert", "quadruped", "{}/out.xml"], ["train", "cheetah", "--run", "{}/run"], ["tokens", "{}/robot.urdf"]],
)
def test_names_that_are_no_text(in_process: Run, tmp_path: Path, arguments: list[str]) -> None:
    folder = tmp_path / os.fsdecode(b"caf\xe9")
    try:
        folder.mkdir()
    except OSError:
        pytest.skip("the file system takes UTF-8 only")
    (folder / "robot.urdf").write_text("<robot/>")
    done = in_process(*[argument.format(folder) for argument in arguments], code=2)
    assert done.stderr.startswith("error: ")
    assert "caf" in done.stderr or "robot.urdf" in done.stderr
    assert [path.name for path in folder.iterdir()] == ["robot.urdf"]


def test_a_robot_whose_name_is_no_text(in_process: Run, tmp_path: Path) -> None:
    name = os.fsdecode(b"caf\xe9.urdf")
    try:
        (tmp_path / name).write_text(urdf(["a", "b"], joint("j", "a", "b")))
    except OSError:
        pytest.skip("the file system takes UTF-8 only")
    for arguments in (["tokens"], ["show"], ["check"], ["ablate", "--remove", "b", "--dry-run"], ["diff", name]):
        assert in_process(*arguments, name).stdout


def test_output_that_lacks_a_character(morphkit: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONIOENCODING", "latin-1")
    assert "cheetah" in morphkit("robots").stdout
