"""The outcomes of the corpus as a page of tables.

    python -m tests.corpus.report RAW... > docs/results/corpus.md

writes the page from what several runs have left with `--raw`.
"""

from __future__ import annotations

import json
import re
import sys
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

Outcome = dict[str, Any]

HEAD = """# Robots of other people

Written by `make corpus` (or joined from several of its runs by `python -m tests.corpus.report`), which runs every URDF,
xacro and MJCF file of the packages below through `morphkit tokens` and every URDF through `morphkit convert`, steps the
environment that `morphkit train` makes of every URDF with joints, and cuts every limb of every robot (with `--cuts N`
at most N of a robot, evenly spread), one at a time and with all below it. A file gives tokens or a precise error;
anything else is a failure. What `convert` refuses, `morphkit check` must refuse as well, with an error; a file that it
passes counts as contradiction. An environment is stepped 1000 times with random actions on the base that the file says,
and on a free one where it says fixed; observations and rewards that are not finite are a failure, and an episode that
ends because the simulation diverged is counted as what hinders it. A cut is held to three things:

- The robot is the one that `MjSpec.delete` leaves: all arrays of the two compiled models within 1e-9, and the names of
  their elements. Cameras and lights that `MjSpec.delete` leaves turned toward a removed body are turned away from it
  first: MuJoCo does not compile them.
- New lines of the file are no more than the losses that the cut lists; a line that only lost words is not new.
- An element that is gone or changed was in the removed limb, or mentions what was there or a listed loss.

The last two hold for files with their includes written out, but not where MuJoCo had to write out a `replicate` or
`attach`.

Files that hold several robots are run once a root (six at most), and once without `--root`, which is an error. Paths
that leave a file's folder are allowed within its collection, as with `--package`.

A limb is compared in one of two forms. *with meshes*: all meshes found and converted to what MuJoCo reads. *mesh-free*:
for robots of which that form does not compile or takes over 0.5 s to, for limbs whose skin `MjSpec.delete` leaves
behind, and for the rest of a robot after 1 s with meshes. Both models are changed in the same way until MuJoCo compiles
them: every mesh is a small tetrahedron and a missing height field a small sphere; sizes of 0 become 1 mm, masses are
bounded and inertias balanced; skins, lengths of muscles and limits on memory are left out; a free joint that hangs on a
body becomes a ball joint, and a ball joint's range starts at 0; materials and geoms that are named but are in no file
of the robot are added; and what MuJoCo's importer cannot parse of a URDF is left out or filled in (a second axis, an
inertial without inertia, a mesh's scale of four numbers).

Of a URDF, meshes are compared geom by geom: MuJoCo's importer orders them by their first use. A robot's own materials
are put before those of its links, as URDF has it; MuJoCo's importer alone would take the first of a name in the file.

`-`: that part was not run (`--parts`).
"""


def report(outcomes: Iterable[Outcome]) -> str:
    """The page."""
    by_collection: dict[str, list[Outcome]] = defaultdict(list)
    for outcome in outcomes:
        by_collection[outcome["collection"]].append(outcome)
    rows = [_row(name, found) for name, found in sorted(by_collection.items())]
    everything = [outcome for found in by_collection.values() for outcome in found]
    was_cut = [outcome for found in by_collection.values() if _was_cut(found) for outcome in found]
    parts = [
        HEAD,
        _table(
            ("collection", "files", "robots with tokens", "errors", "failures", "limbs cut",
             "compared with meshes", "compared mesh-free", "not compared", "different"),
            [*rows, ("all", *_row("", everything)[1:5], *_row("", was_cut)[5:])],
        ),
        "",
        _table(
            ("collection", "URDFs converted", "refused", "contradictions", "environments stepped", "not, or diverged"),
            [_urdf_row(name, found) for name, found in (*sorted(by_collection.items()), ("all", everything))],
        ),
        "\n## Failures, contradictions and differences\n",
        _bullets(_failures(everything)),
        "\n## Errors\n",
        _table(("count", "error", "for example"), _errors(everything)),
        "\n## What `convert` refuses\n",
        _table(("count", "error", "for example"), _refusals(everything)),
        "\n## What hinders environments\n",
        _table(("count", "reason", "for example"), _hindrances(everything)),
        "\n## Limbs that were not compared\n",
        _table(("count", "why", "for example"), _reasons(was_cut)),
    ]  # fmt: skip
    return "\n".join(parts)


def is_wrong(outcome: Outcome) -> bool:
    """Whether a robot failed, a cut of it differs, or `check` passes what `convert` refuses."""
    return outcome["result"] == "failure" or bool(outcome.get("contradiction") or outcome.get("different"))


def _failures(outcomes: list[Outcome]) -> Iterator[str]:
    """Every failure and contradiction, and up to three differences a robot."""
    for outcome in outcomes:
        robot = f"`{outcome['collection']}/{outcome['file']}` {outcome.get('root', '')}".rstrip()
        if outcome["result"] == "failure":
            yield f"{robot}: {_line(outcome['detail'])}"
        if outcome.get("contradiction"):
            yield f"{robot}: `check` passes it, `convert` does not: {outcome['contradiction']}"
        for limb, what in list(outcome.get("different", {}).items())[:3]:
            yield f"{robot}: {limb}: {what}"


def _row(name: str, found: list[Outcome]) -> tuple[str, ...]:
    results = Counter(o["result"] for o in found)
    compared: Counter[str] = Counter()
    for outcome in found:
        compared.update(outcome.get("compared", {}))
    cut = sum(_cut(o) for o in found if o["result"] == "tokens")
    missed = sum(_missed(o) for o in found)
    files = len({(o["collection"], o["file"]) for o in found})
    different = sum(len(o.get("different", {})) for o in found)
    numbers = (files, results["tokens"], results["error"], results["failure"])
    if not _was_cut(found):
        return (name, *map(str, numbers), *["-"] * 5)
    return (name, *map(str, (*numbers, cut, compared["meshes"], compared["mesh-free"], missed, different)))


def _urdf_row(name: str, found: list[Outcome]) -> tuple[str, ...]:
    converted = Counter(o["converted"] for o in found if o.get("converted") is not None)
    contradictions = sum(bool(o.get("contradiction")) for o in found)
    hindered = Counter(bool(reason) for o in found for reason in o.get("stepped", {}).values())
    conversions = (converted[True], converted[False], contradictions) if converted else ["-"] * 3
    return (name, *map(str, (*conversions, *((hindered[False], hindered[True]) if hindered else ["-"] * 2))))


def _was_cut(found: list[Outcome]) -> bool:
    """Whether a collection was cut, as far as it has limbs to cut."""
    return all(outcome.get("forms") for outcome in found if outcome["result"] == "tokens" and outcome["limbs"] > 1)


def _missed(outcome: Outcome) -> int:
    """Limbs that were compared in no form."""
    if outcome["result"] != "tokens":
        return 0
    return _cut(outcome) - sum(outcome.get("compared", {}).values())


def _cut(outcome: Outcome) -> int:
    """How many limbs were cut: all but the root, or fewer with `--cuts`."""
    return int(outcome.get("cut", max(outcome.get("limbs", 1) - 1, 0)))


def _errors(outcomes: list[Outcome]) -> list[tuple[str, ...]]:
    return _grouped((outcome["detail"], outcome) for outcome in outcomes if outcome["result"] == "error")


def _refusals(outcomes: list[Outcome]) -> list[tuple[str, ...]]:
    return _grouped((outcome["refused"], outcome) for outcome in outcomes if outcome.get("refused"))


def _hindrances(outcomes: list[Outcome]) -> list[tuple[str, ...]]:
    return _grouped((reason, o) for o in outcomes for reason in o.get("stepped", {}).values() if reason)


def _grouped(said: Iterable[tuple[str, Outcome]]) -> list[tuple[str, ...]]:
    groups: dict[str, list[Outcome]] = defaultdict(list)
    for detail, outcome in said:
        groups[_kind(detail)].append(outcome)
    ordered = sorted(groups.items(), key=lambda item: -len(item[1]))
    return [(str(len(found)), kind, f"`{found[0]['file']}`") for kind, found in ordered]


def _reasons(outcomes: list[Outcome]) -> list[tuple[str, ...]]:
    counts: Counter[str] = Counter()
    example: dict[str, str] = {}
    for outcome in outcomes:
        missed = _missed(outcome)
        if missed:
            reasons = [*outcome.get("uncompared", {}).values(), outcome.get("forms", {}).get("mesh-free", "")]
            kind = _kind(": " + next((reason for reason in reasons if reason), "no form compiles"))
            counts[kind] += missed
            example.setdefault(kind, outcome["file"])
    return [(str(count), kind, f"`{example[kind]}`") for kind, count in counts.most_common()]


def _kind(detail: str) -> str:
    """An error without the names and numbers of one file."""
    text = _line(detail).partition(": ")[2] or _line(detail)
    scene = text.find("expected one: ")
    text = text if scene < 0 else text[:scene] + "expected one"  # without the list
    text = re.sub(r"'[^']*$", "*", text.partition(" Tried:")[0])
    return re.sub(r"'[^']*'|\"[^\"]*\"|\d+(\.\d+)?", "*", text)[:110].replace("|", "\\|")


def _line(text: str) -> str:
    lines = [line for line in text.strip().splitlines() if line.strip()]
    return (lines[-1] if "Traceback" in text else " ".join(lines))[:300] if lines else ""


def _bullets(lines: Iterable[str]) -> str:
    return "\n".join(f"- {line}" for line in lines) or "None."


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    if not rows:
        return "None."
    lines = ["| " + " | ".join(row) + " |" for row in (head, tuple("---" for _ in head), *rows)]
    return "\n".join(lines)


if __name__ == "__main__":
    print(report(json.loads(line) for raw in sys.argv[1:] for line in Path(raw).read_text().splitlines()))
