"""Predicted returns, on bodies whose returns follow a rule."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from morphkit_rl.evaluation.calibration import body_distance, cosines, normalized_returns, predict


def embed(texts: list[str]) -> np.ndarray:
    """An angle for each text, which is its number in degrees."""
    angles = np.radians([float(text) for text in texts])
    return np.stack([np.cos(angles), np.sin(angles)], 1)


def row(angle: float, value: float, *, trained: bool = True, expert: float | None = 100.0) -> dict[str, Any]:
    name = f"{angle}{'' if trained else ' held out'}"
    return {
        "robot": name, "trained_on": trained, "returns": [value - 1, value + 1], "random_mean": 0.0,
        "expert_return": expert, "actuators": [str(angle)],
    }  # fmt: skip


TRAINED = [row(angle, angle) for angle in range(0, 90, 10)]


def test_bodies_are_as_far_apart_as_their_actuators() -> None:
    assert body_distance(["0", "30"], ["30", "0", "0"], embed) == pytest.approx(0)
    assert body_distance(["0"], ["90"], embed) == pytest.approx(1)
    assert body_distance(["0"], ["0", "60"], embed) == pytest.approx((0 + 0 + 0.5) / 3)
    assert (body_distance([], [], embed), body_distance([], ["0"], embed)) == (0, 1)
    assert cosines(np.zeros((1, 2)), np.ones((1, 2))).tolist() == [[0]]


def test_a_body_is_worth_what_its_neighbors_are() -> None:
    near, far = (predict([angle], TRAINED, embed) for angle in ("45", "80"))
    assert near is not None
    assert far is not None
    assert near.value == pytest.approx(0.45, abs=0.05)
    assert far.value > near.value
    assert near.low < near.value < near.high
    assert (near.calibrated_on, near.bodies, near.reference) == ("leave-one-out", 9, "expert")
    assert near.rank_correlation is not None
    assert near.rank_correlation > 0.8


def test_held_out_bodies_correct_what_training_bodies_promise() -> None:
    held_out = [row(angle, angle - 20, trained=False) for angle in (15, 35, 55, 75)]
    found = predict(["45"], [*TRAINED, *held_out], embed)
    assert found is not None
    assert (found.calibrated_on, found.bodies) == ("held-out", 4)
    assert found.value == pytest.approx(0.25, abs=0.05)
    few = predict(["45"], [*TRAINED, *held_out[:2]], embed)
    assert few is not None
    assert few.calibrated_on == "leave-one-out"


def test_without_an_expert_the_training_bodies_are_the_measure() -> None:
    rows = [row(0, 10, expert=None), row(10, 20, expert=None), row(20, 30, expert=50.0)]
    reference, values = normalized_returns(rows)
    assert reference == "training bodies"
    assert list(values.values()) == [0.5, 1.0, 1.5]
    assert predict(["0"], rows[:2], embed) is None
