"""The whole path in one program: tokens, a family of bodies, one policy, and a body that the policy never saw.

`make demo` runs it. Each step is a command of the `morphkit` tool, printed before it runs, so that it can be
repeated by hand; the last step draws the plot and prints the table.
"""

from __future__ import annotations

import argparse
import json
import shlex
import shutil
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from rich.console import Console

from morphkit_cli.table import table

ROBOT = "cheetah"
HELD_OUT = "cheetah-no-bfoot"
MORPHKIT = Path(sys.executable).with_name("morphkit")

console = Console(highlight=False, emoji=False)


def step(title: str, *arguments: object, into: Path | None = None) -> str:
    """Print and run a command of `morphkit`, with its stdout shown or written to `into`.

    Returns:
        What the command wrote on stdout.
    """
    command = [str(argument) for argument in arguments]
    console.print(f"\n[bold]{title}[/bold]")
    shown = f"$ morphkit {shlex.join(command)}" + (f" > {into}" if into else "")
    console.print(shown, style="cyan", markup=False, soft_wrap=True)
    done = subprocess.run([MORPHKIT, *command], stdout=subprocess.PIPE, text=True)
    if done.returncode:
        sys.exit(done.returncode)
    if into is not None:
        into.write_text(done.stdout, encoding="utf-8")
    else:
        sys.stdout.write(done.stdout)
        sys.stdout.flush()
    return done.stdout


def expert_returns() -> dict[frozenset[str], float]:
    """Expert returns of the benchmark's bodies of this robot, by the limbs that they have."""
    from morphkit.readers import read
    from morphkit.registry import load, recipes

    bodies = [load(name) for name in recipes(ROBOT)]
    return {
        frozenset(limb.name for limb in read(body).limbs): body.info.expert_return
        for body in bodies
        if body.info.expert_return is not None
    }


def add_scores(results: list[dict[str, Any]], limbs: dict[str, frozenset[str]]) -> None:
    """Write `score` = (return - random) / (expert - random) into each result; None without an expert."""
    experts = expert_returns()
    for result in results:
        expert = experts.get(limbs[result["robot"]])
        random = result["random_mean"]
        result["expert_return"] = expert
        result["score"] = None if expert is None else (result["mean"] - random) / (expert - random)


def print_table(results: list[dict[str, Any]]) -> None:
    """Print trained, random and expert returns of every body."""
    numbers = ("trained", "random", "random 95 %", "expert", "score")
    rows = []
    for result in results:
        low, high = result["random_interval"]
        rows.append(
            (
                result["robot"],
                "yes" if result["trained_on"] else "never",
                f"{result['mean']:.0f}",
                f"{result['random_mean']:.0f}",
                f"{low:.0f} .. {high:.0f}",
                "-" if result["expert_return"] is None else f"{result['expert_return']:.0f}",
                "-" if result["score"] is None else f"{result['score']:.3f}",
            )
        )
    console.print("[bold]Mean return over noise-free episodes[/bold]")
    print(table(("body", "seen", *numbers), rows, right=numbers))
    print("score = (trained - random) / (expert - random)")


def verdict(results: list[dict[str, Any]]) -> None:
    """Say in words what the table shows."""
    scores = [result["score"] for result in results if result["trained_on"] and result["score"] is not None]
    if scores:
        console.print(f"mean score over the {len(scores)} training bodies: {sum(scores) / len(scores):.3f}")
    for result in results:
        if not result["trained_on"]:
            low, high = result["random_interval"]
            place = "above" if result["mean"] > high else "below" if result["mean"] < low else "within"
            console.print(
                f"{result['robot']}, never seen: {result['mean']:.0f}, {place} the random policy's "
                f"95 % interval ({low:.0f} to {high:.0f})",
                soft_wrap=True,
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=8.0, help="time for training")
    parser.add_argument("--episodes", type=int, default=10, help="episodes a body in the evaluation")
    parser.add_argument("--hold-out", default=HELD_OUT, help="the body that the policy never sees")
    parser.add_argument("--output", type=Path, default=Path("demo"))
    options = parser.parse_args()

    start = time.monotonic()
    out: Path = options.output
    family, run = out / "family", out / "run"
    out.mkdir(parents=True, exist_ok=True)
    if (run / "config.json").exists():
        shutil.rmtree(run)

    tokens = json.loads(
        step("1. What the robot senses, token by token", "tokens", ROBOT, "--json", into=out / "tokens.json")
    )
    console.print(f"{len(tokens['sensors'])} sensor tokens and {len(tokens['actuators'])} actuator tokens, such as")
    for token in (*tokens["sensors"][19:22], tokens["actuators"][0]):
        console.print(f"  {token['name']:<24} {token['unit']:<6} limb {token['limb']}", markup=False)

    step("2. Every body that can be cut out of it", "ablate", ROBOT, "--all", "--output", family)
    manifest = json.loads((family / "manifest.json").read_text(encoding="utf-8"))
    limbs = {variant["name"]: frozenset(variant["limbs"]) for variant in manifest["variants"]}
    limbs[ROBOT] = frozenset(limb["name"] for limb in tokens["limbs"])
    draw_family(family, out / "family.png")

    step(
        "3. One policy for all of them but one",
        *("train", family, ROBOT, "--run", run, "--hold-out", options.hold_out),
        *("--minutes", f"{options.minutes:g}", "--seed", options.seed),
    )

    bodies = (family, ROBOT)
    evaluation = out / "evaluation.json"
    measured = json.loads(
        step(
            "4. Its return on every body, compared with a random policy",
            *("evaluate", run, *bodies, "--episodes", options.episodes, "--seed", options.seed, "--json"),
            into=evaluation,
        )
    )
    results = sorted(measured["robots"], key=lambda result: (not result["trained_on"], result["robot"]))
    add_scores(results, limbs)

    video = out / "held_out.mp4"
    step(
        "5. The body that it never saw, on film",
        *("evaluate", run, family / f"{options.hold_out}.xml", "--episodes", 1, "--video", video),
    )
    plot = out / "result.png"
    draw_result(run, results, plot)

    console.print()
    print_table(results)
    verdict(results)
    console.print(f"\n{(time.monotonic() - start) / 60:.1f} minutes in all; everything lies in {out}/")
    made = (
        (out / "tokens.json", "the tokens of the robot"),
        (family, "the bodies and their manifest"),
        (out / "family.png", "a picture of them"),
        (run, "the trained policy, metrics and TensorBoard events"),
        (evaluation, "every return"),
        (plot, "learning curve, and trained against random"),
        (video, "the held-out body on film"),
    )
    width = max(len(str(path)) for path, _ in made)
    for path, what in made:
        if path.exists():
            console.print(f"  {path!s:<{width}}  {what}", markup=False, soft_wrap=True)


def draw_family(family: Path, path: Path) -> None:
    """Draw the bodies of a folder side by side; say so and go on where there is no OpenGL."""
    from morphkit.errors import DependencyError
    from morphkit.registry import load_all
    from morphkit.simulation.build import build_simulation
    from morphkit.viewer.media import family_sheet

    try:
        family_sheet([build_simulation(description) for description in load_all(family)], path)
    except DependencyError as error:
        console.print(f"no picture of the family: {error}", markup=False)


def draw_result(run: Path, results: list[dict[str, Any]], path: Path) -> None:
    """Draw the learning curve, and bars of trained against random; say so and go on without matplotlib."""
    from morphkit.errors import DependencyError
    from morphkit_rl.evaluation.figure import results_figure
    from morphkit_rl.runs.metrics_log import read_metrics

    bars = [SimpleNamespace(**{**result, "normalized": result["score"]}) for result in results]
    try:
        results_figure(read_metrics(run), bars, path)
    except DependencyError as error:
        console.print(f"no plot: {error}", markup=False)


if __name__ == "__main__":
    main()
