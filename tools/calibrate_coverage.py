"""Measures a policy of the zoo on bodies that it never saw, for `morphkit coverage` to predict others by.

    $ morphkit ablate walker --all --output walker-family
    $ python tools/calibrate_coverage.py zoo:walkers walker-family --resized 3
    $ python tools/calibrate_coverage.py runs/first walker-family --output first.json     # a run

Bodies are those given, less those that are training bodies under another name, and as many as `--resized` says of each
training body with limbs of other sizes (`tools/resized_bodies.py`). Noise-free returns go to the `calibration` of the
entry's `evaluation.json`; of a run, together with those on its training bodies, to `--output`. Nothing is trained,
chosen or tuned by them.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from resized_bodies import resized

from morphkit.description import Description
from morphkit.errors import MorphkitError
from morphkit.registry import load_all
from morphkit.utils.atomic_write import write_text
from morphkit_rl.algorithms.policy import Policy
from morphkit_rl.evaluation.calibration import SAME_BODY, actuated_masses, distances
from morphkit_rl.evaluation.evaluate import evaluate
from morphkit_rl.evaluation.model_card import evaluation_of
from morphkit_rl.runs import run_settings, saved_policy


def never_seen(policy: Policy, trained: list[Description], targets: list[str], number: int) -> list[Description]:
    """The bodies to measure."""
    others = [body for target in targets for body in load_all(target)]
    known, masses = ([actuated_masses(robot) for robot in policy.prepare(bodies)] for bodies in (trained, others))
    apart = distances(masses, known) if others else []
    new = [body for body, row in zip(others, apart, strict=True) if row.min() > SAME_BODY]
    return new + [resized(body, seed) for body in trained for seed in range(number)]


def calibrate(options: argparse.Namespace) -> int:
    """Measure and write; how many bodies."""
    folder = saved_policy.load(options.policy).folder
    policy, evaluation = Policy.load(folder), saved_policy.read_evaluation(folder)
    output = options.output or folder / saved_policy.EVALUATION
    if evaluation is None and options.output is None:
        raise MorphkitError(f"{folder}: has no {saved_policy.EVALUATION}; say where to write with --output")

    def measure(bodies: list[Description]) -> dict[str, Any]:
        results = evaluate(folder, bodies, episodes=options.episodes, seed=options.seed)
        return evaluation_of(results, policy.prepare(bodies), options.episodes, options.seed)

    trained = list(run_settings.load(folder).robots)
    bodies = never_seen(policy, trained, options.bodies, options.resized)
    found = {**(evaluation or measure(trained)), "calibration": measure(bodies)["robots"]}
    write_text(output, json.dumps(found, indent=1) + "\n")
    return len(bodies)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("policy", help="zoo:NAME, or a run")
    parser.add_argument("bodies", nargs="*", help="robots, files or folders of them")
    parser.add_argument("--resized", type=int, default=0, help="bodies of other sizes, of each training body")
    parser.add_argument("--output", type=Path, help="default: the entry's evaluation.json")
    parser.add_argument("--episodes", type=int, default=3)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    try:
        print(f"{options.policy}: {calibrate(options)} bodies")
    except MorphkitError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
