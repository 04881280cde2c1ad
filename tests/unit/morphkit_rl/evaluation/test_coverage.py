"""How much of a robot a policy of a few steps knows."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from morphkit.registry import load
from morphkit_cli.main import run as morphkit
from morphkit_rl.algorithms.policy import Policy
from morphkit_rl.evaluation.coverage import coverage
from morphkit_rl.evaluation.evaluate import evaluate
from morphkit_rl.evaluation.model_card import evaluation_of
from morphkit_rl.runs import saved_policy
from morphkit_rl.training.trainer import train
from tests.support.run_folders import small_config


@pytest.fixture(scope="module")
def policy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A policy folder with measured returns on its three training bodies."""
    folder = tmp_path_factory.mktemp("coverage")
    bodies = [load(name) for name in ("hopper_3", "hopper_4", "hopper_5")]
    train(bodies, folder / "run", small_config(), steps=18)
    results, robots = evaluate(folder / "run", bodies, episodes=1), Policy.load(folder / "run").prepare(bodies)
    measured = evaluation_of(results, robots, 1, 0)
    saved_policy.save(saved_policy.load(folder / "run"), folder / "policy", {"evaluation.json": json.dumps(measured)})
    return folder / "policy"


def test_a_training_body_is_covered_and_predicted(policy: Path) -> None:
    found = coverage(policy, load("hopper_4"))
    assert all(match.trained and match.cosine == 1 and match.nearest == match.text for match in found.texts)
    assert [limb.trained for limb in found.limbs] == [limb.tokens for limb in found.limbs]
    assert (found.outside, found.notes) == ((), ())
    assert found.prediction is not None
    assert (found.prediction.calibrated_on, found.prediction.bodies) == ("leave-one-out", 3)


def test_measured_bodies_never_seen_calibrate_the_prediction(policy: Path, tmp_path: Path) -> None:
    shutil.copytree(policy, tmp_path / "policy")
    path = tmp_path / "policy" / "evaluation.json"
    measured = json.loads(path.read_text())
    row = {**measured["robots"][0], "trained_on": False}
    fins = [{**row, "robot": f"fins {n}", "actuators": {f"fin {m}": 1.0 for m in range(n)}} for n in (1, 2, 3)]
    path.write_text(json.dumps({**measured, "calibration": fins}))
    found = coverage(tmp_path / "policy", load("hopper_4")).prediction
    assert found is not None
    assert (found.calibrated_on, found.bodies) == ("held-out", 3)
    path.write_text(json.dumps({**measured, "robots": measured["robots"][:2]}))
    few = coverage(tmp_path / "policy", load("hopper_4"))
    assert (few.prediction, few.notes) == (None, ("no prediction: fewer than three training bodies were measured",))


def test_what_another_robot_has_besides_is_named(policy: Path) -> None:
    found = coverage(policy, load("quadruped"))
    assert not any(match.trained for match in found.texts)
    assert all(match.cosine < 0.999 for match in found.texts)
    outside = {each.what: (each.value, each.low, each.high) for each in found.outside}
    assert outside["limbs"] == (13, 3, 5)
    assert outside["actuators in all"] == (12, 2, 4)
    calf = next(match for match in found.texts if match.token == "FL_calf_position_z")
    assert calf.nearest.endswith("position z")


def test_the_command_prints_and_a_run_without_measured_returns_says_so(
    policy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert morphkit(["coverage", str(policy), "hopper_3"]) == 0
    text = capsys.readouterr().out
    assert text.startswith("hopper_3: 59 of 59 token texts are those of training\n")
    assert "leave-one-out errors over 3 training bodies" in text
    assert morphkit(["coverage", str(policy.with_name("run")), "cheetah", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["prediction"] is None
    (note,) = found["notes"]
    assert note.startswith("no prediction: nothing was measured of this policy")
    assert {each["what"] for each in found["outside"]} >= {"limbs", "mass of the heaviest limb in kg"}


def test_limbs_that_rest_are_listed(policy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    winged = tmp_path / "winged.xml"
    winged.write_bytes(load("hopper_5").source.replace(b'"lower_leg', b'"wing'))
    assert morphkit(["coverage", str(policy), str(winged), "--base", "planar", "--task", "hopper"]) == 0
    assert "limbs that rest, since training had none of their names: wing\n" in capsys.readouterr().out
    assert (
        morphkit(["evaluate", str(policy), str(winged), "--base", "planar", "--task", "hopper", "--episodes", "1"]) == 0
    )
    assert "winged: at rest, since training had none of their names: wing\n" in capsys.readouterr().err
    assert coverage(policy, load("cheetah")).rests == coverage(policy, load("hopper_5")).rests == ()


def test_a_name_of_several_lines_forges_none(policy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    hopper = load("hopper_3")
    forged = tmp_path / "a\n\nerror: forged.xml"
    forged.write_bytes(hopper.source)
    assert morphkit(["coverage", str(policy), str(forged), "--base", "planar", "--task", "hopper"]) == 0
    assert r"a\n\nerror: forged: 59 of 59" in capsys.readouterr().out.splitlines()[0]


def test_a_mirror_image_that_training_knew_better_is_what_counts(capsys: pytest.CaptureFixture[str]) -> None:
    """The shipped humanoids were trained without a right leg, but with no body that lacks the left one."""
    found, image = (coverage("zoo:humanoids", load(f"humanoid_2d_7_{side}_leg")) for side in ("left", "right"))
    assert (found.mirrored, image.mirrored) == (True, False)
    assert all(match.trained for match in found.texts)
    assert found.prediction is not None
    assert image.prediction is not None
    assert found.prediction.value == pytest.approx(image.prediction.value, abs=0.02)
    assert morphkit(["coverage", "zoo:humanoids", "humanoid_2d_7_left_leg"]) == 0
    assert "the policy acts as for the mirror image, which training knew better" in capsys.readouterr().out
    assert morphkit(["evaluate", "zoo:humanoids", "humanoid_2d_7_left_leg", "--episodes", "1"]) == 0
    assert "humanoid_2d_7_left_leg: the policy acted as for its mirror image" in capsys.readouterr().err
