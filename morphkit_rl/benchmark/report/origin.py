"""Where the numbers of a report are from: the command, commit and machine of every run."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from morphkit.errors import MorphkitError
from morphkit.utils.printable import markdown_table, one_line
from morphkit_rl.benchmark.cells import RUN, Status
from morphkit_rl.benchmark.methods import method_config
from morphkit_rl.benchmark.report.tables import MISSING, show
from morphkit_rl.benchmark.summary import Role, seed_means
from morphkit_rl.runs import run_settings
from morphkit_rl.runs.run_folder import CONFIG


def origin_row(cell: Status) -> dict[str, Any]:
    """Commit, processor, cores and threads of a cell's run, as far as the run knows them.

    Raises:
        CheckpointError: The run's settings are damaged.
    """
    run = cell.folder / RUN
    saved = run_settings.read(run) if (run / CONFIG).is_file() else {}
    machine = saved.get("machine") or {}
    return {
        "commit": saved.get("git_commit"),
        "processor": machine.get("processor"),
        "cores": machine.get("cores"),
        "threads": saved.get("threads"),
    }


def write_origin(cells: Sequence[Status]) -> str:
    """Every run that has begun, and the commands that make them, in Markdown."""
    begun = [(each, metrics[-1], origin_row(each)) for each in cells if (metrics := each.metrics)]
    if not begun:
        return ""
    numbers = ("steps", "updates", "minutes", "training, noise-free", "held out")
    rows = []
    for each, last, origin in begun:
        names = (each.cell.split, each.cell.task, each.cell.method, str(each.cell.seed), each.state)
        spent = (show(last["steps"]), show(last["updates"]), show((last.get("elapsed_s") or 0) / 60))
        roles: tuple[Role, Role] = ("train", "validation" if each.plan["validate"] else "test")
        returns = [seed_means([each] * (each.result is not None), role) for role in roles]
        means = [show(float(found[0])) if found.size else MISSING for found in returns]
        computed = f"{origin['threads'] or MISSING} of {origin['cores'] or MISSING}"
        rows.append((*names, *spent, *means, (origin["commit"] or MISSING)[:10], computed))
    hours = sum(last.get("elapsed_s") or 0 for _, last, _ in begun) / 3600
    columns = ("split", "task", "method", "seed", "state", *numbers, "commit", "threads of cores")
    table = markdown_table(columns, rows, right=("seed", *numbers))
    machines = sorted({origin["processor"] for *_, origin in begun if origin["processor"]})
    on = f" on {', '.join(map(one_line, machines))}" if machines else ""
    last_seeds = {(each.cell.split, each.cell.task, each.cell.method): each for each in cells}
    commands = "\n".join(f"$ {command_of(each)}" for each in last_seeds.values())
    cut = " with `--cuts` and" if any(each.plan["cut"] for each in cells) else " with"
    return (
        f"## Every run\n\n{hours:.1f} hours of training{on}. Returns are means over robots, of noise-free episodes; "
        f"`robots.csv` has every robot's.\n\n{table}\nMade{cut} one `--out` by:\n\n```console\n{commands}\n```\n"
    )


def command_of(cell: Status) -> str:
    """The command that makes a cell and those of the seeds before it, but for `--out`, `--file` and `--cuts`."""
    plan = cell.plan
    words = ["morphkit", "benchmark", "run", "--task", cell.cell.task, "--split", cell.cell.split]
    words += ["--method", cell.cell.method, "--seeds", str(cell.cell.seed + 1)]
    budget = {name: plan[name] for name in ("steps", "minutes", "episodes") if plan[name] is not None}
    words += [word for name, value in budget.items() for word in (f"--{name}", f"{value:.10g}")]
    words += ["--validate"] * plan["validate"]
    words += [word for setting in _settings(cell) for word in ("--set", setting)]
    return shlex.join(map(one_line, words))


def _settings(cell: Status) -> Iterator[str]:
    """Settings of a cell that are not its method's; none where the method is unknown here."""
    try:
        usual = method_config(cell.cell.method, cell.cell.split).to_dict()
    except MorphkitError:
        return
    config: Mapping[str, Mapping[str, Any]] = cell.plan["config"]
    for section, values in config.items():
        for name, value in values.items():
            if value != usual.get(section, {}).get(name):
                yield f"{section}.{name}={json.dumps(value)}"
