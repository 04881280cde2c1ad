"""Cells of a matrix: plans, states, conflicts and the lock."""

from __future__ import annotations

import json
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from morphkit.errors import CheckpointError, ConfigError, OutputError, UnknownNameError
from morphkit_rl.benchmark.cells import CELL, Cell, create, read_cell, read_matrix
from morphkit_rl.benchmark.definition import load_benchmark
from morphkit_rl.benchmark.methods import EVALUATE_STEPS, method_config, preset_of
from morphkit_rl.benchmark.planning import plan_matrix
from morphkit_rl.config.train_config import load_config, presets
from morphkit_rl.runs.lock import hold, owner
from tests.support.benchmark_matrix import make_matrix

HOPPERS = {"tasks": ["hoppers"], "splits": ["1"], "methods": ["limb-former"], "seeds": 2}


def test_a_matrix_is_every_combination_with_the_first_seeds_first() -> None:
    plans = plan_matrix(
        load_benchmark(), tasks=["hoppers", "walkers"], splits=["1", "2"], methods=["limb-former"], seeds=2
    )
    assert len(plans) == 2 * 2 * 2
    assert [plan.cell.seed for plan in plans] == [0] * 4 + [1] * 4
    assert plans[0].steps == 3_000_000
    assert plans[0].episodes == 10
    assert plans[0].config.trainer.evaluate_steps == EVALUATE_STEPS
    assert plan_matrix(load_benchmark(), **HOPPERS, minutes=3.0)[0].steps is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"methods": ["limb-fromer"]}, "no method or preset 'limb-fromer'; did you mean 'limb-former'"),
        ({"tasks": ["hopper"]}, "did you mean 'hoppers'"),
        ({"splits": ["4"]}, "no split '4'"),
        ({"preset": "defualt"}, "no preset 'defualt'"),
        ({"overrides": ["td3.taux=1"]}, "did you mean 'tau'"),
        ({"methods": ["limb-former", "default"], "preset": "default"}, "--preset goes with a single method"),
        ({"seeds": 0}, "at least one"),
    ],
)
def test_plans_that_make_no_sense_are_refused(change: dict, message: str) -> None:
    with pytest.raises((ConfigError, UnknownNameError)) as caught:
        plan_matrix(load_benchmark(), **{**HOPPERS, **change})
    assert message in str(caught.value)


def test_a_method_takes_its_own_preset_and_a_preset_is_a_method() -> None:
    assert preset_of("limb-former") == "default"
    for preset in presets():
        assert preset_of(preset) == preset
        if preset.endswith("-paper"):
            assert preset_of(preset.removesuffix("-paper")) == preset
            assert method_config(preset, "1").td3.exploration_noise == 0.126
            assert method_config(preset, "2").td3.exploration_noise == 0.2
            models = [method_config(preset, split).model for split in "123"]
            if preset in ("ma-bert-paper", "anymorph-paper"):
                assert [model.hidden for model in models] == [False, False, True]
            else:
                assert models[0] == models[1] == models[2] == load_config(preset).model
            assert method_config(preset, "1", overrides=["td3.exploration_noise=0.5"]).td3.exploration_noise == 0.5
    assert method_config("limb-former", "1") == method_config("limb-former", "2")


def test_few_bodies_get_as_many_environments_as_in_train() -> None:
    config, preset = method_config("limb-former", "2"), load_config("default")
    for robots in (1, 2, 12):
        assert config.for_robots(robots).trainer.num_envs == preset.for_robots(robots).trainer.num_envs
    assert config.for_robots(2).trainer.num_envs == 64


def test_a_method_without_limb_types_observes_all_else() -> None:
    with_types, without = method_config("limb-former", "1"), method_config("limb-former-no-ltv", "1")
    assert with_types.trainer.sensors == ()
    assert without.trainer.sensors == ("no_ltv",)
    assert without.model == with_types.model


def test_a_preset_of_another_method_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "other.toml"
    path.write_text("[model]\nmethod = 'smp'\n")
    with pytest.raises(ConfigError, match="is for method 'smp', not for 'limb-former'"):
        method_config("limb-former", "1", preset=str(path))


def test_states_of_cells(tmp_path: Path) -> None:
    states = {
        ("hoppers", "limb-former", 1): "stopped",
        ("hoppers", "limb-former", 2): "failed",
        ("hoppers", "limb-former", 3): "not started",
        ("hoppers", "limb-former", 4): "running",
    }
    plans = make_matrix(tmp_path / "m", tasks=["hoppers"], seeds=5, states=states)
    with hold(plans[4].cell.folder(tmp_path / "m")) as ours:
        assert ours
        found = read_matrix(tmp_path / "m")
    assert [each.state for each in found] == ["done", "stopped", "failed", "not started", "running"]
    assert [each.cell for each in found] == [plan.cell for plan in plans]
    assert found[2].detail == "RuntimeError: out of memory"
    assert found[4].detail.startswith("process ")
    assert found[0].result is not None
    assert read_cell(plans[4].cell.folder(tmp_path / "m")).state == "stopped"


def test_a_cell_from_before_a_setting_came_has_its_default(tmp_path: Path) -> None:
    plans = plan_matrix(load_benchmark(), **HOPPERS)
    create(plans, tmp_path)
    path = plans[0].cell.folder(tmp_path) / "cell.json"
    values = json.loads(path.read_text())
    assert values["config"]["trainer"].pop("keep") == "last"
    path.write_text(json.dumps(values))
    create(plans, tmp_path)
    with pytest.raises(ConfigError, match=r'trainer\.keep is "last" there, not 2'):
        create(plan_matrix(load_benchmark(), **{**HOPPERS, "overrides": ["trainer.keep=2"]}), tmp_path)


def test_a_cell_with_other_settings_is_refused_and_nothing_is_written(tmp_path: Path) -> None:
    matrix = tmp_path / "m"
    create(plan_matrix(load_benchmark(), **HOPPERS), matrix)
    create(plan_matrix(load_benchmark(), **{**HOPPERS, "seeds": 3}), matrix)
    before = sorted(matrix.rglob("*"))
    for change, message in (
        ({"overrides": ["td3.tau=0.5"]}, "td3.tau is 0.02 there, not 0.5"),
        ({"steps": 5}, "steps is 3000000 there, not 5"),
        ({"validate": True}, "some of its cells meet the test set"),
    ):
        plans = plan_matrix(load_benchmark(), **{**HOPPERS, "seeds": 4, **change})
        with pytest.raises(ConfigError) as caught:
            create(plans, matrix)
        assert message in str(caught.value)
        assert sorted(matrix.rglob("*")) == before


def test_a_matrix_that_several_begin_at_once_is_whole(tmp_path: Path) -> None:
    plans = plan_matrix(load_benchmark(), **{**HOPPERS, "seeds": 12})
    with ThreadPoolExecutor(8) as pool:
        for done in [pool.submit(create, plans, tmp_path / "m") for _ in range(8)]:
            done.result()
    assert [each.state for each in read_matrix(tmp_path / "m")] == ["not started"] * 12


@pytest.mark.parametrize(
    ("key", "value"), [("split", "3"), ("task", "../../a"), ("method", "\x1b[31m"), ("method", ""), ("seed", 7)]
)
def test_a_cell_is_called_as_its_folder(key: str, value: object, tmp_path: Path) -> None:
    make_matrix(tmp_path, tasks=["hoppers"], seeds=1)
    (file,) = tmp_path.rglob(CELL)
    file.write_text(json.dumps({**json.loads(file.read_text()), key: value}))
    with pytest.raises(CheckpointError, match="damaged"):
        read_matrix(tmp_path)


def test_damaged_and_empty_matrices_are_named(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match="no such folder"):
        read_matrix(tmp_path / "none")
    with pytest.raises(CheckpointError, match="holds no cells"):
        read_matrix(tmp_path)
    plans = make_matrix(tmp_path / "m", tasks=["hoppers"], seeds=1)
    path = plans[0].cell.folder(tmp_path / "m") / CELL
    path.write_text(path.read_text()[:50])
    with pytest.raises(CheckpointError, match=r"cell\.json: damaged"):
        read_matrix(tmp_path / "m")
    path.write_text("{}")
    with pytest.raises(CheckpointError, match=r"cell\.json: damaged: it has no 'split'"):
        read_matrix(tmp_path / "m")


HOLDER = """
import sys, time
from pathlib import Path
from morphkit_rl.runs.lock import hold
with hold(Path(sys.argv[1])) as ours:
    print(ours, flush=True)
    time.sleep(60)
"""


def test_a_lock_dies_with_its_process(tmp_path: Path) -> None:
    process = subprocess.Popen([sys.executable, "-c", HOLDER, tmp_path], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "True\n"
        note, alive = owner(tmp_path)
        assert note is not None
        assert (note.pid, alive) == (process.pid, True)
        with hold(tmp_path) as ours:
            assert not ours
        assert owner(tmp_path) == (note, True), "who could not have it must not disturb who has it"
    finally:
        process.kill()
        process.wait()
    assert owner(tmp_path) == (note, False), "stale: the note is there, the process is not"
    with hold(tmp_path) as ours:
        assert ours
    assert owner(tmp_path) == (None, False)


def test_a_file_system_without_locks_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise NotImplementedError("FileSystem does not appear to support flock")

    monkeypatch.setattr("filelock.FileLock.acquire", refuse)
    with pytest.raises(OutputError, match="without locks"), hold(tmp_path):
        pass


def test_a_damaged_note_is_no_owner(tmp_path: Path) -> None:
    (tmp_path / "owner.json").write_text("{")
    assert owner(tmp_path) == (None, False)
    with hold(tmp_path) as ours:
        assert ours


def test_plan_says_all_that_determines_a_cell(tmp_path: Path) -> None:
    plan = plan_matrix(load_benchmark(), **{**HOPPERS, "tasks": ["walkers"]}, validate=True)[0]
    values = json.loads(json.dumps(plan.to_json()))
    assert set(values["train"]) | set(values["validation"]) == set(load_benchmark().splits["1"]["walkers"].train)
    assert set(values["test"]) == {"walker_3_main", "walker_6_main"}
    assert values["config"]["model"]["method"] == "limb-former"
    assert plan.cell == Cell("1", "walkers", "limb-former", 0)
