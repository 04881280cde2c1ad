"""What a policy may be worth on a body, learned from the bodies that it was measured on.

A body is the set of its actuators' texts, each with the mass of the limb that it moves (`actuated_masses`). With
d(a, b) the distance of two bodies (`body_distance`) and y the normalized returns of the measured bodies A, the
prediction is kernel ridge regression (Gaussian process regression, Rasmussen and Williams 2006, eq. 2.25):

    y(b) = k(b, A) (k(A, A) + NOISE I)^-1 y,    k(a, b) = exp( -d(a, b) / BANDWIDTH )

Far from all that was measured it goes to 0, the return of a random policy.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy import stats

from morphkit.tokens.spec import TokenSpec
from morphkit_rl.envs.robot import Robot
from morphkit_rl.evaluation.episodes import normalized
from morphkit_rl.models.layout import parent_indices

Reference = Literal["expert", "training bodies"]
Masses = Mapping[str, float]
"""Text of an actuator -> mass of the limb that it moves, kg."""

BANDWIDTH, NOISE = 0.1, 0.1  # settled on walkers alone: docs/results/coverage.md
SAME_BODY = 0.01
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
        calibrated_on: Whose errors, each body left out in turn, the interval comes from: those of `held-out` bodies; or
            `leave-one-out` over bodies that all were trained on, which is too good.
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


def predict(body: Masses, rows: Sequence[Mapping[str, Any]]) -> Prediction | None:
    """Predict what the policy is worth on a body.

    Args:
        body: Its actuators; see `actuated_masses`.
        rows: The bodies that were measured, as `evaluation.json` holds them.

    Returns:
        The prediction; None where fewer than three training bodies were measured, or the policy is worth no more on
        them than a random one.
    """
    known = normalized_returns(rows) if sum(row["trained_on"] for row in rows) >= FEWEST_TRAINED else None
    if known is None:
        return None
    reference, y = known
    bodies = [row["actuators"] for row in rows]
    never = never_trained(rows)
    honest = len(never) >= FEWEST_HELD_OUT
    judged = never if honest else [number for number, row in enumerate(rows) if row["trained_on"]]
    between = distances(bodies, bodies)
    predicted, measured = leave_one_out(between, y)[judged], y[judged]
    value = float(regress(between, y, distances([body], bodies)[0]))
    half = half_width(measured - predicted)
    varied = np.ptp(predicted) > 0 and np.ptp(measured) > 0
    return Prediction(
        value=value,
        low=value - half,
        high=value + half,
        reference=reference,
        calibrated_on="held-out" if honest else "leave-one-out",
        bodies=len(judged),
        rank_correlation=float(stats.spearmanr(predicted, measured).statistic) if varied else None,
    )


def actuated_masses(robot: Robot, spec: TokenSpec | None = None) -> dict[str, float]:
    """What of a body the prediction looks at; actuators of no limb count as massless.

    Args:
        robot: The body.
        spec: Its tokens with other texts; default: its own.
    """
    masses = dict(zip((limb.name for limb in robot.spec.limbs), limb_masses(robot), strict=True))
    found: dict[str, float] = {}
    for actuator in (spec or robot.spec).actuators:
        mass = 0.0 if actuator.limb is None else float(masses[actuator.limb])
        found[actuator.text] = found.get(actuator.text, 0.0) + mass
    return found


def limb_masses(robot: Robot) -> np.ndarray:
    """(limbs,) mass of each limb, kg."""
    below = robot.simulation.model.body_subtreemass[robot.simulation.limb_body]
    masses = below.copy()
    for limb, parent in enumerate(parent_indices(robot.spec)):
        if parent >= 0:
            masses[parent] -= below[limb]
    return np.asarray(masses)


def normalized_returns(rows: Sequence[Mapping[str, Any]]) -> tuple[Reference, np.ndarray] | None:
    """What 1 is, and (rows,) mean normalized returns.

    1 is an expert's return where it is known of all bodies, else the median return over the training bodies. None where
    that is no more than the return of a random policy.
    """
    means = [float(np.mean(row["returns"])) for row in rows]
    experts = [row["expert_return"] for row in rows]
    reference: Reference = "training bodies" if None in experts else "expert"
    if reference == "training bodies":
        trained = [mean for mean, row in zip(means, rows, strict=True) if row["trained_on"]]
        experts = [float(np.median(trained))] * len(rows)
    randoms = [row["random_mean"] for row in rows]
    if any(expert <= random for expert, random in zip(experts, randoms, strict=True)):
        return None
    return reference, np.array([normalized(*each) for each in zip(means, randoms, experts, strict=True)], float)


def body_distance(one: Masses, other: Masses) -> float:
    """From 0 for like bodies to 1 for bodies without a common actuator.

    The mean of two Jaccard distances: of the sets of actuators, and of their masses (weighted Jaccard, or Ruzicka).
    """
    texts = sorted(one.keys() | other.keys())
    if not texts:
        return 0.0
    a, b = (np.array([(text in body, body.get(text, 0.0)) for text in texts], float) for body in (one, other))
    smaller, greater = np.minimum(a, b).sum(0), np.maximum(a, b).sum(0)
    return float(1 - (smaller[greater > 0] / greater[greater > 0]).mean())


def distances(bodies: Sequence[Masses], others: Sequence[Masses]) -> np.ndarray:
    """(bodies, others) `body_distance` of each to each."""
    return np.array([[body_distance(a, b) for b in others] for a in bodies])


def regress(between: np.ndarray, y: np.ndarray, apart: np.ndarray) -> np.ndarray:
    """The prediction.

    Args:
        between: (bodies, bodies) distances of the measured bodies.
        y: (bodies,) what they are worth.
        apart: (..., bodies) distances of bodies to them.

    Returns:
        (...) what those are worth.
    """
    weights = np.linalg.solve(_kernel(between) + NOISE * np.eye(len(y)), y)
    return np.asarray(_kernel(apart) @ weights)


def half_width(errors: np.ndarray) -> float:
    """Half of the width of the t-interval that a further error lies in, around 0."""
    number = len(errors)
    spread = float(np.sqrt(np.square(errors).mean() * (1 + 1 / number)))
    return float(stats.t.ppf(0.5 + LEVEL / 2, number - 1)) * spread


def leave_one_out(between: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(bodies,) what the others say of each; a body that is another one under a second name counts as that."""
    found = np.empty(len(y))
    for body, apart in enumerate(between):
        others = np.flatnonzero(apart > SAME_BODY)
        found[body] = regress(between[np.ix_(others, others)], y[others], apart[others]) if len(others) else 0.0
    return found


def never_trained(rows: Sequence[Mapping[str, Any]]) -> list[int]:
    """Numbers of the bodies that were not trained on, under no name."""
    trained = [row["actuators"] for row in rows if row["trained_on"]]
    apart = distances([row["actuators"] for row in rows], trained)
    return [number for number, row in enumerate(apart) if row.min() > SAME_BODY]


def _kernel(apart: np.ndarray) -> np.ndarray:
    return np.asarray(np.exp(-apart / BANDWIDTH))
