"""`morphkit ablate`: cut limbs off a robot."""

from __future__ import annotations

import json
import re
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from morphkit.utils.printable import one_line

from . import ablate_plan as plans
from . import ablate_report as report
from . import common
from .terminal import note, write

if TYPE_CHECKING:
    from morphkit.ablation.ablate import Cutter, Variant
    from morphkit.description import Description
    from morphkit.families.build import Made
    from morphkit.families.enumeration import Planned

NOT_COMPILED = "the variants were not compiled, because MuJoCo cannot compile the robot itself"

EXAMPLES = (
    "morphkit ablate cheetah --remove foot",
    "morphkit ablate hopper --splice lower_leg --name short_hopper",
    "morphkit ablate quadruped --remove FL_calf --mirror --dry-run",
    "morphkit ablate quadruped --scale length=0.8:1.2 --scale mass=0.9:1.1 --samples 10 --seed 1",
    "morphkit ablate my_robot.urdf --all --skip-mirrored --limit 100 --jobs 2",
)


def ablate(
    robot: common.RobotArgument,
    remove: Annotated[
        list[str] | None,
        typer.Option(
            "--remove",
            metavar="LIMB",
            help="Remove a limb with everything below it: a name, else a glob ('*foot'), else a limb type ('foot'). "
            "Several give one variant without any of them.",
        ),
    ] = None,
    splice: Annotated[
        list[str] | None,
        typer.Option("--splice", metavar="LIMB", help="Take a limb out and move its children up to its parent."),
    ] = None,
    keep: Annotated[
        list[str] | None,
        typer.Option("--keep", metavar="LIMB", help="Keep only such limbs and what connects them to the root."),
    ] = None,
    mirror: Annotated[
        bool, typer.Option("--mirror", help="Do the same to the counterparts on the other side, left or right.")
    ] = False,
    every: Annotated[bool, typer.Option("--all", help="Make every body that is left when limbs are removed.")] = False,
    min_limbs: Annotated[
        int, typer.Option(min=1, metavar="N", help="With --all: fewest limbs of a variant, root included.")
    ] = 2,
    max_limbs: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="With --all: most limbs of a variant.")
    ] = None,
    limit: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="With --all: make the first N variants only.")
    ] = None,
    skip_mirrored: Annotated[
        bool, typer.Option("--skip-mirrored", help="With --all: leave out mirror images of earlier variants.")
    ] = False,
    scale: Annotated[
        list[str] | None,
        typer.Option(
            "--scale",
            metavar="WHAT=LOW:HIGH",
            help="Scale each limb's 'length', 'mass' or 'gain' (forces of its motors) by a factor drawn from a range, "
            "or by one factor: WHAT=FACTOR. Mirror images share theirs. Can be given for each of the three.",
        ),
    ] = None,
    samples: Annotated[
        int, typer.Option(min=1, metavar="N", help="With --scale: make N bodies, of each variant with --all.")
    ] = 1,
    seed: Annotated[int, typer.Option(min=0, metavar="N", help="With --scale: seed of the factors.")] = 0,
    keep_assets: Annotated[
        bool,
        typer.Option(
            "--keep-assets/--drop-assets", help="Whether meshes and materials stay that only removed limbs used."
        ),
    ] = True,
    assets: Annotated[
        Literal["copy", "reference"],
        typer.Option(help="Copy meshes and textures, so that the folder can be moved, or refer to them."),
    ] = "copy",
    compiled: Annotated[
        bool, typer.Option("--compile/--no-compile", help="Whether MuJoCo has to compile a variant.")
    ] = True,
    jobs: Annotated[int, typer.Option(min=1, metavar="N", help="Worker processes that make variants.")] = 1,
    name: Annotated[str | None, typer.Option(help="Name of the variant.", show_default="ROBOT-no-LIMB...")] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="DIR",
            help="Output folder.",
            show_default="the variant's name, with --scale and -scaled; with --all, ROBOT-family",
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an output folder that holds other files.")] = False,
    root: common.RootOption = None,
    package: common.PackageOption = None,
    xacro_arg: common.XacroArgOption = None,
    trust_xacro: common.TrustXacroOption = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Show what would go and what else would be lost; write nothing.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the manifest as JSON.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")] = False,
) -> None:
    """Cut limbs off a robot, or scale them, and write the variants, with a manifest.json that says what is gone.

    A URDF stays a URDF and an MJCF an MJCF: comments, defaults, units and what morphkit does not
    know survive. What refers to a removed limb, such as its motors, goes too and is listed.
    """
    wish = {"remove": remove or [], "splice": splice or [], "keep": keep or []}
    if samples > 1 and not scale:
        raise common.UsageError("--samples goes with --scale: without it all bodies would be the same.")
    how = plans.sampling(scale or [], samples, seed)
    _check_usage(wish, mirror=mirror, every=every, skip_mirrored=skip_mirrored, name=name, scaled=how is not None)

    from morphkit.ablation.ablate import Cutter
    from morphkit.families.scaled import plan_one, plan_scaled
    from morphkit.families.write import write_family

    (description,) = common.load_robots(robot, root=root, package=package, xacro_arg=xacro_arg, trust_xacro=trust_xacro)
    cutter = Cutter(description)
    source, notes = cutter.description, list[str]()
    check, drop = compiled and not dry_run, not keep_assets
    title = "" if every else report.matches(cutter, wish, mirror=mirror)
    if every:
        bounds = {"min_limbs": min_limbs, "max_limbs": max_limbs, "limit": limit, "skip_mirrored": skip_mirrored}
        found = _family(cutter, plans.plan_family(cutter, how, bounds), jobs, check, drop, notes)
        folder = output or Path(f"{source.name}-family")
    elif how is not None:
        body = plan_one(cutter, **wish, mirror=mirror, name=name)
        found = _must_work(_family(cutter, plan_scaled(cutter, [body], how), jobs, check, drop, notes))
        folder = output or Path(f"{body.name}-scaled")
    else:
        variant = cutter.ablate(**wish, mirror=mirror, drop_assets=drop, name=name)
        found = _one(source, variant, check, notes)
        folder = output or Path(variant.description.name)
    several = every or how is not None
    tally = report.Tally(every=several, title=title)
    if dry_run:
        _show_plan(cutter, map(tally.enter, found), tally, as_json=as_json, quiet=quiet)
        return

    made = report.with_progress(map(tally.enter, found), limit=limit, quiet=quiet or not several)
    manifest = write_family(source, made, folder, force=force, assets=assets, notes=notes)
    if as_json:
        common.print_json({"folder": str(folder), **json.loads(manifest.read_text(encoding="utf-8"))})
    elif not quiet:
        written = f"{common.count(tally.made, 'variant')} and {manifest.name}"
        write(f"{tally.text()}\nwritten: {one_line(str(folder))}/ ({written})\n")
    for each in tally.failed:
        note(f"failed: {each.name}: {each.reason}")
    problems = [*notes, *(_refused(manifest, source, jobs) if check and not notes else ())]
    for problem in problems:
        common.complain(problem)
    if problems or tally.failed:
        raise typer.Exit(2 if problems else 1)


def _check_usage(
    wish: Mapping[str, Sequence[str]], *, mirror: bool, every: bool, skip_mirrored: bool, name: str | None, scaled: bool
) -> None:
    asked = any(wish.values())
    if every and (asked or mirror or name):
        raise common.UsageError("--all makes every variant; leave out --remove, --splice, --keep, --mirror and --name.")
    if name is not None and not re.fullmatch(r"\w[\w.-]*", name):
        raise common.UsageError(f"--name '{name}': a name has letters, digits, '_', '-' and '.' only.")
    if not every and not asked and not scaled:
        raise common.UsageError(
            "say what to cut: --remove LIMB, --splice LIMB, --keep LIMB, or --all for every variant;"
            " or what to scale: --scale length=0.8:1.2."
        )
    if skip_mirrored and not every:
        raise common.UsageError("--skip-mirrored goes with --all; one variant has no other to be the image of.")


def _family(
    cutter: Cutter, planned: Iterator[Planned], jobs: int, check: bool, drop: bool, notes: list[str]
) -> Iterator[Made]:
    from morphkit.families import build

    if check and (problem := build.compile_problem(cutter.description)):
        notes.append(f"{NOT_COMPILED}: {problem}")
        check = False
    return build.make(cutter, planned, jobs=jobs, compiled=check, drop_assets=drop)


def _must_work(found: Iterator[Made]) -> Iterator[Made]:
    """`found`; an error where the first cannot be made, since the others are scaled like it."""
    from morphkit.errors import AblationError
    from morphkit.families.build import FailedVariant

    first = next(found)
    if isinstance(first, FailedVariant):
        raise AblationError(f"{first.name}: {first.reason}")
    return chain([first], found)


def _one(source: Description, variant: Variant, check: bool, notes: list[str]) -> Iterator[Made]:
    from morphkit.families import build

    result = build.check_variant(variant) if check else variant
    if isinstance(result, build.FailedVariant) and (problem := build.compile_problem(source)):
        notes.append(f"{NOT_COMPILED}: {problem}")
        result = variant
    yield result


def _refused(manifest: Path, source: Description, jobs: int) -> Iterator[str]:
    """What MuJoCo says of the written MJCF files that it cannot load where they lie, such as for want of a mesh."""
    from morphkit.families import build
    from morphkit.families.manifest import read_manifest

    family = read_manifest(manifest, check_files=False)
    missing = any(loss.kind == "asset" for variant in family.variants for loss in variant.lost)
    if family.source_format == "mjcf" and (family.assets or family.references or missing):
        files = (manifest.parent / variant.file for variant in family.variants)
        for path, reason in build.load_problems(files, source, jobs=jobs):
            yield f"{path} was written, but MuJoCo cannot load it: {reason}"


def _show_plan(cutter: Cutter, variants: Iterator[Made], tally: report.Tally, *, as_json: bool, quiet: bool) -> None:
    if as_json:
        common.print_json({"dry_run": True, "variants": [report.as_json(each) for each in variants]})
        return
    last = deque(variants, maxlen=1)  # of a family the tally has what is shown
    if not quiet:
        tree = "" if tally.every else report.tree(cutter.morphology, last[0]) + "\n"
        write(f"{tree}{tally.text()}\nnothing written: dry run\n")
