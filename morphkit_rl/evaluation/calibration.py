"""What a policy may be worth on a body that it was not evaluated on, learned from the bodies that it was evaluated on.

Bodies are compared by the embeddings of their actuators' texts. With d(a, b) their distance (`body_distance`),

    y(b) = sum_a w_a y_a / sum_a w_a + c,    w_a = exp( -d(a, b) / h )

over the training bodies a, where y is the normalized return, h the bandwidth with the least leave-one-out error over
the training bodies, and c the mean of what held-out bodies are worth more than their neighbors (usually less than 0).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy import stats

from morphkit_rl.evaluation.episodes import normalized

Embed = Callable[[Sequence[str]], np.ndarray]
Reference = Literal["expert", "training bodies"]

BANDWIDTHS = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
LEVEL = 0.9
FEWEST_TRAINED, FEWEST_HELD_OUT = 3, 3


@dataclass(frozen=True)
class Prediction:
    """An expected normalized return with its interval.

    Attributes:
        value: Expected normalized return.
        low: Lower end of the 90 % interval.
        high: Upper end.
        reference: What a normalized return of 1 is: an expert's return, or the median over the training bodies.
        calibrated_on: Whose errors the interval comes from: those of `held-out` bodies; or `leave-one-out` over bodies
            that all were trained on, which is too good.
        bodies: How many bodies those are.
        rank_correlation: Spearman's, between predicted and measured over those bodies; None where all are alike.
    """

    value: float
    low: float
    high: float
    reference: Reference
    calibrated_on: Literal["held-out", "leave-one-out"]
    bodies: int
    rank_correlation: float | None


def predict(actuators: Sequence[str], rows: Sequence[Mapping[str, Any]], embed: Embed) -> Prediction | None:
    """Predict what the policy is worth on a body.

    Args:
        actuators: Texts of the body's actuators.
        rows: The bodies of an evaluation, as `evaluation.json` holds them.
        embed: Texts to embeddings (texts, size).

    Returns:
        The prediction; None where fewer than three training bodies were evaluated.
    """
    trained = [row for row in rows if row["trained_on"]]
    others = [row for row in rows if not row["trained_on"]]
    if len(trained) < FEWEST_TRAINED:
        return None
    reference, returns = normalized_returns(rows)
    y = np.array([returns[row["robot"]] for row in trained])
    between = distances([row["actuators"] for row in trained], [row["actuators"] for row in trained], embed)
    left_out = {h: _leave_one_out(between, y, h) for h in BANDWIDTHS}
    bandwidth = min(BANDWIDTHS, key=lambda h: float(np.square(left_out[h] - y).mean()))
    predicted, measured, bias = left_out[bandwidth], y, 0.0
    honest = len(others) >= FEWEST_HELD_OUT
    if honest:
        to_trained = distances([row["actuators"] for row in others], [row["actuators"] for row in trained], embed)
        predicted = np.array([_mean(row, y, bandwidth) for row in to_trained])
        measured = np.array([returns[row["robot"]] for row in others])
        bias = float((measured - predicted).mean())
    own = distances([actuators], [row["actuators"] for row in trained], embed)[0]
    value, number = _mean(own, y, bandwidth) + bias, len(measured)
    spread = float((measured - predicted).std(ddof=1)) * np.sqrt(1 + 1 / number)
    half = float(stats.t.ppf(0.5 + LEVEL / 2, number - 1)) * spread
    varied = np.ptp(predicted) > 0 and np.ptp(measured) > 0
    return Prediction(
        value=value,
        low=value - half,
        high=value + half,
        reference=reference,
        calibrated_on="held-out" if honest else "leave-one-out",
        bodies=number,
        rank_correlation=float(stats.spearmanr(predicted, measured).statistic) if varied else None,
    )


def normalized_returns(rows: Sequence[Mapping[str, Any]]) -> tuple[Reference, dict[str, float]]:
    """Mean normalized return of each body by name, and what 1 is.

    That is an expert's return where it is known of all bodies, else the median return over the training bodies.
    """
    means = {row["robot"]: float(np.mean(row["returns"])) for row in rows}
    if all(row["expert_return"] is not None for row in rows):
        reference: Reference = "expert"
        ones = {row["robot"]: row["expert_return"] for row in rows}
    else:
        reference = "training bodies"
        median = float(np.median([means[row["robot"]] for row in rows if row["trained_on"]]))
        ones = dict.fromkeys(means, median)
    values = {row["robot"]: normalized(means[row["robot"]], row["random_mean"], ones[row["robot"]]) for row in rows}
    return reference, {name: value for name, value in values.items() if value is not None}


def distances(bodies: Sequence[Sequence[str]], others: Sequence[Sequence[str]], embed: Embed) -> np.ndarray:
    """(bodies, others) `body_distance` of each to each."""
    return np.array([[body_distance(a, b, embed) for b in others] for a in bodies])


def body_distance(one: Sequence[str], other: Sequence[str], embed: Embed) -> float:
    """Mean, over the actuators of two bodies, of 1 - cosine to the nearest actuator of the other; 0 for like bodies."""
    if not one or not other:
        return float(bool(one) != bool(other))
    apart = 1 - cosines(embed(one), embed(other))
    return float(np.concatenate([apart.min(0), apart.min(1)]).clip(min=0).mean())


def cosines(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(rows of one, rows of other) cosine of the angle between embeddings; 0 with one that is zero."""
    a, b = (rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-9) for rows in (one, other))
    return np.asarray(a @ b.T)


def _leave_one_out(between: np.ndarray, y: np.ndarray, bandwidth: float) -> np.ndarray:
    """What the other bodies say of each."""
    return np.array([_mean(np.delete(row, i), np.delete(y, i), bandwidth) for i, row in enumerate(between)])


def _mean(apart: np.ndarray, y: np.ndarray, bandwidth: float) -> float:
    """Mean of y, weighted by nearness."""
    weights = np.exp(-(apart - apart.min()) / bandwidth)
    return float(weights @ y / weights.sum())
