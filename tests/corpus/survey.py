"""Everything that is tried on one file: tokens, conversion, steps, and the cut of every limb."""

from __future__ import annotations

import json
import re
import sys
import time
import traceback
from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from pathlib import Path

from morphkit.ablation.ablate import Cutter, Variant
from morphkit.description import Description
from morphkit.errors import MorphkitError
from morphkit.formats import xml
from morphkit.formats.mjcf_include import flatten_includes
from morphkit.morphology import Base, Limb
from morphkit.readers import read
from morphkit.registry import load
from morphkit.simulation import spec as mujoco_spec
from morphkit.tokens.spec import token_spec

from .compare import Form, differences, forms, has_meshes, missing_names, spec_of, without_body
from .conversion import passes_check, refusal
from .environment import steps
from .source import foreign_lines, unexplained

SECONDS_WITH_MESHES = 1.0
"""Processor time; meshes take nearly all of it, and limbs after the first few show nothing new of them. A robot that
takes half of it to compile in both forms is compared mesh-free alone."""
_ROOTS = re.compile(r"top-level \w+ elements, expected one: (.*)\. Say which")


@dataclass
class Outcome:
    """What came of one robot: `tokens`, `error` (a precise one) or `failure` (a traceback or a crash).

    `converted` is None where that was not tried, as of MJCF; `refused` says why not. `contradiction` is what `convert`
    said of a file that `check` passes. `stepped` says for each base what hinders stepping the robot's environment.
    `cut` is how many limbs were cut.
    """

    file: str
    root: str = ""
    result: str = "tokens"
    detail: str = ""
    limbs: int = 0
    cut: int = 0
    sensors: int = 0
    actuators: int = 0
    declared: int = 0
    converted: bool | None = None
    refused: str = ""
    contradiction: str = ""
    stepped: dict[str, str] = field(default_factory=dict)
    forms: dict[str, str] = field(default_factory=dict)
    compared: dict[str, int] = field(default_factory=dict)
    uncompared: dict[str, str] = field(default_factory=dict)
    different: dict[str, str] = field(default_factory=dict)
    seconds: float = 0.0


@dataclass(frozen=True)
class Plan:
    """What is tried on every file of a collection besides tokens.

    Attributes:
        collection: Its folder, in which paths may lead anywhere.
        parts: Of `convert`, `step` and `cut`.
        cuts: How many limbs are cut of a robot; of one with more, those that lie evenly spread over its order.
    """

    collection: Path
    parts: Collection[str]
    cuts: int = sys.maxsize


def survey(path: str, plan: Plan) -> list[Outcome]:
    """Try one file of a collection; one with several robots gives an outcome for itself and one a robot."""
    outcome = _survey(path, None, plan)
    roots = _ROOTS.search(outcome.detail)
    several = roots[1].split(", ")[:6] if roots is not None else []
    return [outcome, *(_survey(path, root, plan) for root in several)]


def _survey(path: str, root: str | None, plan: Plan) -> Outcome:
    outcome = Outcome(path, root or "")
    start = time.perf_counter()
    try:
        try:
            _read(load(path, root=root, packages={"collection": plan.collection}), outcome, plan)
        except MorphkitError as error:
            outcome.result, outcome.detail = "error", str(error)[:600]
        said = outcome.refused or ("" if path.endswith(".xml") else outcome.detail)
        if "convert" in plan.parts and said and root is None and passes_check(path, plan.collection):
            outcome.contradiction = said
    except Exception:
        outcome.result, outcome.detail = "failure", traceback.format_exc()[-1500:]
    outcome.seconds = round(time.perf_counter() - start, 2)
    return outcome


def _read(description: Description, outcome: Outcome, plan: Plan) -> None:
    morphology = read(description)
    spec = token_spec(morphology)
    outcome.limbs, outcome.sensors, outcome.actuators = len(spec.limbs), len(spec.sensors), len(spec.actuators)
    outcome.declared = len(token_spec(morphology, naming="canonical", source="declared").sensors)
    assert token_spec(read(description)).to_json() == spec.to_json(), "the same file gives other bytes"
    if "convert" in plan.parts and description.format == "urdf":
        outcome.refused = refusal(description)
        outcome.converted = not outcome.refused
    if "step" in plan.parts and description.format == "urdf" and morphology.joints:
        bases: list[Base] = ["fixed", "free"] if morphology.base == "fixed" else [morphology.base]
        outcome.stepped = {base: steps(description, base) for base in bases}
    if "cut" in plan.parts and len(spec.limbs) > 1:
        _cut_each(description, plan.cuts, outcome)


def _cut_each(description: Description, most: int, outcome: Outcome) -> None:
    start = time.process_time()
    outcome.forms = dict(forms(description))
    heavy = time.process_time() - start > SECONDS_WITH_MESHES / 2
    usable: list[Form] = [form for form in ("meshes", "mesh-free") if not outcome.forms[form]]  # type: ignore[misc]
    if heavy and len(usable) == 2:
        usable = ["mesh-free"]
    slow = len(usable) == 2 and has_meshes(description)
    cutter = Cutter(description)
    before, bodies = _written_out(description), _bodies(description, usable)
    missing = missing_names(description) if "mesh-free" in usable else None
    deadline = time.process_time() + SECONDS_WITH_MESHES
    limbs = _spread(cutter.morphology.limbs[1:], most)
    outcome.cut = len(limbs)
    for limb in limbs:
        variant = cutter.ablate(remove=[limb.name])
        _check_source(before, variant, limb.name, bodies, outcome)
        for form in usable:
            if form == "meshes" and slow and time.process_time() > deadline:
                continue
            try:
                expected = without_body(description, limb.name, form)
            except Exception as error:
                outcome.uncompared[limb.name] = f"MjSpec.delete: {' '.join(str(error).split())[:200]}"
                continue
            by_geom = description.format == "urdf"
            found = differences(spec_of(variant.description, form, missing).compile(), expected, by_geom=by_geom)
            if found:
                outcome.different[f"{limb.name} ({form})"] = ", ".join(found[:8])
            outcome.compared[form] = outcome.compared.get(form, 0) + 1
            outcome.uncompared.pop(limb.name, None)
            break


def _spread(limbs: Sequence[Limb], most: int) -> list[Limb]:
    """At most so many limbs, from the first to the last in even steps."""
    steps = min(most, len(limbs))
    return [limbs[number * len(limbs) // steps] for number in range(steps)]


def _bodies(description: Description, usable: list[Form]) -> list[str]:
    """Names of all bodies of an MJCF file, in its order."""
    if description.format == "urdf" or not usable:
        return []
    return [body.name for body in spec_of(description, usable[-1]).bodies[1:]]


def _written_out(description: Description) -> bytes:
    """The source, MJCF includes written into it."""
    tree = xml.parse(description.source, file=description.file)
    if description.format == "urdf" or next(tree.iter("include"), None) is None:
        return description.source
    flatten_includes(tree, description.folder, file=description.file, packages=description.packages)
    return xml.serialize(tree)


def _check_source(before: bytes, variant: Variant, limb: str, bodies: list[str], outcome: Outcome) -> None:
    if any(loss.kind == "format" and loss.name != "include" for loss in variant.lost):
        return  # MuJoCo wrote the file
    foreign = foreign_lines(before, variant.description.source)
    if foreign > len(variant.lost) and before.count(b"\n") > 2:
        outcome.different[f"{limb} (source)"] = f"{foreign} lines are new, {len(variant.lost)} losses are listed"
    gone = {*variant.removed, *(loss.name for loss in variant.lost if loss.kind in ("body", "link"))}
    silent = unexplained(before, variant.description.source, gone, variant.lost, bodies)
    if silent:
        outcome.different[f"{limb} (source)"] = f"gone without a reason: {', '.join(silent[:5])}"


def main() -> None:
    """Try the files that stdin lists, one a line; print `START file`, then its outcomes as JSON.

    Arguments: the collection's folder, how many limbs to cut of a robot, and the parts.
    """
    plan = Plan(Path(sys.argv[1]).resolve(), sys.argv[3:], int(sys.argv[2]))
    mujoco_spec.read_for_mujoco = lru_cache(maxsize=1000)(
        mujoco_spec.read_for_mujoco
    )  # robots of a collection share meshes
    for line in sys.stdin:
        path = line.strip()
        print("START", path, flush=True)
        for outcome in survey(path, plan):
            print(json.dumps(asdict(outcome)), flush=True)
        print("END", path, flush=True)


if __name__ == "__main__":
    main()
