"""Masses and inertias that no body has: repaired where they can be, refused where they cannot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import morphkit
from morphkit.conversion.convert import convert
from morphkit.errors import DescriptionError
from morphkit.simulation.inertia import possible_moments
from tests.support.everything_urdf import EVERYTHING, robot


def test_massless_moving_link_gets_a_gram(tmp_path: Path) -> None:
    text = EVERYTHING.replace('<mass value="0.7"/>', '<mass value="0"/>')
    path = robot(tmp_path / "r")
    path.write_text(text)
    conversion = convert(morphkit.load(path))
    model = conversion.spec.compile()
    assert model.body("axis").mass[0] == pytest.approx(1e-3)
    assert model.body("wheel").mass[0] == pytest.approx(1e-3)
    assert sum("moves and has no mass" in note for note in conversion.notes) == 2


@pytest.mark.parametrize("moments", [(1, 2, 10), (0.1, 5, 5.2), (-1, 2, 3), (1, 1, 2.0000001), (-3, -2, 1e-3)])
def test_repaired_moments_are_possible(moments: tuple[float, float, float]) -> None:
    settled = possible_moments(np.array(moments, dtype=float), 1.0)
    low, middle, high = np.sort(settled)
    assert low > 0
    assert low + middle >= high == max(moments)
    assert np.array_equal(np.argsort(settled, kind="stable"), np.argsort(moments, kind="stable"))


def test_possible_moments_stay() -> None:
    moments = np.array([1.0, 1.5, 2.0])
    assert possible_moments(moments, 1.0) is moments
    plate = np.array([1.0, 1.0, 2.0])
    assert possible_moments(plate, 1.0) == pytest.approx(plate, rel=2e-9)
    assert possible_moments(np.zeros(3), 2.0).tolist() == pytest.approx([2e-4] * 3)


def test_infinite_inertia_is_refused(tmp_path: Path) -> None:
    path = robot(tmp_path / "r")
    path.write_text(EVERYTHING.replace('izz="0.04"', 'izz="1e400"'))
    with pytest.raises(DescriptionError, match=r"not finite|too large"):
        convert(morphkit.load(path))
