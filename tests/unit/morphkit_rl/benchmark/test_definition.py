"""Tasks, splits and published returns against the reference, and files of one's own."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from morphkit.errors import ConfigError, UnknownNameError
from morphkit.registry import load, recipes
from morphkit_rl.benchmark.bodies import draw, gather_bodies, unseen_limbs
from morphkit_rl.benchmark.definition import Benchmark, load_benchmark
from morphkit_rl.benchmark.published import OVERALL, published_returns, published_steps

REFERENCE: dict[str, Any] = json.loads((Path(__file__).parents[3] / "data" / "benchmark_splits.json").read_text())
BODIES = [name for robot in ("cheetah", "walker", "humanoid_2d", "hopper") for name in recipes(robot)]


@pytest.fixture(scope="module")
def benchmark() -> Benchmark:
    return load_benchmark()


def test_tasks_equal_the_reference(benchmark: Benchmark) -> None:
    assert {task: list(groups) for task, groups in benchmark.tasks.items()} == REFERENCE["tasks"]
    assert list(benchmark.tasks) == list(REFERENCE["tasks"]), "the order of the panels"
    assert len(benchmark.tasks) == 8


@pytest.mark.parametrize("split", ["1", "2", "3"])
def test_splits_equal_the_reference_and_hold_every_body_once(benchmark: Benchmark, split: str) -> None:
    found = {g: {"train": list(s.train), "test": list(s.test)} for g, s in benchmark.splits[split].items()}
    assert found == REFERENCE["splits"][split]
    everything = [name for sets in benchmark.splits[split].values() for name in (*sets.train, *sets.test)]
    assert len(BODIES) == 32
    assert sorted(everything) == sorted(BODIES), "disjoint and complete"


@pytest.mark.parametrize(
    ("split", "limbs"),
    [
        ("1", ()),
        ("2", ("ffoot", "left3", "right3", "left_lower_arm")),
        ("3", ("bthigh", "bshin", "bfoot", "left3", "right2", "right3", "left_lower_arm")),
    ],
)
def test_limbs_that_a_policy_never_sees_in_training(benchmark: Benchmark, split: str, limbs: tuple[str, ...]) -> None:
    assert sum(unseen_limbs(benchmark, split).values(), ()) == limbs


def test_published_returns_equal_the_reference() -> None:
    number = 0
    for kind in ("train", "zero_shot"):
        for split, tasks in REFERENCE["published"][kind].items():
            for task, returns in tasks.items():
                expected = {method.replace("_", "-"): value for method, value in returns.items()}
                assert published_returns(kind, split.removeprefix("split"), task) == expected
                number += len(expected)
    assert number == 8 * 3 + 2 * 8 * 2 + 8 * 4 + 2 * 8 * 2
    assert published_steps() == 3_000_000
    assert published_returns("zero_shot", "1", "hoppers") == {}
    assert published_returns("zero_shot", "1", OVERALL)["ma-bert"] == 846
    assert published_returns("train", "mine", "cheetahs") == {}


def test_a_task_of_several_groups_has_the_robots_of_all(benchmark: Benchmark) -> None:
    bodies = gather_bodies(benchmark, "walker_humanoids_hopper", "1")
    assert len(bodies.train) == 4 + 6 + 3
    assert [each.name for each in bodies.test] == [
        *("walker_3_main", "walker_6_main", "humanoid_2d_7_left_leg", "humanoid_2d_8_right_knee")
    ]
    assert not bodies.validation


def test_validation_is_drawn_from_the_training_robots_and_the_same_in_every_task(benchmark: Benchmark) -> None:
    plain = gather_bodies(benchmark, "walker_humanoids_hopper", "1")
    bodies = gather_bodies(benchmark, "walker_humanoids_hopper", "1", validate=True)
    validation = {each.name for each in bodies.validation}
    assert len(validation) == 1 + 2 + 1, "a quarter of each group, at least one"
    assert {each.name for each in bodies.train} | validation == {each.name for each in plain.train}
    assert not validation & {each.name for each in (*bodies.train, *bodies.test)}
    assert {each.name for each in gather_bodies(benchmark, "walkers", "1", validate=True).validation} < validation
    assert gather_bodies(benchmark, "walker_humanoids_hopper", "1", validate=True).validation == bodies.validation


def test_a_draw_depends_on_names_and_key_only() -> None:
    names = [f"body_{number}" for number in range(12)]
    assert draw(names, "1/bodies") == draw(names[::-1], "1/bodies")
    assert len(draw(names, "1/bodies")) == 3
    assert len({draw(names, f"{split}/bodies") for split in range(20)}) > 10
    assert draw(names[:1], "1/bodies") == frozenset()


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "mine.toml"
    path.write_text(text)
    return path


def test_a_file_of_ones_own_adds_tasks_and_splits(tmp_path: Path) -> None:
    (tmp_path / "bodies").mkdir()
    (tmp_path / "bodies/stick.xml").write_bytes(load("hopper_3").source)
    path = write(
        tmp_path,
        """
        [tasks]
        jumpers = ["jumpers"]
        mixed = ["jumpers", "hoppers"]
        [splits.mine.jumpers]
        train = ["bodies/stick.xml"]
        test = ["walker_2_main"]
        [splits.mine.hoppers]
        train = ["hopper_4"]
        """,
    )
    own = load_benchmark(path)
    assert {"cheetahs", "jumpers", "mixed"} < set(own.tasks)
    assert own.splits["1"] == load_benchmark().splits["1"]
    assert set(own.splits["mine"]) == {"hoppers", "jumpers"}
    bodies = gather_bodies(own, "mixed", "mine")
    assert [each.name for each in bodies.train] == ["stick", "hopper_4"]
    assert [each.name for each in bodies.test] == ["walker_2_main"]
    with pytest.raises(UnknownNameError, match="split 'mine' has no cheetahs"):
        gather_bodies(own, "cheetahs", "mine")
    with pytest.raises(ConfigError, match="too few training robots"):
        gather_bodies(own, "jumpers", "mine", validate=True)


def test_a_body_on_both_sides_under_two_names_is_found(tmp_path: Path) -> None:
    (tmp_path / "copy.xml").write_bytes(load("hopper_3").source)
    path = write(tmp_path, "[splits.mine.hoppers]\ntrain = ['hopper_3']\ntest = ['copy.xml']\n")
    with pytest.raises(ConfigError, match="'copy' is held out, but trained on under the name 'hopper_3'"):
        gather_bodies(load_benchmark(path), "hoppers", "mine")
    (tmp_path / "hopper_3.xml").write_bytes(load("hopper_4").source)
    path = write(tmp_path, "[splits.mine.hoppers]\ntrain = ['hopper_3', 'hopper_3.xml']\n")
    with pytest.raises(ConfigError, match="two robots are called 'hopper_3'"):
        gather_bodies(load_benchmark(path), "hoppers", "mine")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("tasks = [", "not valid TOML"),
        ("task = {}", "unknown key 'task'; there is tasks, splits"),
        ("tasks = 3", "tasks is 3; expected a table"),
        ("[tasks]\nbig = 'walkers'", "expected a list of names"),
        ("[tasks]\nbig = []", "names no group"),
        ("[tasks]\nbig = ['walker']", "no split has a group 'walker'; did you mean 'walkers'"),
        ("[tasks]\ncheetahs = ['walkers']", "task 'cheetahs' is published and cannot be changed"),
        ("[splits.1.cheetahs]\ntrain = ['cheetah']", "split '1' is published"),
        ("[splits.'../x'.cheetahs]\ntrain = ['cheetah']", "split '../x': names have letters"),
        ("[splits.mine.cheetahs]\ntrain = []", "train is empty"),
        ("[splits.mine.cheetahs]\ntrain = ['cheetah']\ntset = []", "unknown key 'tset'; there is train, test"),
        ("[splits.mine.cheetahs]\ntrain = ['cheetah', 'cheetah']", "'cheetah' is listed twice"),
        ("[splits.mine.cheetahs]\ntrain = ['cheetah']\ntest = ['cheetah']", "in train and in test"),
        ("[splits]\nmine = 3", "splits.mine is 3; expected a table"),
    ],
)
def test_mistakes_in_a_file_are_named(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_benchmark(write(tmp_path, text))
    assert message in str(caught.value)
    assert "mine.toml" in str(caught.value)


def test_unknown_names_are_answered_with_the_nearest(benchmark: Benchmark, tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="no task 'cheetah'; did you mean 'cheetahs'"):
        gather_bodies(benchmark, "cheetah", "1")
    with pytest.raises(UnknownNameError, match="no split '4'; splits: 1, 2, 3"):
        gather_bodies(benchmark, "cheetahs", "4")
    with pytest.raises(ConfigError, match="cannot be read: No such file"):
        load_benchmark(tmp_path / "none.toml")
    path = write(tmp_path, "[splits.mine.cheetahs]\ntrain = ['cheetah_3_bak']\n")
    with pytest.raises(UnknownNameError, match="did you mean 'cheetah_3_back'"):
        gather_bodies(load_benchmark(path), "cheetahs", "mine")


def test_the_docs_show_the_tables_that_the_sets_give(benchmark: Benchmark) -> None:
    text = (Path(__file__).parents[4] / "docs" / "benchmark.md").read_text()
    for split, groups in benchmark.splits.items():
        first, *others = groups.values()
        sizes = [f"{len(first.train)} train, {len(first.test)} test"]
        sizes += [f"{len(sets.train)}, {len(sets.test)}" for sets in others]
        assert f"| {split} | {' | '.join(sizes)} |" in text
        unseen = [
            ", ".join(f"`{limb}`" for limb in limbs) for limbs in unseen_limbs(benchmark, split).values() if limbs
        ]
        assert f"| {split} | {'; '.join(unseen) or 'none'} |" in text
