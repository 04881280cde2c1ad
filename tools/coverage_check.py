"""How well `morphkit coverage` predicts: predicted against measured returns of a policy on bodies that it never saw.

    python tools/coverage_check.py zoo:walkers walker-family hopper-family [--episodes 3] [--json]

Bodies that the policy was trained on, or that its `evaluation.json` has, are left out. Measured is the mean return less
that of a random policy, noise-free. The rank correlation (Spearman's rho) has a 90 % bootstrap interval over bodies.
"""

from __future__ import annotations

import argparse
import json
import sys

import numpy as np
from scipy import stats

from morphkit.errors import MorphkitError
from morphkit.registry import load_all
from morphkit_rl.algorithms.policy import Policy
from morphkit_rl.evaluation.coverage import coverage
from morphkit_rl.evaluation.evaluate import evaluate

RESAMPLES = 2000


def measure(target: str, bodies: list[str], episodes: int) -> list[dict[str, object]]:
    """One row a body: predicted normalized return, measured return above random."""
    known = set(Policy.load(target).vocabulary.robots)
    rows: list[dict[str, object]] = []
    for body in (each for name in bodies for each in load_all(name)):
        if body.name in known:
            continue
        found = coverage(target, body)
        (result,) = evaluate(target, [body], episodes=episodes, seed=0)
        expected = found.prediction.value if found.prediction else None
        rows.append({
            "body": body.name,
            "known_texts": sum(match.trained for match in found.texts) / len(found.texts),
            "predicted": expected,
            "measured": result.mean - (result.random_mean or 0.0),
        })  # fmt: skip
    return rows


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
    parser.add_argument("policy")
    parser.add_argument("bodies", nargs="+")
    parser.add_argument("--episodes", type=int, default=3)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    try:
        rows = measure(options.policy, options.bodies, options.episodes)
    except MorphkitError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    predicted, measured = (np.array([row[key] for row in rows], float) for key in ("predicted", "measured"))
    rho, low, high = rank_correlation(predicted, measured)
    if options.json:
        print(json.dumps({"policy": options.policy, "bodies": rows, "rho": rho, "low": low, "high": high}))
        return 0
    for row in sorted(rows, key=lambda row: -float(str(row["measured"]))):
        print(f"{row['body']:40} {row['known_texts']:6.2f} {row['predicted']:8.2f} {row['measured']:8.0f}")
    print(f"{options.policy}: {len(rows)} bodies, rank correlation {rho:.2f} ({low:.2f} to {high:.2f})")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
