"""`morphkit robots`, `tokens` and `ablate` through the installed command."""

from __future__ import annotations

import csv
import hashlib
import json
import subprocess
import sys
import time
from collections.abc import Callable
from io import StringIO
from pathlib import Path

import pytest

from .conftest import COMMAND, Run, environment, listing

SHIPPED = ["arm", "cheetah", "hopper", "humanoid_2d", "planar_cheetah", "quadruped", "walker"]

COMMENTED = """<!-- first line -->
<mujoco model="tripod">
  <custom><text name="note" data="kept"/></custom>
  <worldbody>
    <body name="torso" pos="0 0 1"><!-- torso -->
      <freejoint/>
      <geom size="0.1"/>
      <body name="left" pos="0 1 0">
        <joint name="left_hinge" axis="0 1 0" range="-30 30"/>
        <geom size="0.1"/>
      </body>
      <body name="right" pos="0 -1 0"><!-- stays -->
        <joint name="right_hinge" axis="0 1 0" range="-30 30"/>
        <geom size="0.1"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="left_motor" joint="left_hinge" ctrlrange="-1 1"/>
    <motor name="right_motor" joint="right_hinge" ctrlrange="-1 1"/>
  </actuator>
</mujoco>
"""


def test_robots_are_listed(morphkit: Run) -> None:
    rows = json.loads(morphkit("robots", "--json").stdout)
    assert [row["name"] for row in rows] == SHIPPED
    assert all(row["description"] and row["license"] and row["source"] for row in rows)
    assert sum(len(row["recipes"]) for row in rows) == 32
    table = morphkit("robots").stdout
    for name in SHIPPED:
        assert f"\n{name}" in f"\n{table}"


@pytest.mark.parametrize("robot", SHIPPED)
def test_tokens_are_the_same_bytes_every_time(morphkit: Run, robot: str) -> None:
    first = morphkit("tokens", robot, "--format", "json").stdout
    assert morphkit("tokens", robot, "--format", "json").stdout == first
    spec = json.loads(first)
    assert [sensor["index"] for sensor in spec["sensors"]] == list(range(len(spec["sensors"])))


def test_tokens_in_a_file_equal_those_on_stdout(morphkit: Run, tmp_path: Path) -> None:
    for style in ("json", "csv", "table"):
        printed = morphkit("tokens", "arm", "--format", style).stdout
        done = morphkit("tokens", "arm", "--format", style, "--output", "out")
        assert done.stdout == ""
        assert "-> out" in done.stderr
        assert (tmp_path / "out").read_bytes() == printed.encode()


def test_csv_holds_every_token(morphkit: Run) -> None:
    spec = json.loads(morphkit("tokens", "cheetah", "--format", "json").stdout)
    rows = list(csv.DictReader(StringIO(morphkit("tokens", "cheetah", "--format", "csv").stdout)))
    names = {row["name"] for row in rows}
    assert names == {token["name"] for token in (*spec["sensors"], *spec["actuators"])}


def test_naming_options_change_the_names(morphkit: Run) -> None:
    raw = json.loads(morphkit("tokens", "cheetah", "--format", "json").stdout)
    plain = json.loads(morphkit("tokens", "cheetah", "--format", "json", "--naming", "canonical").stdout)
    underscored = json.loads(morphkit("tokens", "cheetah", "--format", "json", "--text-style", "raw").stdout)
    assert plain["naming"] == "canonical"
    assert {sensor["text"] for sensor in plain["sensors"]}.isdisjoint({s["text"] for s in raw["sensors"][19:]})
    assert [sensor["text"] for sensor in underscored["sensors"]] == [sensor["name"] for sensor in raw["sensors"]]


def test_pipe_that_closes_is_no_error(tmp_path: Path) -> None:
    done = subprocess.run(
        f"set -o pipefail; {COMMAND} tokens quadruped | head -n 1",
        shell=True,
        executable="/bin/bash",
        cwd=tmp_path,
        env=environment(),
        capture_output=True,
        text=True,
    )
    assert done.stderr == ""
    assert done.returncode == 0
    assert done.stdout.startswith("quadruped: ")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_full_disk_is_explained(tmp_path: Path) -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [COMMAND, "robots", "--json"],
            cwd=tmp_path,
            env=environment(),
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
        )
    assert done.returncode == 2
    assert done.stderr == "error: No space left on device\n"


@pytest.mark.parametrize("arguments", [["robots"], ["tokens", "quadruped"], ["ablate", "cheetah", "--all"]])
def test_toolkit_never_imports_torch(tmp_path: Path, arguments: list[str]) -> None:
    code = "import sys; from morphkit_cli.main import run; assert not run(sys.argv[1:]); print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments],
        cwd=tmp_path, env=environment(), capture_output=True, text=True, check=True,
    )  # fmt: skip
    modules = set(done.stdout.splitlines()[-1].split())
    assert "morphkit.registry" in modules
    assert not {"torch", "transformers", "gymnasium"} & modules


def test_variant_says_what_went(morphkit: Run, tmp_path: Path) -> None:
    (tmp_path / "tripod.xml").write_text(COMMENTED)
    printed = morphkit("ablate", "tripod.xml", "--remove", "lef*").stdout
    assert "remove 'lef*' matched: left\n" in printed
    assert "left_motor" in printed
    folder = tmp_path / "tripod-no-left"
    manifest = json.loads((folder / "manifest.json").read_text())
    (variant,) = manifest["variants"]
    source = (folder / variant["file"]).read_bytes()
    assert variant["sha256"] == hashlib.sha256(source).hexdigest()
    assert variant["removed"] == ["left"]
    assert variant["limbs"] == ["torso", "right"]
    assert {loss["name"] for loss in variant["lost"]} >= {"left_motor"}
    for kept in (b"<!-- first line -->", b"<!-- stays -->", b'data="kept"'):
        assert kept in source
    assert b"left" not in source.replace(b"tripod-no-left", b"")


def test_urdf_stays_a_urdf(morphkit: Run, tmp_path: Path) -> None:
    morphkit("ablate", "quadruped", "--remove", "*_foot", "--name", "stumps", "--quiet")
    assert (tmp_path / "stumps" / "stumps.urdf").read_bytes().count(b"_foot") == 0
    spec = json.loads(morphkit("tokens", "stumps/stumps.urdf", "--format", "json").stdout)
    assert spec["source"]["format"] == "urdf"
    assert len(spec["actuators"]) == 12


def test_family_of_the_cheetah(morphkit: Run, tmp_path: Path) -> None:
    manifest = json.loads(morphkit("ablate", "cheetah", "--all", "--json").stdout)
    assert manifest["folder"] == "cheetah-family"
    assert len(manifest["variants"]) == 14
    assert len({variant["sha256"] for variant in manifest["variants"]}) == 14
    files = {variant["file"] for variant in manifest["variants"]}
    assert listing(tmp_path / "cheetah-family") == files | {"manifest.json"}
    few = json.loads(morphkit("ablate", "cheetah", "--all", "--json", "--max-limbs", 3, "-o", "few").stdout)
    assert {len(variant["limbs"]) for variant in few["variants"]} == {2, 3}
    one = json.loads(morphkit("ablate", "cheetah", "--all", "--json", "--limit", 1, "-o", "one").stdout)
    assert one["variants"] == manifest["variants"][:1]


def test_families_are_the_same_bytes_every_time(morphkit: Run, tmp_path: Path) -> None:
    for folder in ("first", "second"):
        morphkit("ablate", "hopper", "--all", "--output", folder, "--quiet")
    assert listing(tmp_path / "first") == listing(tmp_path / "second")
    for name in listing(tmp_path / "first"):
        assert (tmp_path / "first" / name).read_bytes() == (tmp_path / "second" / name).read_bytes()


def test_variants_keep_what_the_robot_says(morphkit: Run) -> None:
    morphkit("ablate", "cheetah", "--remove", "ffoot", "--quiet")
    full = json.loads(morphkit("tokens", "cheetah", "--format", "json", "--naming", "canonical").stdout)
    less = json.loads(
        morphkit("tokens", "cheetah-no-ffoot/cheetah-no-ffoot.xml", "--format", "json", "--naming", "canonical").stdout
    )
    assert (less["family"], less["task"], less["base"]) == (full["family"], full["task"], full["base"])
    assert {sensor["text"] for sensor in less["sensors"]} < {sensor["text"] for sensor in full["sensors"]}


def test_a_film_that_sigterm_stops_leaves_nothing(
    start: Callable[..., subprocess.Popen[bytes]], tmp_path: Path
) -> None:
    process = start("show", "cheetah", "--gif", "film.mp4")
    while not listing(tmp_path):
        if process.poll() == 2:
            pytest.skip("no OpenGL, or no ffmpeg")
        assert process.poll() is None
        time.sleep(0.02)
    process.terminate()
    assert process.wait(60) == 143
    assert listing(tmp_path) == set()
