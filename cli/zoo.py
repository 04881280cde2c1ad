"""`morphkit zoo`: the trained policies that ship with morphkit."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from . import common
from .table import table, terminal_width
from .terminal import write

EXAMPLES = (
    "morphkit zoo",
    "morphkit zoo --json",
)


def zoo(as_json: Annotated[bool, typer.Option("--json", help="Print JSON, with every return.")] = False) -> None:
    """List the trained policies that ship with morphkit.

    zoo:NAME works wherever the folder of a run does, as in morphkit evaluate zoo:NAME my_robot.xml; morphkit show
    zoo:NAME prints its model card.
    """
    from morphkit_rl.runs import zoo as policies

    rows = [_row(name) for name in policies.names()]
    if as_json:
        common.print_json(rows)
        return
    numbers = ("bodies", "steps", "held out", "normalized")
    cells = [
        (
            str(row["name"]),
            str(row["method"]),
            str(len(row["trained_on"])),
            str(row["steps"]),
            str(len(row["held_out"])),
            "-" if row["held_out_normalized"] is None else f"{row['held_out_normalized']:.2f}",
        )
        for row in rows
    ]
    columns = ("policy", "method", *numbers)
    write(table(columns, cells, right=numbers, dispensable=("steps",), width=terminal_width()))


def _row(name: str) -> dict[str, Any]:
    """What the list says of a policy; the normalized return is the mean over held-out bodies with a known expert."""
    from morphkit_rl.evaluation.model_card import mean_normalized
    from morphkit_rl.runs import saved_policy, zoo

    policy = saved_policy.load(f"{zoo.PREFIX}{name}")
    evaluation = saved_policy.read_evaluation(policy.folder) or {"robots": []}
    held_out = [row for row in evaluation["robots"] if not row["trained_on"]]
    return {
        "name": f"{zoo.PREFIX}{name}",
        "method": policy.state["method"],
        "trained_on": policy.robots,
        "held_out": [row["robot"] for row in held_out],
        "held_out_normalized": mean_normalized(held_out),
        "steps": policy.state["real_steps"],
        "seed": policy.settings["seed"],
        "commit": policy.settings.get("git_commit"),
        "evaluation": evaluation["robots"],
    }
