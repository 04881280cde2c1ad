"""Predicted returns, on bodies whose returns follow a rule."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest

from morphkit.registry import load
from morphkit_rl.config.train_config import TrainConfig
from morphkit_rl.evaluation.calibration import (
    actuated_masses,
    body_distance,
    leave_one_out,
    never_trained,
    normalized_returns,
    predict,
    regress,
)
from morphkit_rl.runs.run_settings import prepare_robot

FULL = {"left1": 3.0, "left2": 2.0, "left3": 1.0, "right1": 3.0, "right2": 2.0, "right3": 1.0}


def legs(left: int, right: int) -> dict[str, float]:
    return {text: mass for text, mass in FULL.items() if int(text[-1]) <= (left if text[0] == "l" else right)}


def row(left: int, right: int, *, trained: bool = False, expert: float | None = None) -> dict[str, Any]:
    """A body that is worth 100 where both legs are whole, and nothing without a left or a right one."""
    value = 100.0 * left * right / 9
    return {
        "robot": f"{left}{right}", "trained_on": trained, "returns": [value - 1, value + 1], "random_mean": 0.0,
        "expert_return": expert, "actuators": legs(left, right),
    }  # fmt: skip


TRAINED = [row(3, 3, trained=True), row(3, 2, trained=True), row(2, 3, trained=True), row(2, 2, trained=True)]
OTHERS = [row(left, right) for left, right in product(range(4), range(4)) if min(left, right) < 2 and left + right]


def test_bodies_are_as_far_apart_as_their_actuators_and_masses() -> None:
    assert body_distance(FULL, dict(reversed(FULL.items()))) == 0
    assert body_distance(FULL, {"fin": 1.0}) == 1
    assert body_distance(FULL, legs(3, 2)) == pytest.approx((1 / 6 + 1 / 12) / 2)
    heavier = {text: 2 * mass for text, mass in FULL.items()}
    assert body_distance(FULL, heavier) == pytest.approx((0 + 1 / 2) / 2)
    assert (body_distance({}, {}), body_distance({}, FULL)) == (0, 1)
    assert body_distance({"winch": 0.0}, {"winch": 0.0}) == 0


def test_masses_are_those_of_the_limbs_that_actuators_move() -> None:
    robot = prepare_robot(TrainConfig(), load("hopper_3"), task=None, base=None)
    model, found = robot.simulation.model, actuated_masses(robot)
    assert list(found) == [actuator.text for actuator in robot.spec.actuators]
    assert list(found.values()) == pytest.approx([model.body(a.limb).mass.item() for a in robot.spec.actuators])


def test_near_bodies_count_and_far_ones_are_worth_what_a_random_policy_is() -> None:
    y = np.array([1.0, 0.0])
    between = np.array([[0.0, 0.5], [0.5, 0.0]])
    near, far = regress(between, y, np.array([[0.0, 0.5], [1.0, 1.0]]))
    assert near == pytest.approx(1 / 1.1, abs=0.01)
    assert abs(far) < 1e-4
    np.testing.assert_allclose(leave_one_out(between, y), [0, np.exp(-5) / 1.1])


def test_bodies_never_seen_are_predicted_by_each_other() -> None:
    found = predict(legs(3, 1), [*TRAINED, *OTHERS])
    assert found is not None
    assert (found.calibrated_on, found.bodies, found.reference) == ("held-out", len(OTHERS), "training bodies")
    assert found.rank_correlation is not None
    assert found.rank_correlation > 0.6
    assert found.low < 100 * 3 / 9 / np.median([100, 200 / 3, 200 / 3, 400 / 9]) < found.high
    whole, none = predict(FULL, [*TRAINED, *OTHERS]), predict({"fin": 1.0}, [*TRAINED, *OTHERS])
    assert whole is not None
    assert none is not None
    assert whole.value > found.value > none.value
    assert none.value == pytest.approx(0, abs=0.01)


def test_a_training_body_under_another_name_is_not_held_out() -> None:
    again = [{**each, "robot": f"again {each['robot']}", "trained_on": False} for each in TRAINED]
    assert never_trained([*TRAINED, *again, OTHERS[0]]) == [8]
    found = predict(FULL, [*TRAINED, *again])
    assert found is not None
    assert (found.calibrated_on, found.bodies) == ("leave-one-out", 4)
    between = np.array([[0.0, 0.0, 0.3], [0.0, 0.0, 0.3], [0.3, 0.3, 0.0]])
    first = leave_one_out(between, np.array([1.0, 1.0, 0.5]))[0]
    assert first == pytest.approx(0.5 * np.exp(-3) / 1.1), "its twin does not tell"


def test_what_one_is() -> None:
    rows = [{**each, "expert_return": 200.0} for each in TRAINED]
    assert normalized_returns(rows) is not None
    reference, values = normalized_returns(rows) or ("", np.empty(0))
    assert (reference, values[0]) == ("expert", 0.5)
    reference, values = normalized_returns(TRAINED) or ("", np.empty(0))
    assert (reference, np.median(values)) == ("training bodies", 1)
    failed = [{**each, "random_mean": 500.0} for each in TRAINED]
    assert normalized_returns(failed) is None
    assert predict(FULL, failed) is None
    assert predict(FULL, TRAINED[:2]) is None
