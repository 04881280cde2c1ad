"""Model cards: what a policy was trained on, how, and what it is worth, as Markdown."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from morphkit.utils.printable import markdown_table, one_line
from morphkit_rl.envs.robot import Robot
from morphkit_rl.evaluation.calibration import actuated_masses
from morphkit_rl.evaluation.episodes import mean_interval, normalized
from morphkit_rl.evaluation.evaluate import RobotResult
from morphkit_rl.runs.saved_policy import CARD, EVALUATION, SavedPolicy, read_card, read_evaluation

HEADER = """---
license: mit
library_name: morphkit
tags: [reinforcement-learning, robotics, mujoco, morphology]
---
"""


def evaluation_of(results: Sequence[RobotResult], robots: Sequence[Robot], episodes: int, seed: int) -> dict[str, Any]:
    """Results as `evaluation.json` holds them; `robots` are those that they are of."""
    rows = [
        {
            "robot": result.robot,
            "trained_on": result.trained_on,
            "returns": [round(value, 2) for value in result.returns],
            "random_mean": round(result.random_mean, 2),
            "expert_return": result.expert_return,
            "actuators": {text: round(mass, 6) for text, mass in actuated_masses(robot).items()},
        }
        for result, robot in zip(results, robots, strict=True)
    ]
    return {"episodes": episodes, "seed": seed, "robots": rows}


def model_card(
    name: str, policy: SavedPolicy, evaluation: Mapping[str, Any] | None, *, summary: str = "", command: str = ""
) -> str:
    """The card of a policy.

    Args:
        name: Name of the policy.
        policy: The policy.
        evaluation: What was measured, as `evaluation.json` holds it; None where nothing was.
        summary: What it does, in a sentence.
        command: The command that trained it.
    """
    settings, state = policy.settings, policy.state
    held_out = [*settings["hold_out"], *(robot["name"] for robot in settings.get("validation", ()))]
    config = settings["config"]
    rows = [
        ("method", config["model"]["method"]),
        ("trained on", ", ".join(policy.robots)),
        ("held out", ", ".join(held_out) or "none"),
        ("task", settings["task"] or "each body's own"),
        ("seed", settings["seed"]),
        ("environment steps", _number(state["real_steps"])),
        ("updates", _number(state["updates"])),
        ("training time", f"{state['elapsed_s'] / 60:.0f} min, {settings['threads']} thread(s), {settings['device']}"),
        ("text encoder", config["text"]["encoder"]),
        ("parameters", _number(sum(a.size for key, a in policy.arrays.items() if key.startswith("actor/")))),
        ("commit", settings.get("git_commit") or "unknown"),
        ("versions", ", ".join(f"{key} {value}" for key, value in (settings.get("versions") or {}).items())),
        ("license", "MIT"),
    ]
    parts = [HEADER, f"# {one_line(name)}\n", *([f"{summary}\n"] if summary else [])]
    parts.append(markdown_table(("", ""), [(key, str(value)) for key, value in rows]))
    if command:
        parts.append(f"Made by\n\n```console\n$ {command}\n```\n")
    parts.append(_returns(evaluation) if evaluation else "Its returns were not measured.\n")
    parts.append(
        "The policy knows a body by the names of its sensors and actuators. It knows nothing of real robots: what it "
        "does was seen in simulation alone.\n"
    )
    return "\n".join(parts)


def push_texts(policy: SavedPolicy, repository: str) -> dict[str, str]:
    """Card and evaluation of a policy that goes to a repository, by file: its own where it has them."""
    evaluation = read_evaluation(policy.folder)
    if (policy.folder / CARD).is_file():
        card = read_card(policy.folder)
    else:
        card = model_card(repository.rpartition("/")[2], policy, evaluation)
    return {CARD: card, **({} if evaluation is None else {EVALUATION: json.dumps(evaluation, indent=1) + "\n"})}


def _number(value: int) -> str:
    return f"{value:,}".replace(",", " ")


def mean_normalized(rows: Sequence[Mapping[str, Any]]) -> float | None:
    """Mean normalized return over those rows of an evaluation whose expert's return is known; None without any."""
    scores = [normalized(float(np.mean(r["returns"])), r["random_mean"], r["expert_return"]) for r in rows]
    known = [score for score in scores if score is not None]
    return float(np.mean(known)) if known else None


def _returns(evaluation: Mapping[str, Any]) -> str:
    numeric = ("return", "95 % interval", "random", "normalized")
    rows = []
    for row in sorted(evaluation["robots"], key=lambda row: (row["trained_on"], row["robot"])):
        mean, (low, high) = float(np.mean(row["returns"])), mean_interval(row["returns"])
        score = normalized(mean, row["random_mean"], row["expert_return"])
        numbers = (f"{mean:.0f}", f"{low:.0f} to {high:.0f}", f"{row['random_mean']:.0f}")
        shown = "-" if score is None else f"{score:.2f}"
        rows.append((row["robot"], "yes" if row["trained_on"] else "never", *numbers, shown))
    what = (
        f"Mean return over {evaluation['episodes']} noise-free episodes (seed {evaluation['seed']}), its bootstrap "
        "interval over episodes, and (return - random) / (expert - random) where an expert's return is known. One "
        "training run: the intervals say nothing of other seeds."
    )
    return f"## Returns\n\n{what}\n\n" + markdown_table(("body", "trained on", *numeric), rows, right=numeric)
