from __future__ import annotations

import errno
import json
import shlex
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

import morphkit.registry
from morphkit.errors import OutputError, UnknownNameError
from morphkit_cli import common, progress
from morphkit_cli.main import run
from morphkit_cli.table import table


def raising(error: BaseException):
    def shipped():
        raise error

    return shipped


def test_error_of_the_user_is_one_message_and_exit_2(monkeypatch, capsys):
    monkeypatch.setattr(morphkit.registry, "shipped", raising(UnknownNameError("no robot is called x")))
    assert run(["robots"]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err == "error: no robot is called x\n"


def test_lack_of_memory_is_one_message(monkeypatch, capsys):
    monkeypatch.setattr(morphkit.registry, "shipped", raising(MemoryError("Unable to allocate 9 PiB")))
    assert run(["robots"]) == 2
    assert capsys.readouterr().err == "error: not enough memory: Unable to allocate 9 PiB\n"


def test_operating_system_error_names_the_file(monkeypatch, capfd):
    monkeypatch.setattr(morphkit.registry, "shipped", raising(OSError(errno.ENOSPC, "No space left on device", "a/b")))
    monkeypatch.setattr("morphkit_cli.main._drop_stdout", lambda: None)
    assert run(["robots"]) == 2
    assert capfd.readouterr().err == "error: a/b: No space left on device\n"


def test_keyboard_interrupt_is_130(monkeypatch, capsys):
    monkeypatch.setattr(morphkit.registry, "shipped", raising(KeyboardInterrupt()))
    assert run(["robots"]) == 130
    assert capsys.readouterr().err.strip() == "interrupted"


def test_bug_is_not_hidden(monkeypatch):
    monkeypatch.setattr(morphkit.registry, "shipped", raising(ZeroDivisionError("a bug")))
    with pytest.raises(ZeroDivisionError):
        run(["robots"])


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["tokns"], "Did you mean 'tokens'"),
        (["tokens"], "Missing argument 'ROBOT'"),
        (["tokens", "cheetah", "--format", "xml"], "'xml' is not one of 'table', 'json', 'csv'"),
        (["tokens", "cheetah", "--json", "--format", "csv"], "only one of json and csv"),
        (["tokens", "cheetah", "--naming", "odd"], "'odd' is not one of 'raw', 'canonical'"),
        (["ablate", "cheetah"], "say what to cut"),
        (["ablate", "cheetah", "--all", "--remove", "ffoot"], "leave out --remove"),
        (["ablate", "cheetah", "--all", "--limit", "0"], "--limit"),
        (["ablate", "cheetah", "--all", "--mirror"], "leave out --remove, --splice, --keep, --mirror and --name"),
        (["ablate", "cheetah", "--remove", "ffoot", "--skip-mirrored"], "--skip-mirrored goes with --all"),
        (["ablate", "cheetah", "--remove", "ffoot", "--jobs", "0"], "--jobs"),
        (["ablate", "cheetah", "--remove", "ffoot", "--assets", "link"], "--assets"),
        (["train", "--run", "somewhere"], "say what to train on"),
        (["train", "cheetah"], "Missing option '--run'"),
        (["train", "cheetah", "--run", "somewhere", "--resume", "--seed", "0"], "leave out ROBOT, --seed"),
        (["evaluate", "somewhere", "cheetah", "--video", "film.avi"], ".mp4 or .gif"),
        (["robots", "--colour"], "No such option"),
    ],
)
def test_wrong_usage_is_explained(arguments, expected, capsys):
    assert run(arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("error: ")
    assert expected in captured.err
    assert "--help'." in captured.err


@pytest.mark.parametrize(
    "command",
    [
        "robots",
        "tokens",
        "ablate",
        "check",
        "convert",
        "coverage",
        "diff",
        "show",
        "train",
        "evaluate",
        "export",
        "push",
        "zoo",
    ],
)
def test_help_has_examples(command, capsys):
    assert run([command, "--help"]) == 0
    assert f"morphkit {command}" in capsys.readouterr().out.split("Examples:")[1]


def test_bodies_of_one_name_are_one_body_unless_they_include_other_files(tmp_path):
    includes = '<mujoco><include file="limbs.xml"/></mujoco>'
    plain = '<mujoco><worldbody><body name="a"/></worldbody></mujoco>'
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "same.xml").write_text(plain)
        (tmp_path / folder / "robot.xml").write_text(includes)
    files = [[str(tmp_path / folder / name) for folder in ("one", "two")] for name in ("same.xml", "robot.xml")]
    assert len(common.load_bodies(files[0])) == 1
    assert len(common.load_bodies([files[1][0], f"{tmp_path}/two/../one/robot.xml"])) == 1
    with pytest.raises(UnknownNameError, match="two different bodies are called robot"):
        common.load_bodies(files[1])


def test_the_command_that_training_points_to_works(tmp_path, capsys):
    variant = tmp_path / "my robots" / "one.xml"
    variant.parent.mkdir()
    variant.write_bytes(morphkit.registry.load("hopper_3").source)
    tiny = ("model.d_model=8", "model.layers=1", "model.feedforward=8", "td3.batch_size=4", "trainer.num_envs=1")
    settings = [word for setting in tiny for word in ("--set", setting)]
    training = ["hopper_3", str(variant), "--hold-out", "one", "--run", str(tmp_path / "a run"), "--steps", "4"]
    assert run(["train", *training, *settings]) == 0
    hint = capsys.readouterr().err.splitlines()[-1]
    assert hint.startswith("next: morphkit evaluate ")
    assert run([*shlex.split(hint)[2:], "--episodes", "1", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["robots"]
    assert {row["robot"]: row["trained_on"] for row in found} == {"hopper_3": True, "one": False}


def test_version(capsys):
    assert run(["--version"]) == 0
    assert capsys.readouterr().out.startswith("morphkit ")


def test_help_imports_nothing_heavy():
    code = "import sys; from morphkit_cli.main import run; run(['--help']); print(*sys.modules)"
    modules = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "morphkit_cli.main" in modules
    assert not {"numpy", "mujoco", "torch", "lxml.etree", "yourdfpy"} & set(modules)


def test_file_is_written_whole_or_not_at_all(tmp_path, monkeypatch):
    path = tmp_path / "tokens.json"
    common.write_text(path, "old")

    def fail(self: Path, target: Path) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises(OutputError, match="No space left"):
        common.write_text(path, "new")
    assert path.read_text() == "old"
    assert [item.name for item in tmp_path.iterdir()] == ["tokens.json"]


def test_written_file_has_the_usual_permissions(tmp_path):
    plain = tmp_path / "plain"
    plain.write_text("")
    common.write_text(tmp_path / "ours", "")
    assert (tmp_path / "ours").stat().st_mode == plain.stat().st_mode


@pytest.mark.parametrize("target", ["missing/tokens.json", "."])
def test_unwritable_output_is_explained(tmp_path, target):
    with pytest.raises(OutputError, match=r"missing|folder"):
        common.write_text(tmp_path / target, "text")


def test_json_has_no_infinite_numbers(capsys):
    common.print_json({"a": [float("inf"), float("nan"), 1.5], "b": ("x", None)})
    assert json.loads(capsys.readouterr().out) == {"a": [None, None, 1.5], "b": ["x", None]}


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.4, "0 s"), (59.6, "1 min 00 s"), (200, "3 min 20 s"), (7505, "2 h 05 min")]
)
def test_duration(seconds, text):
    assert common.duration(seconds) == text


def test_count_knows_the_plural():
    assert [common.count(n, word) for n, word in ((1, "body"), (2, "body"), (0, "limb"))] == [
        "1 body",
        "2 bodies",
        "0 limbs",
    ]


def test_two_bodies_of_one_name_are_refused(tmp_path):
    model = '<mujoco><worldbody><body name="torso"><joint axis="{} 0 0"/><geom size="1"/></body></worldbody></mujoco>'
    for axis in (0, 1):
        (tmp_path / str(axis)).mkdir()
        (tmp_path / str(axis) / "robot.xml").write_text(model.format(axis + 1))
    targets = [str(tmp_path / "0" / "robot.xml"), str(tmp_path / "1" / "robot.xml")]
    assert len(common.load_bodies([targets[0], targets[0]])) == 1
    with pytest.raises(UnknownNameError, match="two different bodies"):
        common.load_bodies(targets)


def sample_progress(**changes):
    values = {
        "steps": 12_345,
        "updates": 840,
        "elapsed_s": 130.0,
        "remaining_s": 350.0,
        "fraction": 0.27,
        "steps_per_s": 1499.6,
        "updates_per_s": 31.2,
        "returns": {"a": 10.0, "b": 30.0, "c": 20.0},
        "first_returns": {},
    }
    return SimpleNamespace(**{**values, **changes})


def test_progress_in_words():
    assert (
        progress.rates(sample_progress()) == "12 345 steps (1 500/s), 840 updates (31/s), 2 min 10 s, 5 min 50 s left"
    )
    assert progress.rates(sample_progress(remaining_s=None)).endswith("2 min 10 s")
    assert progress.returns(sample_progress()) == "mean return 20, from 10 (a) to 30 (b)"
    young = sample_progress(returns={"a": 10.0, "b": 30.0}, first_returns={"c": 60.0})
    assert progress.returns(young) == "mean return 33, from 10 (a) to 60 (c); of first, shorter episodes, scaled up"
    assert progress.returns(sample_progress(returns={})) == "no episode has ended yet"


def test_progress_outside_a_terminal_is_a_line_now_and_then(capsys):
    with progress.ProgressDisplay("training on 3 bodies") as display:
        for second in range(0, 70, 10):
            display.update(sample_progress(elapsed_s=float(second)))
    captured = capsys.readouterr()
    assert captured.out == ""
    title, *lines = captured.err.splitlines()
    assert title == "training on 3 bodies"
    assert len(lines) == 3


def test_quiet_progress_says_nothing(capsys):
    with progress.ProgressDisplay("training", quiet=True) as display:
        display.update(sample_progress())
    assert capsys.readouterr().err == ""


ROWS = [("a", "1", "short"), ("bcd", "22", "a long text that has to be folded somewhere")]


def test_table_keeps_rows_whole_without_a_width():
    assert table(("name", "n", "text"), ROWS, right=["n"]).splitlines() == [
        "name   n  text",
        "─" * 53,
        "a      1  short",
        "bcd   22  a long text that has to be folded somewhere",
    ]


def test_table_folds_its_last_column():
    lines = table(("name", "n", "text"), ROWS, fold=True, width=34).splitlines()
    assert max(map(len, lines)) <= 34
    assert lines[-1].strip() == "be folded somewhere"
    assert " ".join(line[10:] for line in lines[-2:]) == ROWS[1][2]


def test_table_does_without_columns_where_it_is_narrow():
    heading = table(("name", "n", "text"), ROWS, dispensable=("n", "text"), width=52).splitlines()[0]
    assert heading == "name  text"
    assert table(("name", "n", "text"), ROWS, dispensable=("n", "text"), width=20).splitlines()[0] == "name"
