"""Makes a policy of the zoo out of a run: its actor, what it is worth on its training and on other bodies, and a card.

    $ python tools/add_to_zoo.py runs/cheetahs cheetahs cheetah_3_balanced cheetah_5_back \
        --summary "Runs forward on planar cheetahs." --command "morphkit train ... --steps 3000000"

The bodies are those that were held out; the run's training and validation bodies come along. Evaluate first, look at
the card, and commit what the folder holds.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from morphkit.errors import MorphkitError
from morphkit.registry import load_all
from morphkit_rl.algorithms.policy import Policy
from morphkit_rl.evaluation.evaluate import evaluate
from morphkit_rl.evaluation.model_card import evaluation_of, model_card
from morphkit_rl.runs import run_settings, saved_policy

ZOO = Path(__file__).resolve().parents[1] / "zoo"


def add(options: argparse.Namespace) -> Path:
    """Measure and write; the folder."""
    policy, settings = saved_policy.load(options.run, options.checkpoint), run_settings.load(options.run)
    bodies = [*settings.robots, *settings.validation]
    known = {body.name for body in bodies}
    others = [body for target in options.bodies for body in load_all(target)]
    bodies += [body for body in others if body.name not in known]
    how = {"episodes": options.episodes, "seed": options.seed, "checkpoint": options.checkpoint}
    results = evaluate(options.run, bodies, **how)
    robots = Policy.load(options.run, checkpoint=options.checkpoint).prepare(bodies)
    evaluation = evaluation_of(results, robots, options.episodes, options.seed)
    card = model_card(options.name, policy, evaluation, summary=options.summary, command=options.command)
    folder: Path = options.output / options.name
    texts = {saved_policy.EVALUATION: json.dumps(evaluation, indent=1) + "\n", saved_policy.CARD: card}
    saved_policy.save(policy, folder, texts)
    return folder


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path)
    parser.add_argument("name")
    parser.add_argument("bodies", nargs="*", help="held-out bodies")
    parser.add_argument("--summary", required=True, help="what the policy does, in a sentence")
    parser.add_argument("--command", required=True, help="the command that trained it")
    parser.add_argument("--checkpoint", default="latest", help="latest, best, or a checkpoint's name")
    parser.add_argument("--episodes", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--output", type=Path, default=ZOO)
    try:
        print(add(parser.parse_args()))
    except MorphkitError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
