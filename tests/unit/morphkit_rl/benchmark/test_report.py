"""Reports of matrices, whole and half-done: numbers, honesty and pictures."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from matplotlib.figure import Figure

from morphkit.errors import CheckpointError, OutputError
from morphkit_rl.benchmark.cells import read_matrix
from morphkit_rl.benchmark.report.curve_figure import write_curves
from morphkit_rl.benchmark.report.curves import SeedCurve, band, seed_curve
from morphkit_rl.benchmark.report.origin import write_origin
from morphkit_rl.benchmark.report.write import write_report
from morphkit_rl.benchmark.statistics import mean_of_means
from morphkit_rl.benchmark.summary import improvements, overall, summarize
from morphkit_rl.runs import run_settings
from morphkit_rl.runs.run_settings import RunSettings
from tests.support.benchmark_matrix import make_matrix

HALF = {
    ("walkers", "ma-bert", 1): "failed",
    ("walkers", "ma-bert", 2): "not started",
    ("hoppers", "limb-former", 0): "stopped",
    ("hoppers", "limb-former", 1): "stopped",
    ("hoppers", "limb-former", 2): "stopped",
}


@pytest.fixture(scope="module")
def matrix(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("matrix")
    make_matrix(
        folder,
        tasks=["walkers", "hoppers"],
        methods=["limb-former", "ma-bert"],
        states=HALF,
        level=lambda cell: 3000.0 if cell.method == "limb-former" else 1000.0,
    )
    return folder


@pytest.fixture(scope="module")
def figures() -> list[Figure]:
    return []


@pytest.fixture(scope="module")
def report(matrix: Path, figures: list[Figure]) -> Path:
    with pytest.MonkeyPatch.context() as patch:
        save = Figure.savefig

        def spy(self: Figure, *arguments: Any, **options: Any) -> None:
            figures.append(self)
            save(self, *arguments, **options)

        patch.setattr(Figure, "savefig", spy)
        write_report(matrix, matrix / "report")
    return matrix / "report"


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reports without pictures, which take seconds."""
    monkeypatch.setattr("morphkit_rl.benchmark.report.write._draw", lambda *_: None)


def rows(report: Path, name: str) -> list[dict[str, str]]:
    with (report / f"{name}.csv").open() as file:
        return list(csv.DictReader(file))


def test_a_report_is_text_tables_and_pictures(report: Path) -> None:
    assert sorted(path.name for path in report.iterdir()) == [
        *("cells.csv", "report.json", "report.md", "robots.csv", "scores-split-1.png", "tasks.csv"),
        *("training-split-1.png", "zero-shot-split-1.png"),
    ]
    text = (report / "report.md").read_text()
    for picture in report.glob("*.png"):
        assert f"]({picture.name})" in text
        assert picture.read_bytes().startswith(b"\x89PNG")


def test_a_half_done_matrix_says_so_everywhere(report: Path) -> None:
    text = (report / "report.md").read_text()
    assert "This matrix is not whole" in text
    assert "12 cells" in text
    assert "Those that are done took 3,000,000 steps and 1.7 minutes of training." in text
    assert "7 done, 1 failed, 1 not started, 3 stopped" in text
    assert "| 1 | walkers | ma-bert | 1 | **failed** | RuntimeError: out of memory |" in text
    assert "| walkers | ma-bert | 1 of 3 done, 1 failed, 1 not started |" in text
    assert "| hoppers | limb-former | 0 of 3 done, 3 stopped | – |" in text
    assert json.loads((report / "report.json").read_text())["complete"] is False
    states = {(row["task"], row["method"], int(row["seed"])): row["state"] for row in rows(report, "cells")}
    assert {key: state for key, state in states.items() if state != "done"} == HALF


def test_numbers_are_those_of_the_cells_and_the_published_stand_beside(report: Path, matrix: Path) -> None:
    found = {(row["task"], row["method"]): row for row in rows(report, "tasks")}
    cells = [each for each in read_matrix(matrix) if each.cell.task == "walkers" and each.cell.method == "limb-former"]
    results = [each.result for each in cells if each.result]
    means = [np.mean([r["mean"] for r in result["robots"] if r["role"] == "test"]) for result in results]
    row = found["walkers", "limb-former"]
    assert float(row["held_out_return"]) == pytest.approx(np.mean(means))
    assert float(row["held_out_return_low"]) == pytest.approx(min(means)), "3 seeds: all equal in 1 of 27 resamples"
    assert float(row["training_return"]) == pytest.approx(np.mean([result["training_return"] for result in results]))
    scores = sorted(
        (r["mean"] + 20.0) / (r["expert_return"] + 20.0)
        for result in results
        for r in result["robots"]
        if r["role"] == "test"
    )
    assert len(scores) == 6
    assert float(row["held_out_score"]) == pytest.approx(np.mean(scores[1:-1])), "random is -20 in these matrices"
    assert row["published_held_out_return"] == ""
    line = next(line for line in (report / "report.md").read_text().splitlines() if "| walkers | limb-former |" in line)
    assert "| 5 800 (AnyMorph) |" in line, "the best published where the method itself is not"
    assert "| 763 (AnyMorph) |" in line
    alone = found["walkers", "ma-bert"]
    assert (alone["published_training_return"], alone["published_held_out_return"]) == ("920.0", "269.0")
    assert (alone["seeds"], alone["seeds_done"]) == ("3", "1")
    assert alone["held_out_return"]
    assert alone["held_out_return_low"] == "", "one seed has no interval"
    assert found["hoppers", "limb-former"]["training_return"] == ""
    assert found["hoppers", "ma-bert"]["held_out_return"] == "", "hoppers hold nothing out"
    robots = rows(report, "robots")
    assert len(robots) == 3 * 6 + 1 * 6 + 3 * 3
    assert {row["role"] for row in robots} == {"train", "test"}


def test_a_mean_over_some_tasks_is_not_set_beside_the_published_one_over_all(report: Path) -> None:
    text = (report / "report.md").read_text()
    line = next(line for line in text.splitlines() if line.startswith("| ma-bert | 1 of 7 |"))
    assert "846" not in line
    totals = {row["method"]: row for row in json.loads((report / "report.json").read_text())["overall"]}
    assert totals["ma-bert"]["tasks"] == ["walkers"]
    assert totals["ma-bert"]["of_tasks"] == 7


def test_improvement_is_over_the_tasks_that_both_have(matrix: Path) -> None:
    found = {each.robots: each for each in improvements(summarize(read_matrix(matrix)))}
    assert set(found) == {"test", "train"}
    assert found["test"].tasks == found["train"].tasks == ("walkers",)
    ours_first = found["test"].better == "limb-former"
    assert found["test"].probability.value == (1.0 if ours_first else 0.0)
    assert found["test"].probability.low is None


def test_pictures_have_the_panels_of_the_study(report: Path, figures: list[Figure]) -> None:
    curves, scores, bars = figures
    assert len(curves.axes) == len(scores.axes) == len(bars.axes) == 8
    titles = [axes.get_title(loc="left") for axes in bars.axes]
    assert titles[0] == "cheetahs"
    assert "hoppers" not in titles
    assert titles[-1] == "mean of all tasks"
    panel = {axes.get_title(loc="left"): axes for axes in curves.axes}
    said = {title: " ".join(text.get_text() for text in axes.texts) for title, axes in panel.items()}
    assert said["cheetahs"] == "not in this matrix"
    assert said["walkers"] == "MA-BERT: 1 of 3 done, 1 failed, 1 not started"
    assert "7 of 12 cells done" in curves.get_suptitle()
    levels = {line.get_ydata()[0] for line in panel["walkers"].lines if line.get_marker() == "D"}
    assert levels == {5800, 920, 2950}, "the published levels"
    shown = [text.get_text() for text in curves.legends[0].get_texts()]
    assert "MA-BERT, published" in shown
    assert "95 % interval over seeds" in shown


@pytest.mark.parametrize(("steps", "right_of_it"), [(3_000, True), (3_000_000, False), (6_000_000, False)])
def test_published_levels_end_where_they_were_reached(steps: int, right_of_it: bool, tmp_path: Path) -> None:
    make_matrix(tmp_path / "matrix", tasks=["walkers"], seeds=1, steps=steps)
    entries = summarize(read_matrix(tmp_path / "matrix"))
    with pytest.MonkeyPatch.context() as patch:
        drawn: list[Figure] = []
        patch.setattr(Figure, "savefig", lambda figure, *_, **__: drawn.append(figure))
        write_curves(tmp_path / "curves.png", "1", ["walkers"], entries, "return", "")
    (axes,) = drawn[0].axes
    lines = [line for line in axes.lines if line.get_marker() == "D"]
    assert len(lines) == 3
    assert {line.get_xdata()[1] for line in lines} == {3_000_000}
    assert {line.get_clip_on() for line in lines} == {right_of_it}
    assert axes.get_xlim() == (0, pytest.approx(steps, rel=0.02))
    assert any("right of this axis" in text.get_text() for text in axes.texts) is right_of_it


def test_bars_are_the_estimates_and_missing_ones_are_called_so(report: Path, figures: list[Figure]) -> None:
    found = {row["method"]: row for row in rows(report, "tasks") if row["task"] == "walkers"}
    axes = next(axes for axes in figures[2].axes if axes.get_title(loc="left") == "walkers")
    heights = sorted(bar.get_height() for bar in axes.patches)
    expected = sorted([*(float(row["held_out_return"]) for row in found.values()), 763, 392, 269, 237])
    assert heights == pytest.approx(expected)
    cheetahs = figures[2].axes[0]
    texts = [text.get_text() for text in cheetahs.texts]
    assert texts.count("none\nyet") == 2
    assert "not in this matrix" in texts
    assert {"2\u2009543", "2\u2009110"} <= set(texts)


def test_curves_of_several_seeds_are_drawn_where_all_have_values(matrix: Path) -> None:
    curves = [
        SeedCurve(np.array([0.0, 100.0]), np.array([[0.0], [100.0]])),
        SeedCurve(np.array([20.0, 60.0]), np.array([[50.0], [90.0]])),
    ]
    found = band(curves, mean_of_means)
    assert found is not None
    assert (found.steps[0], found.steps[-1]) == (20.0, 60.0)
    np.testing.assert_allclose(found.values, (found.steps + found.steps + 30) / 2)
    np.testing.assert_allclose(found.low, found.steps)
    np.testing.assert_allclose(found.high, found.steps + 30)
    alone = band(curves[:1], mean_of_means)
    assert alone is not None
    assert alone.low is None
    late = SeedCurve(np.array([70.0]), np.array([[1.0]]))
    assert band([curves[1], late], mean_of_means) is None
    cell = read_matrix(matrix)[0]
    scores = seed_curve(cell, "score")
    assert scores is not None
    assert scores.values.shape[1] == len(cell.plan["train"])


@pytest.mark.usefixtures("undrawn")
def test_validation_is_called_so_and_compared_with_nothing_published(tmp_path: Path) -> None:
    make_matrix(tmp_path / "m", tasks=["walkers"], methods=["ma-bert"], seeds=2, validate=True)
    entry = summarize(read_matrix(tmp_path / "m"))[0]
    assert entry.role == "validation"
    scores = seed_curve(entry.cells[0], "score")
    assert scores is not None
    assert scores.values.shape[1] == len(entry.cells[0].plan["validation"]) == 1
    assert overall([entry], lambda _: 1)[0].tasks == ("walkers",)
    write_report(tmp_path / "m", tmp_path / "report")
    text = (tmp_path / "report/report.md").read_text()
    assert "the test set was left alone" in text
    line = next(line for line in text.splitlines() if line.startswith("| walkers | ma-bert | 2 done |"))
    assert [part.strip() for part in line.split("|")][6:9:2] == ["–", "–"]
    assert {row["role"] for row in rows(tmp_path / "report", "robots")} == {"train", "validation"}


def test_every_run_has_its_command_commit_and_machine(tmp_path: Path) -> None:
    states = {("walkers", "limb-former", 1): "stopped", ("walkers", "limb-former", 2): "not started"}
    matrix = tmp_path / "m"
    plan = make_matrix(matrix, tasks=["walkers"], steps=5_000, overrides=["td3.tau=0.25"], states=states)[0]
    settings = RunSettings(tuple(plan.bodies.train), (), (), plan.config, None, None, 0, None, 5_000, "cpu", threads=1)
    run_settings.create(tmp_path / "run", settings)
    saved = json.loads((tmp_path / "run/config.json").read_text())
    saved |= {"git_commit": "a" * 40, "machine": {"processor": "Abacus 9", "cores": 64}}
    (plan.cell.folder(matrix) / "run/config.json").write_text(json.dumps(saved))
    text = write_origin(read_matrix(matrix))
    begun = [line for line in text.splitlines() if line.startswith("| 1 | walkers |")]
    assert len(begun) == 2, "what was never started is no run"
    assert "| 0 | done | 5 000 | 1 250 | 17 |" in begun[0]
    assert begun[0].endswith("| aaaaaaaaaa | 1 of 64 |")
    assert "stopped" in begun[1]
    assert begun[1].endswith("| – | – | – | – of – |"), "no returns, and nothing is known of where it ran"
    assert "hours of training on Abacus 9." in text
    command = (
        "morphkit benchmark run --task walkers --split 1 --method limb-former --seeds 3 --steps 5000 --episodes 10"
    )
    assert f"\n$ {command} --set td3.tau=0.25\n" in text


@pytest.mark.usefixtures("undrawn")
def test_a_whole_matrix_of_all_tasks_is_set_beside_the_published_mean(tmp_path: Path) -> None:
    tasks = ["cheetahs", "walkers", "humanoids", "walker_humanoids", "walker_humanoids_hopper"]
    tasks += ["cheetah_walker_humanoids", "cheetah_walker_humanoids_hopper"]
    make_matrix(tmp_path / "m", tasks=tasks, methods=["ma-bert"], seeds=2)
    write_report(tmp_path / "m", tmp_path / "report")
    text = (tmp_path / "report/report.md").read_text()
    assert "This matrix is not whole" not in text
    assert "Cells that are not done" not in text
    line = next(line for line in text.splitlines() if line.startswith("| ma-bert | all 7 |"))
    assert "| 846 |" in line


@pytest.mark.usefixtures("undrawn")
def test_a_report_is_replaced_but_nothing_else_is(matrix: Path, report: Path, tmp_path: Path) -> None:
    before = (report / "tasks.csv").read_bytes()
    (tmp_path / "other").mkdir()
    write_report(matrix, tmp_path / "other")
    write_report(matrix, tmp_path / "other")
    assert (tmp_path / "other/tasks.csv").read_bytes() == before
    shutil.rmtree(tmp_path / "other")
    (tmp_path / "letters").write_text("")
    with pytest.raises(OutputError, match="is no report"):
        write_report(matrix, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["letters"]
    with pytest.raises(CheckpointError, match="no such folder"):
        write_report(tmp_path / "none", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("other", ["notes.md", "pictures/a.png", "link"])
def test_a_report_with_other_files_is_left_alone(other: str, report: Path, tmp_path: Path) -> None:
    folder = tmp_path / "report"
    folder.mkdir()
    (folder / "report.json").write_text("{}")
    place = folder / other
    place.parent.mkdir(exist_ok=True)
    if other == "link":
        place.symlink_to(tmp_path)
    else:
        place.write_text("mine")
    with pytest.raises(OutputError, match=r"holds other files than a report|is a link to"):
        write_report(report.parent, folder)
    assert place.exists()
