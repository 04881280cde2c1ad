"""How well `morphkit coverage` predicts: predicted against measured returns of policies on bodies that they never saw.

    python tools/coverage_check.py                       # the policies of the zoo
    python tools/coverage_check.py other.json --json     # what tools/calibrate_coverage.py --output wrote

Each body is left out in turn, and predicted by all other measured bodies; by those of them that are training bodies or
have another set of actuators, as a body is whose like was never measured; and by the training bodies alone. The rank
correlation (Spearman's rho) has a 90 % bootstrap interval over bodies. `within` is the share of returns inside the 90 %
interval that the other bodies give, `error` the root mean squared error of normalized returns, `spread` that of
predicting 0.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from morphkit.errors import MorphkitError
from morphkit_rl.evaluation.calibration import (
    FEWEST_TRAINED,
    SAME_BODY,
    distances,
    half_width,
    leave_one_out,
    never_trained,
    normalized_returns,
    regress,
)
from morphkit_rl.runs import schema
from morphkit_rl.runs.policy_schema import Evaluation

ZOO = Path(__file__).resolve().parents[1] / "zoo"
RESAMPLES, FEWEST = 2000, 4
WAYS = {"all": "all others", "unlike": "other actuators", "trained": "training bodies"}

Rows = Sequence[Mapping[str, Any]]


def judge(rows: Rows) -> dict[str, Any] | None:
    """How well bodies that were never trained on are predicted; None where there are too few."""
    never, bodies = never_trained(rows), [row["actuators"] for row in rows]
    trained = np.array([row["trained_on"] for row in rows])
    known = normalized_returns(rows) if trained.sum() >= FEWEST_TRAINED else None
    if len(never) < FEWEST or known is None:
        return None
    y, between = known[1], distances(bodies, bodies)
    every = np.ones_like(between, bool)
    unlike = np.array([[a.keys() != b.keys() for b in bodies] for a in bodies])
    values = {
        way: np.array([_predicted(between, y, each, sources[each]) for each in never])
        for way, sources in (("all", every), ("unlike", unlike | trained), ("trained", every & trained))
    }
    measured = y[never]
    errors = np.abs(values["all"] - measured)
    return {
        "bodies": len(never),
        **{way: rank_correlation(by, measured) for way, by in values.items()},
        "within": float(np.mean([e <= _half_width(between, y, never, n) for e, n in zip(errors, never, strict=True)])),
        "error": float(np.sqrt(np.square(errors).mean())),
        "spread": float(np.sqrt(np.square(measured).mean())),
        "reference": known[0],
        "pairs": [
            {"body": rows[each]["robot"], "predicted": p, "measured": m}
            for each, p, m in zip(never, values["all"].tolist(), measured.tolist(), strict=True)
        ],
    }


def _predicted(between: np.ndarray, y: np.ndarray, body: int, sources: np.ndarray) -> float:
    """What some bodies say of another one; the same body under another name says nothing."""
    others = np.flatnonzero(sources & (between[body] > SAME_BODY))
    return float(regress(between[np.ix_(others, others)], y[others], between[body, others])) if len(others) else 0.0


def _half_width(between: np.ndarray, y: np.ndarray, never: Sequence[int], body: int) -> float:
    """Half of the interval that a body gets from the errors on the others."""
    others = np.flatnonzero(between[body] > SAME_BODY)
    errors = leave_one_out(between[np.ix_(others, others)], y[others]) - y[others]
    return half_width(errors[np.isin(others, never)])


def rank_correlation(predicted: np.ndarray, measured: np.ndarray) -> tuple[float, float, float]:
    """Spearman's rho with its 90 % bootstrap interval over bodies."""
    rng, size = np.random.default_rng(0), len(predicted)
    drawn = [rng.integers(0, size, size) for _ in range(RESAMPLES)]
    several = [at for at in drawn if np.ptp(predicted[at]) > 0 and np.ptp(measured[at]) > 0]
    values = [stats.spearmanr(predicted[at], measured[at]).statistic for at in several]
    low, high = np.quantile(values, [0.05, 0.95])
    return float(stats.spearmanr(predicted, measured).statistic), float(low), float(high)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("evaluations", nargs="*", type=Path, help="default: those of the zoo")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    found = {}
    try:
        for path in options.evaluations or sorted(ZOO.glob("*/evaluation.json")):
            evaluation = schema.read(path, Evaluation)
            name = f"zoo:{path.resolve().parent.name}" if path.resolve().parent.parent == ZOO else path.stem
            found[name] = judge([*evaluation["robots"], *evaluation.get("calibration", ())])
    except MorphkitError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    if options.json:
        print(json.dumps(found, indent=1))
        return 0
    ways = "".join(f"{f'rho, {words}':23}" for words in WAYS.values())
    print(f"{'policy':24} bodies   {ways} within  error  spread")
    for name, each in found.items():
        if each is None:
            print(f"{name:24} too few bodies never seen, or measured")
            continue
        by = ["{:5.2f} ({:5.2f} to {:5.2f})".format(*each[key]) for key in WAYS]
        numbers = f"{each['within']:6.2f} {each['error']:6.2f} {each['spread']:6.2f}"
        print(f"{name:24} {each['bodies']:6}  {'  '.join(by)} {numbers}")
    judged = [each for each in found.values() if each is not None]
    for key, words in WAYS.items():
        mean, low, high = mean_over_policies([each[key][0] for each in judged])
        print(f"mean rho over {len(judged)} policies, {words}: {mean:.2f} ({low:.2f} to {high:.2f})")
    return 0


def mean_over_policies(values: Sequence[float]) -> tuple[float, float, float]:
    """Mean with its 90 % t-interval over policies."""
    mean, number = float(np.mean(values)), len(values)
    if number < 2:
        return mean, mean, mean
    half = float(stats.t.ppf(0.95, number - 1) * stats.sem(values))
    return mean, mean - half, mean + half


if __name__ == "__main__":
    raise SystemExit(main())
