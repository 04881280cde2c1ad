"""Token lists of the shipped robots, byte for byte; `MORPHKIT_REGENERATE=1 pytest tests/golden` writes them anew."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from morphkit.readers import read
from morphkit.registry import load, shipped
from morphkit.tokens.spec import Naming, TokenSpec, token_spec

FOLDER = Path(__file__).parent / "tokens"
NAMINGS: tuple[Naming, ...] = ("raw", "canonical")
ROBOTS = [description.name for description in shipped()]


def path_of(robot: str, naming: Naming) -> Path:
    return FOLDER / f"{robot}.{naming}.json"


@pytest.mark.parametrize("naming", NAMINGS)
@pytest.mark.parametrize("robot", ROBOTS)
def test_tokens_are_those_on_file(robot: str, naming: Naming) -> None:
    description = load(robot)
    text = token_spec(read(description), naming=naming, canonical=description.info.canonical).to_json()
    path = path_of(robot, naming)
    if os.environ.get("MORPHKIT_REGENERATE"):
        FOLDER.mkdir(exist_ok=True)
        path.write_text(text, "utf-8")
    assert path.is_file(), f"no golden file; {__doc__}"
    assert text == path.read_text("utf-8"), f"if the change is meant: {__doc__}"


def test_no_golden_file_is_left_over() -> None:
    assert {path.name for path in FOLDER.iterdir()} == {path_of(r, n).name for r in ROBOTS for n in NAMINGS}


def spec(robot: str, naming: Naming = "raw") -> TokenSpec:
    return TokenSpec.from_json(path_of(robot, naming).read_text("utf-8"))


@pytest.mark.parametrize(
    ("robot", "limbs", "sensors", "actuators"),
    [
        ("cheetah", 7, 133, 6),
        ("walker", 7, 133, 6),
        ("humanoid_2d", 9, 171, 8),
        ("hopper", 5, 95, 4),
        ("quadruped", 13, 247, 12),
        ("planar_cheetah", 7, 133, 6),
    ],
)
def test_golden_files_have_nineteen_scalars_a_limb_of_one_joint(
    robot: str, limbs: int, sensors: int, actuators: int
) -> None:
    for naming in NAMINGS:
        found = spec(robot, naming)
        assert (len(found.limbs), len(found.sensors), len(found.actuators)) == (limbs, sensors, actuators)


def test_golden_arm_has_a_limb_of_two_joints_and_an_actuator_without_a_limb() -> None:
    arm = spec("arm")
    assert max(len(limb.joints) for limb in arm.limbs) == 2
    assert None in [actuator.limb for actuator in arm.actuators]
    assert len(arm.sensors) != 19 * len(arm.limbs)


@pytest.mark.parametrize(
    ("robot", "names"),
    [
        (
            "cheetah",
            ["torso", "back thigh", "back shin", "back foot", "front thigh", "front shin", "front foot"],
        ),
        ("walker", ["torso", "left thigh", "left shin", "left foot", "right thigh", "right shin", "right foot"]),
    ],
)
def test_golden_canonical_names_of_limbs(robot: str, names: list[str]) -> None:
    found = spec(robot, "canonical")
    assert [s.text.removesuffix(" position x") for s in found.sensors if s.name.endswith("_position_x")] == names
