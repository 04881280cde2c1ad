from __future__ import annotations

import json
import multiprocessing
from pathlib import Path

import pytest

from morphkit.ablation.ablate import Cutter
from morphkit.errors import AblationError, DescriptionError
from morphkit.families.manifest import read_manifest
from morphkit.families.scaled import Sampling, plan_scaled_family, scaled_variants
from morphkit.readers import read
from morphkit.registry import load, load_all
from morphkit.scaling.draw import ScaleRanges
from morphkit.simulation.build import build_simulation
from morphkit.utils import worker_pool
from morphkit_cli.main import run as morphkit

DOCS = Path(__file__).parents[4] / "docs"
SIZES = ("--scale", "length=0.8:1.2", "--scale", "mass=0.9:1.1", "--scale", "gain=0.5:2")


@pytest.fixture(autouse=True)
def forked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fork even while there are threads of a test runner."""
    monkeypatch.setattr(worker_pool, "_context", lambda: multiprocessing.get_context("fork"))


def content(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_the_manifest_holds_each_limbs_factors_and_mirror_images_share_theirs(tmp_path, capsys):
    assert morphkit(["ablate", "quadruped", *SIZES, "--samples", "2", "-o", str(tmp_path / "out")]) == 0
    assert "written" in capsys.readouterr().out
    first, second = read_manifest(tmp_path / "out").variants
    assert [first.name, second.name] == ["quadruped-scaled-1", "quadruped-scaled-2"]
    assert first.scaled != second.scaled
    for variant in (first, second):
        assert list(variant.scaled) == list(variant.limbs)
        for part in ("hip", "thigh", "calf"):
            assert variant.scaled[f"FL_{part}"] == variant.scaled[f"FR_{part}"] != variant.scaled[f"RL_{part}"]
            assert variant.scaled[f"RL_{part}"] == variant.scaled[f"RR_{part}"]
    entry = json.loads((tmp_path / "out/manifest.json").read_text())["variants"][0]
    assert entry["scaled"]["trunk"].keys() == {"length", "mass", "gain"}


def test_a_loaded_variant_has_servos_as_strong_as_its_limbs(tmp_path):
    folder = tmp_path / "out"
    assert morphkit(["ablate", "quadruped", "--scale", "gain=0.5:2", "--quiet", "-o", str(folder)]) == 0
    manifest = read_manifest(folder)
    (variant,) = load_all(folder)
    gains, source = build_simulation(variant).gains, manifest.info.gains
    factors = manifest.variants[0].scaled
    for limb in read(variant).limbs[1:]:
        (joint,) = limb.joints
        factor = factors[limb.name].gain
        assert tuple(gains[joint.name]) == pytest.approx([value * factor for value in source[joint.name]])
        assert load(folder / variant.file).info.gains[joint.name] == pytest.approx(tuple(gains[joint.name]))


def test_same_seed_same_bytes_whatever_jobs_and_limit(tmp_path):
    for name, more in (("one", ["--jobs", "1"]), ("two", ["--jobs", "2"]), ("seed", ["--seed", "1"])):
        arguments = ["ablate", "cheetah", "--all", *SIZES, "--limit", "5", "--quiet", "-o", str(tmp_path / name)]
        assert morphkit([*arguments, *more]) == 0
    assert content(tmp_path / "one") == content(tmp_path / "two")
    assert content(tmp_path / "one").keys() == content(tmp_path / "seed").keys()
    assert content(tmp_path / "one") != content(tmp_path / "seed")
    assert len(read_manifest(tmp_path / "one").variants) == 5
    alone = ["ablate", "cheetah", "--remove", "bfoot", *SIZES, "--quiet", "-o", str(tmp_path / "alone")]
    assert morphkit(alone) == 0
    name = "cheetah-no-bfoot-scaled-1.xml"
    assert content(tmp_path / "alone")[name] == content(tmp_path / "one")[name]


def test_all_with_scale_has_every_body_and_the_whole_robot_first():
    cutter = Cutter(load("cheetah"))
    plans = list(plan_scaled_family(cutter, Sampling(ScaleRanges(length=(0.9, 1.1)), samples=2)))
    assert len(plans) == 2 * 15
    assert [plan.name for plan in plans[:3]] == ["cheetah-scaled-1", "cheetah-scaled-2", "cheetah-no-bfoot-scaled-1"]
    few = list(plan_scaled_family(cutter, Sampling(ScaleRanges(), samples=2), max_limbs=3, limit=3))
    assert [len(plan.name.split("-")) for plan in few] == [len(few[0].name.split("-"))] * 3
    assert few[0].remove


def test_scaled_variants_cut_first(tmp_path):
    made = list(
        scaled_variants(load("quadruped"), ScaleRanges(length=(0.5, 2)), samples=2, remove=["FL_calf"], mirror=True)
    )
    assert [each.removed for each in made] == [("FL_calf", "FR_calf")] * 2
    assert all("FL_calf" not in each.scaled and "FL_thigh" in each.scaled for each in made)
    assert made[0].scaled != made[1].scaled


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--scale", "size=2"], "--scale size=2: expected WHAT=LOW:HIGH or WHAT=FACTOR"),
        (["--scale", "length=nan"], "expected WHAT=LOW:HIGH"),
        (["--scale", "length=1.2:0.8"], "length=1.2:0.8 is no range of factors: expected 0.01 <= low <= high <= 100"),
        (["--scale", "mass=0"], "mass=0:0 is no range of factors"),
        (["--scale", "mass=1", "--scale", "mass=2"], "mass is scaled already"),
        (["--scale", "mass=2", "--remove", "nothing"], "nothing"),
        (["--scale", "mass=2", "--samples", "0"], "--samples"),
        (["--remove", "ffoot", "--samples", "3"], "--samples goes with --scale"),
    ],
)
def test_bad_requests_are_one_error_and_write_nothing(options, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert morphkit(["ablate", "cheetah", *options]) == 2
    assert message in " ".join(capsys.readouterr().err.split())
    assert not any(tmp_path.iterdir())


def test_what_cannot_be_scaled_is_an_error_before_anything_is_written(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("r.xml").write_text(
        '<mujoco><worldbody><body name="a"><geom size="1"/><body name="b"><joint name="j"/><geom size="1"/>'
        '</body></body></worldbody><actuator><pid name="p" joint="j" kp="1"/></actuator></mujoco>'
    )
    assert morphkit(["ablate", "r.xml", "--scale", "gain=2"]) == 2
    assert "actuator 'p': the gains of a <pid> cannot be scaled" in " ".join(capsys.readouterr().err.split())
    assert [path.name for path in tmp_path.iterdir()] == ["r.xml"]


def test_a_manifest_with_factors_that_make_no_sense_is_refused(tmp_path):
    assert morphkit(["ablate", "cheetah", "--scale", "mass=2", "--quiet", "-o", str(tmp_path)]) == 0
    path = tmp_path / "manifest.json"
    path.write_text(path.read_text().replace('"mass": 2.0', '"mass": -2.0'))
    with pytest.raises(DescriptionError, match="factors of a limb"):
        read_manifest(tmp_path)


def test_the_documentation_shows_what_is_printed(tmp_path, monkeypatch, capsys):
    command = "ablate cheetah --scale length=0.8:1.2 --scale gain=0.9:1.3 --samples 3"
    shown = (DOCS / "ablation.md").read_text().split(f"{command}\n", 1)[1].split("```", 1)[0]
    monkeypatch.chdir(tmp_path)
    assert morphkit(command.split()) == 0
    assert capsys.readouterr().out == shown


def test_ranges_are_checked():
    with pytest.raises(AblationError, match="length=0:1"):
        ScaleRanges(length=(0, 1))
