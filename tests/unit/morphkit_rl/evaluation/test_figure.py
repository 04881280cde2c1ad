"""The picture of a run's result."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from morphkit.errors import ConfigError, DependencyError, OutputError
from morphkit_rl.evaluation.figure import results_figure


@dataclass(frozen=True)
class FakeResult:
    robot: str
    trained_on: bool = True
    returns: tuple[float, ...] = (100.0, 140.0)
    random_mean: float = -20.0
    random_interval: tuple[float, float] = (-30.0, -10.0)
    normalized: float | None = None

    @property
    def mean(self) -> float:
        return sum(self.returns) / len(self.returns)


METRICS: list[dict[str, Any]] = [
    {"steps": 0, "updates": 0, "elapsed_s": 0.0, "return_mean": None, "returns": {}},
    {"steps": 1000, "updates": 10, "elapsed_s": 1.0, "return_mean": 5.0, "returns": {"a": 5.0}},
    {"steps": 2000, "updates": 20, "elapsed_s": 2.0, "return_mean": 15.0, "returns": {"a": 10.0, "b": 20.0}},
    {"steps": 3000, "updates": 30, "elapsed_s": 3.0, "return_mean": math.nan, "returns": {"a": None, "b": 30.0}},
]
RESULTS = [FakeResult("a", normalized=0.25), FakeResult("b"), FakeResult("c", trained_on=False, returns=(-50.0, -70.0))]


@pytest.fixture
def saved(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """The figures that are saved."""
    figures: list[Figure] = []
    save = Figure.savefig

    def spy(self: Figure, *arguments: Any, **options: Any) -> None:
        figures.append(self)
        save(self, *arguments, **options)

    monkeypatch.setattr(Figure, "savefig", spy)
    return figures


def test_first_episodes_begin_the_curve_of_the_mean(saved: list[Figure], tmp_path: Path) -> None:
    metrics = [{**row, "first_return_mean": first} for row, first in zip(METRICS, (None, -8.0, 3.0, None), strict=True)]
    results_figure(metrics, RESULTS, tmp_path / "result.png")
    (dotted,) = [line for line in saved[0].axes[0].lines if line.get_linestyle() == ":"]
    assert np.array_equal(dotted.get_xydata(), [[1000, -8], [2000, 3]])


def test_curves_hold_the_finite_points_of_each_body_and_of_the_mean(saved: list[Figure], tmp_path: Path) -> None:
    results_figure(METRICS, RESULTS, tmp_path / "result.png")
    lines = {line.get_label(): np.asarray(line.get_xydata()).tolist() for line in saved[0].axes[0].lines}
    assert lines == {
        "a": [[1000, 5], [2000, 10]],
        "b": [[2000, 20], [3000, 30]],
        "mean of the training bodies": [[1000, 5], [2000, 15]],
    }


def test_bars_show_trained_beside_random_and_mark_held_out_bodies(saved: list[Figure], tmp_path: Path) -> None:
    results_figure(METRICS, RESULTS, tmp_path / "result.png")
    axes = saved[0].axes[1]
    widths = [bar.get_width() for bar in axes.patches if isinstance(bar, Rectangle)]
    np.testing.assert_allclose(widths, [120, -20, 120, -20, -60, -20])
    assert [bool(bar.get_hatch()) for bar in axes.patches] == [False] * 4 + [True, False]
    ticks = axes.yaxis.get_major_ticks()
    assert [tick.label1.get_text() for tick in ticks] == ["a", "b", "c"]
    assert [tick.label1.get_fontweight() for tick in ticks] == ["normal", "normal", "bold"]
    assert [text.get_text() for text in axes.texts] == ["120  (score 0.25)", "120", "−60"]
    assert "held-out body" in [text.get_text() for text in saved[0].legends[0].get_texts()]


def test_axes_say_what_they_show_and_in_which_unit(saved: list[Figure], tmp_path: Path) -> None:
    results_figure(METRICS, RESULTS, tmp_path / "result.png")
    for axes in saved[0].axes:
        assert axes.get_title(loc="left")
    assert "environment steps" in saved[0].axes[0].get_xlabel()
    assert "sum of rewards" in saved[0].axes[0].get_ylabel()
    assert "score: 0 random, 1 expert" in saved[0].axes[1].get_xlabel()


def test_a_run_without_episodes_and_results_still_gives_a_picture(saved: list[Figure], tmp_path: Path) -> None:
    results_figure(METRICS[:1], [], tmp_path / "result.png")
    assert [axes.texts[0].get_text() for axes in saved[0].axes] == ["no episode has ended yet", "nothing was evaluated"]


def test_the_same_numbers_give_the_same_bytes_and_leave_nothing_else(tmp_path: Path) -> None:
    first = results_figure(METRICS, RESULTS, tmp_path / "a.png").read_bytes()
    assert first.startswith(b"\x89PNG")
    assert results_figure(METRICS, RESULTS, tmp_path / "b.png").read_bytes() == first
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.png", "b.png"]


def test_many_bodies_share_one_entry_in_the_legend(saved: list[Figure], tmp_path: Path) -> None:
    names = [f"body {index}" for index in range(12)]
    rows = [{"steps": 1, "return_mean": 1.0, "returns": dict.fromkeys(names, 1.0)}]
    results_figure(rows, [FakeResult(name) for name in names], tmp_path / "result.png")
    legend = saved[0].axes[0].get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["each body", "mean of the training bodies"]
    assert len(saved[0].axes[0].lines) == 13


def test_another_kind_of_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"must end in \.png, \.pdf or \.svg"):
        results_figure([], [], tmp_path / "result.txt")


def test_a_file_that_cannot_be_written_is_an_output_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot write"):
        results_figure([], [], tmp_path / "file" / "result.png")


def test_missing_matplotlib_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(DependencyError, match=r'pip install "morphkit\[viewer\]"'):
        results_figure([], [], tmp_path / "result.png")


def test_a_name_is_no_formula(tmp_path: Path) -> None:
    name = r"a$\frac$_^{"
    metrics = [{"steps": 10, "return_mean": 1.0, "returns": {name: 1.0}}]
    assert results_figure(metrics, [FakeResult(name)], tmp_path / "a.png").stat().st_size > 1000
