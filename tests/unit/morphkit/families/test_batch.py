from __future__ import annotations

import json
import multiprocessing
import os
import signal
from dataclasses import replace
from pathlib import Path

import pytest

from morphkit.ablation.ablate import Cutter, Variant
from morphkit.description import Description
from morphkit.errors import DescriptionError
from morphkit.families.build import FailedVariant, MirroredVariant, check_variant, compile_problem, make
from morphkit.families.enumeration import Planned, plan_family, sub_morphologies
from morphkit.families.manifest import read_manifest
from morphkit.families.write import write_family
from morphkit.registry import load, load_all
from morphkit.simulation import build
from morphkit.utils import worker_pool
from morphkit_cli.main import run as morphkit


@pytest.fixture(autouse=True)
def forked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fork even while there are threads of a test runner, so that workers have what the tests put in place."""
    monkeypatch.setattr(worker_pool, "_context", lambda: multiprocessing.get_context("fork"))


@pytest.fixture
def crashing(monkeypatch: pytest.MonkeyPatch) -> None:
    """A simulator that crashes on one variant and refuses another."""
    compile_plain = build.compile_plain

    def fragile(description: Description) -> object:
        if description.name == "cheetah-no-ffoot":
            os.kill(os.getpid(), signal.SIGSEGV)
        if description.name == "cheetah-no-bshin":
            raise DescriptionError("MuJoCo does not like it")
        return compile_plain(description)

    monkeypatch.setattr(build, "compile_plain", fragile)


def content(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("robot", ["cheetah", "quadruped"])
def test_workers_make_what_one_process_makes(robot):
    cutter = Cutter(load(robot))
    made = list(make(cutter, plan_family(cutter, limit=8), jobs=2))
    assert made == list(sub_morphologies(load(robot), limit=8))


def test_same_bytes_whatever_jobs(tmp_path, capsys):
    for jobs in ("1", "2", "5"):
        arguments = ["ablate", "quadruped", "--all", "--limit", "12", "--skip-mirrored", "--jobs", jobs]
        assert morphkit([*arguments, "-o", str(tmp_path / jobs), "--quiet"]) == 0
    assert content(tmp_path / "1") == content(tmp_path / "2") == content(tmp_path / "5")
    assert read_manifest(tmp_path / "1").mirrored[0] == MirroredVariant(
        "quadruped-no-FR_calf", ("FR_calf",), "quadruped-no-FL_calf"
    )


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_a_crash_of_the_simulator_is_one_failed_variant(tmp_path, capsys, crashing, jobs):
    assert morphkit(["ablate", "cheetah", "--all", "--jobs", jobs, "-o", str(tmp_path / "out")]) == 1
    manifest = read_manifest(tmp_path / "out")
    assert len(manifest.variants) == 12
    assert manifest.failed == (
        FailedVariant("cheetah-no-ffoot", ("ffoot",), (), "the simulator crashed (SIGSEGV)"),
        FailedVariant("cheetah-no-bshin", ("bshin",), (), "MuJoCo does not like it"),
    )
    assert not (tmp_path / "out" / "cheetah-no-ffoot.xml").exists()
    printed = capsys.readouterr()
    assert "failed: cheetah-no-ffoot: the simulator crashed (SIGSEGV)\n" in printed.err
    assert "(12 variants and manifest.json)" in printed.out
    assert len(load_all(tmp_path / "out")) == 12


def test_a_single_variant_that_fails(tmp_path, capsys, crashing, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert morphkit(["ablate", "cheetah", "--remove", "ffoot"]) == 1
    assert read_manifest(tmp_path / "cheetah-no-ffoot").failed[0].name == "cheetah-no-ffoot"
    assert morphkit(["ablate", "cheetah", "--remove", "ffoot", "--no-compile"]) == 0
    assert len(load_all(tmp_path / "cheetah-no-ffoot")) == 1


BROKEN = b"""<mujoco><worldbody><body name="base"><freejoint/><geom size=".1"/>
<body name="arm"><joint/><geom size=".1" mass="0"/></body><body name="leg"><joint/><geom size=".1" mass="0"/></body>
</body></worldbody></mujoco>"""


@pytest.mark.parametrize("what", [["--all"], ["--remove", "arm"]])
def test_variants_of_a_robot_that_does_not_compile_are_written_with_an_error(tmp_path, capsys, what):
    (tmp_path / "r.xml").write_bytes(BROKEN)
    assert morphkit(["ablate", str(tmp_path / "r.xml"), *what, "-o", str(tmp_path / "out"), "-q"]) == 2
    manifest = read_manifest(tmp_path / "out")
    assert manifest.variants
    assert manifest.notes[0].startswith(
        "the variants were not compiled, because MuJoCo cannot compile the robot itself: "
    )
    assert capsys.readouterr().err == f"error: {manifest.notes[0]}\n"


def test_check_and_problem():
    cheetah = load("cheetah")
    assert compile_problem(cheetah) == ""
    variant = next(sub_morphologies(cheetah))
    assert check_variant(variant) is variant
    broken = replace(variant, description=Description("r", "r.xml", "mjcf", BROKEN))
    failed = check_variant(broken)
    assert isinstance(failed, FailedVariant)
    assert "mass and inertia" in failed.reason


def test_left_out_variants_keep_their_place():
    cutter = Cutter(load("cheetah"))
    plan = [
        Planned("a", ("bfoot",), mirrors="x"),
        Planned("b", ("bfoot",)),
        Planned("c", ("ffoot",), mirrors="b"),
        Planned("d", (), ("bshin",)),
        Planned("e", ("ffoot",), mirrors="d"),
    ]
    made = list(make(cutter, plan, jobs=2))
    assert [each.description.name if isinstance(each, Variant) else each.name for each in made] == list("abcde")
    assert isinstance(made[3], Variant)
    assert made[3].spliced == ("bshin",)


def test_a_dry_run_writes_nothing(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert morphkit(["ablate", "quadruped", "--remove", "FL_foot", "--splice", "RL_hip", "--dry-run"]) == 0
    printed = capsys.readouterr().out
    assert "│       └── FL_calf\n│           └── FL_foot (fixed)  ✗ removed\n" in printed
    assert "├── RL_hip                       ✗ spliced: its children move up\n" in printed
    assert "gazebo        FL_foot" in printed
    assert morphkit(["ablate", "cheetah", "--all", "--limit", "2", "--dry-run", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert [each["name"] for each in data["variants"]] == ["cheetah-no-bfoot", "cheetah-no-ffoot"]
    assert list(tmp_path.iterdir()) == []


def test_the_manifest_is_what_json_would_write(tmp_path):
    cutter = Cutter(load("cheetah"))
    failed = FailedVariant("odd", ("ffoot",), (), "why")
    path = write_family(
        cutter.description, [*sub_morphologies(load("cheetah"), limit=2), failed], tmp_path / "out", notes=["n"]
    )
    text = path.read_text(encoding="utf-8")
    assert text == json.dumps(json.loads(text), indent=2, ensure_ascii=False) + "\n"
    empty = write_family(cutter.description, [failed], tmp_path / "none").read_text(encoding="utf-8")
    assert empty == json.dumps(json.loads(empty), indent=2, ensure_ascii=False) + "\n"
    assert json.loads(empty)["variants"] == []
