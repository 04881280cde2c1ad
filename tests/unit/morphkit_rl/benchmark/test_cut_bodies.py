"""Bodies that are cut out of training robots."""

from __future__ import annotations

import pytest

from morphkit.errors import ConfigError
from morphkit.registry import load
from morphkit_rl.benchmark.bodies import gather_bodies
from morphkit_rl.benchmark.cut_bodies import cut_bodies
from morphkit_rl.benchmark.definition import load_benchmark


def names(bodies: object) -> list[str]:
    return [each.name for each in bodies]  # type: ignore[attr-defined]


def test_each_robot_in_turn_loses_the_fewest_limbs() -> None:
    train = [load("hopper_4"), load("hopper_5")]
    assert names(cut_bodies(train, [], 2)) == ["hopper_4-no-foot", "hopper_5-no-foot"]
    assert names(cut_bodies(train, [], 1)) == ["hopper_4-no-foot"]
    assert cut_bodies(train, [], 0) == []


def test_a_held_out_robot_is_not_cut_again_nor_is_its_mirror_image() -> None:
    full = [load("humanoid_2d_9_full")]
    free = names(cut_bodies(full, [], 3))
    assert free == ["humanoid_2d_9_full-no-right_shin", "humanoid_2d_9_full-no-right_lower_arm",
                    "humanoid_2d_9_full-no-right_thigh"]  # fmt: skip
    held_out = names(cut_bodies(full, [load("humanoid_2d_8_right_knee")], 3))
    assert "humanoid_2d_9_full-no-right_shin" not in held_out
    assert "humanoid_2d_9_full-no-left_shin" not in held_out


def test_a_task_gets_as_many_as_its_robots_have() -> None:
    benchmark = load_benchmark()
    bodies = gather_bodies(benchmark, "walker_humanoids", "1", cuts=4)
    assert names(bodies.cut)[:3] == ["walker_4_main-no-right1", "walker_7_main-no-left2", "walker_7_main-no-left1"]
    assert sum(name.startswith("humanoid") for name in names(bodies.cut)) == 4
    assert gather_bodies(benchmark, "walker_humanoids", "1").cut == ()
    with pytest.raises(ConfigError, match="no other body"):
        gather_bodies(benchmark, "cheetahs", "1", cuts=1)
