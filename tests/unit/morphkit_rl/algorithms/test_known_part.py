"""Policies that act for the limbs whose names training had, while the others rest."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from morphkit.ablation.symmetry import other_side
from morphkit.registry import load
from morphkit.tokens.spec import TokenSpec
from morphkit_rl.algorithms.actions import ActionScale
from morphkit_rl.algorithms.known_part import known_part
from morphkit_rl.algorithms.mirror import mirror_signs
from morphkit_rl.benchmark.definition import load_benchmark
from morphkit_rl.config.augment_config import AugmentConfig
from morphkit_rl.config.train_config import load_config
from morphkit_rl.export.write import export_onnx
from morphkit_rl.runs import run_settings
from tests.support.networks import random_policy, spec

TRAINED = ("cheetah_3_front", "cheetah_4_allfront")


def texts(*names: str) -> set[str]:
    return {text for name in names for text in spec(name).texts}


def shape(tokens: TokenSpec) -> list[list[object]]:
    return [
        [(limb.name, limb.parent) for limb in tokens.limbs],
        [(sensor.index, sensor.text, sensor.limb) for sensor in tokens.sensors],
        [(actuator.index, actuator.text, actuator.limb) for actuator in tokens.actuators],
    ]


def test_what_is_left_is_the_body_without_the_limbs_that_rest() -> None:
    full = spec("cheetah_7_full")
    part = known_part(full, texts(*TRAINED))
    assert part is not None
    assert part.rests == ("bthigh", "bshin", "bfoot")
    assert shape(part.spec) == shape(spec("cheetah_4_allfront"))
    assert [full.sensors[i].name for i in part.sensors] == [sensor.name for sensor in part.spec.sensors]
    assert [full.actuators[i].name for i in part.actuators] == [actuator.name for actuator in part.spec.actuators]


def test_children_of_a_limb_that_rests_hang_on_its_parent() -> None:
    full = spec("cheetah_7_full")
    part = known_part(full, {text for text in full.texts if not text.startswith("bshin")})
    assert part is not None
    assert part.rests == ("bshin",)
    assert {limb.name: limb.parent for limb in part.spec.limbs}["bfoot"] == "bthigh"


def test_a_limb_with_one_text_of_training_acts() -> None:
    full = spec("cheetah_7_full")
    known = texts(*TRAINED) | {"bshin position x"}
    part = known_part(full, known)
    assert part is not None
    assert part.rests == ("bthigh", "bfoot")


@pytest.mark.parametrize("name", ["cheetah_2_front", "cheetah_4_allfront"])
def test_nothing_rests_of_a_body_of_known_limbs(name: str) -> None:
    assert known_part(spec(name), texts(*TRAINED)) is None


@pytest.mark.parametrize("name", ["cheetah_2_back", "cheetah_4_allback", "hopper", "quadruped"])
def test_a_foreign_robot_is_acted_for_as_a_whole(name: str) -> None:
    assert known_part(spec(name), texts(*TRAINED)) is None


def test_bodies_of_training_act_with_all_limbs() -> None:
    for split in load_benchmark().splits.values():
        for members in split.values():
            known = texts(*members.train)
            assert all(known_part(spec(name), known) is None for name in members.train)


@pytest.mark.parametrize("normalize", ["true", "false"])
def test_a_policy_acts_as_for_the_known_part_and_rests_elsewhere(normalize: str, tmp_path: Path) -> None:
    config = load_config("default", ["model.d_model=16", f"trainer.normalize={normalize}"])
    assert config.augment.rest_unseen
    resting, plain = (
        random_policy(replace(config, augment=augment), TRAINED)
        for augment in (AugmentConfig(rest_unseen=True), AugmentConfig())
    )
    robot, front = (run_settings.prepare_robot(config, load(name)) for name in ("cheetah_7_full", "cheetah_4_allfront"))
    full = robot.spec
    obs = np.random.default_rng(1).standard_normal((5, len(full.sensors))).astype("f4")
    columns = [[sensor.name for sensor in full.sensors].index(sensor.name) for sensor in front.spec.sensors]
    controls = resting.act(full, obs)
    known = [actuator.limb is not None and actuator.limb.startswith("f") for actuator in full.actuators]
    np.testing.assert_allclose(controls[:, known], plain.act(front.spec, obs[:, columns]), atol=1e-6)
    middle = ActionScale(full).center[np.logical_not(known)]
    np.testing.assert_array_equal(controls[:, np.logical_not(known)], np.tile(middle.astype("f4"), (5, 1)))
    assert resting.rests(full) == ("bthigh", "bshin", "bfoot")
    assert resting.rests(front.spec) == plain.rests(full) == ()
    assert np.abs(plain.act(full, obs) - controls).max() > 1e-4
    assert export_onnx(resting, robot, tmp_path / "policy.onnx") < 1e-5


def test_what_the_mirror_image_knows_does_not_rest() -> None:
    config = load_config("default", ["model.d_model=16"])
    policy = random_policy(config, ("humanoid_2d_7_left_arm", "humanoid_2d_7_lower_arms"))
    right_arm, full = (
        run_settings.prepare_robot(config, load(f"humanoid_2d_{name}")).spec for name in ("7_right_arm", "9_full")
    )
    assert policy.rests(right_arm) == ()
    assert policy.rests(full) == ("left_lower_arm",)


@pytest.mark.parametrize("normalize", ["true", "false"])
def test_the_known_part_of_a_mirrored_body_acts_as_its_image(normalize: str) -> None:
    config = load_config("default", ["model.d_model=16", f"trainer.normalize={normalize}"])
    policy = random_policy(config, ("humanoid_2d_7_right_leg",))
    left, right = (
        winged(run_settings.prepare_robot(config, load(f"humanoid_2d_7_{side}_leg")).spec, f"{other} lower arm")
        for side, other in (("left", "right"), ("right", "left"))
    )
    order, acts = (
        [[own.text for own in getattr(right, kind)].index(other_side(token.text)) for token in getattr(left, kind)]
        for kind in ("sensors", "actuators")
    )
    obs = np.random.default_rng(1).standard_normal((5, len(left.sensors))).astype("f4")
    mirrored = np.empty_like(obs)
    mirrored[:, order] = obs * mirror_signs(left)
    assert policy.rests(left) == ("right_lower_arm",)
    assert policy.rests(right) == ("left_lower_arm",)
    controls = policy.act(left, obs)
    assert np.ptp(controls, axis=0).max() > 1e-4
    np.testing.assert_allclose(controls, policy.act(right, mirrored)[:, acts], atol=1e-5)


def winged(tokens: TokenSpec, limb: str) -> TokenSpec:
    """The robot with another name for one of its limbs in all texts."""
    sensors, actuators = (
        tuple(replace(token, text=token.text.replace(limb, "wing")) for token in kind)
        for kind in (tokens.sensors, tokens.actuators)
    )
    return replace(tokens, sensors=sensors, actuators=actuators)
