"""The toolkit where the extra `rl` is not installed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import morphkit_rl

from .conftest import environment, listing

BLOCKER = """
import sys

class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {blocked}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Blocker())
"""
BLOCKED = set(morphkit_rl._EXTRA) - {"pydantic"}  # which typer needs too
PROGRAM = """
import contextlib, io, json, sys
from morphkit_cli.main import run

found = []
for words in json.loads(sys.argv[1]):
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = run(words)
    found.append((code, out.getvalue(), err.getvalue()))
try:
    import morphkit_rl
except ImportError as error:
    found.append((0, str(error), ""))
json.dump(found, sys.stdout)
"""


def run_without(folder: Path, *commands: str) -> list[tuple[int, str, str]]:
    """Run commands in one process in which, and in whose children, modules of the extra cannot be imported."""
    (folder / "site").mkdir()
    (folder / "site/sitecustomize.py").write_text(BLOCKER.format(blocked=BLOCKED))
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, json.dumps([command.split() for command in commands])],
        cwd=folder,
        env={**environment(), "PYTHONPATH": os.pathsep.join([str(folder / "site"), *sys.path])},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    return [(code, out, err) for code, out, err in json.loads(done.stdout)]


def test_the_toolkit_runs_and_learning_says_what_to_install(tmp_path: Path) -> None:
    toolkit = {
        "robots": "cheetah",
        "tokens cheetah": "7 limbs",
        "ablate cheetah --remove foot": "written: cheetah-no-foot/",
        "check planar_cheetah": "planar_cheetah.urdf: ",
        "convert planar_cheetah out.xml": "written: out.xml",
        "show out.xml": "front_foot_motor",
    }
    differ = "diff cheetah cheetah_3_balanced"
    learning = ("train hopper --run run", "evaluate run hopper", "benchmark robots", "benchmark status m")
    *found, imported = run_without(tmp_path, *toolkit, differ, *learning)
    for (command, shown), (code, out, err) in zip(toolkit.items(), found, strict=False):
        assert code == 0, (command, err)
        assert shown in out, command
    assert found[len(toolkit)][0] == 1, "they differ"
    for command, (code, out, err) in zip(learning, found[-len(learning) :], strict=True):
        assert (code, out) == (2, ""), command
        assert err.startswith("error: learning needs filelock, ")
        assert err.endswith('transformers: pip install "morphkit[rl]"\n')
        assert err.count("\n") == 1
    assert 'pip install "morphkit[rl]"' in imported[1]
    assert {name for name in listing(tmp_path) if not name.startswith("site")} == {
        *("cheetah-no-foot", "cheetah-no-foot/cheetah-no-foot.xml"),
        *("cheetah-no-foot/manifest.json", "out.xml"),
    }


def test_what_is_asked_for_is_what_the_extra_installs() -> None:
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
    named = {each.split(">")[0].split("=")[0].replace("-", "_") for each in project["optional-dependencies"]["rl"]}
    assert named == set(morphkit_rl._EXTRA)
