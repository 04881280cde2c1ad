"""Policies that act for a body as for its mirror image."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from morphkit.ablation.symmetry import other_side
from morphkit.registry import load
from morphkit_rl.algorithms.mirror import better_known, mirror_image
from morphkit_rl.benchmark.definition import load_benchmark
from morphkit_rl.config.augment_config import AugmentConfig
from morphkit_rl.config.train_config import load_config
from morphkit_rl.runs import run_settings
from tests.support.networks import random_policy, spec

ACROSS = {
    *(("position", "y"), ("translational_velocity", "y")),
    *(("rotational_velocity", "x"), ("rotational_velocity", "z"), ("exponential_map", "x"), ("exponential_map", "z")),
}
TRAINED = ("humanoid_2d_7_right_leg", "humanoid_2d_9_full")


def bodies(*names: str) -> list[set[str]]:
    return [set(spec(name).texts) for name in names]


@pytest.mark.parametrize(
    ("name", "mirrored"),
    [
        ("humanoid_2d_7_right_leg", False),
        ("humanoid_2d_7_left_leg", True),
        ("humanoid_2d_9_full", False),
        ("humanoid_2d_8_right_knee", True),
        ("humanoid_2d_8_left_knee", False),
        ("cheetah_7_full", False),
        ("quadruped", False),
    ],
)
def test_the_image_counts_where_training_knew_it_better(name: str, mirrored: bool) -> None:
    own = spec(name)
    chosen = better_known(own, bodies(*load_benchmark().splits["1"]["humanoids"].train))
    assert chosen == (mirror_image(own) if mirrored else own)
    assert better_known(own, []) is own


def test_what_training_had_stays_as_it_is() -> None:
    benchmark = load_benchmark()
    for split in benchmark.splits.values():
        for members in split.values():
            for name in members.train:
                own = spec(name)
                assert better_known(own, bodies(*members.train)) is own


@pytest.mark.parametrize("normalize", ["true", "false"])
def test_a_policy_acts_for_a_body_as_for_its_image(normalize: str) -> None:
    config = load_config("default", ["model.d_model=16", f"trainer.normalize={normalize}"])
    assert config.augment.mirror_unseen
    mirroring, plain = (
        random_policy(replace(config, augment=augment), TRAINED)
        for augment in (AugmentConfig(mirror_unseen=True), AugmentConfig())
    )
    left, right = (
        run_settings.prepare_robot(config, load(f"humanoid_2d_7_{side}_leg")).spec for side in ("left", "right")
    )
    order = [[own.text for own in right.sensors].index(other_side(sensor.text)) for sensor in left.sensors]
    acts = [[own.text for own in right.actuators].index(other_side(own.text)) for own in left.actuators]
    obs = np.random.default_rng(1).standard_normal((5, len(left.sensors))).astype("f4")
    sign = [-1 if (sensor.quantity, sensor.component) in ACROSS else 1 for sensor in left.sensors]
    mirrored = np.empty_like(obs)
    mirrored[:, order] = obs * np.array(sign, np.float32)
    np.testing.assert_allclose(mirroring.act(left, obs), mirroring.act(right, mirrored)[:, acts], atol=1e-5)
    np.testing.assert_array_equal(plain.act(right, mirrored), mirroring.act(right, mirrored))
    assert np.abs(plain.act(left, obs) - mirroring.act(left, obs)).max() > 1e-4
