"""`morphkit ablate`: cut limbs off a robot."""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from . import common
from .table import table, terminal_width

if TYPE_CHECKING:
    from morphkit.ablation import Variant
    from morphkit.description import Description

EXAMPLES = (
    "morphkit ablate cheetah --remove foot",
    "morphkit ablate hopper --splice lower_leg --name short_hopper",
    "morphkit ablate my_robot.urdf --all --min-limbs 3 --output family",
)


def ablate(
    robot: Annotated[str, typer.Argument(metavar="ROBOT", help="Name of a shipped robot, or a URDF or MJCF file.")],
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
    name: Annotated[str | None, typer.Option(help="Name of the variant.", show_default="ROBOT-no-LIMB...")] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="DIR",
            help="Output folder.",
            show_default="the variant's name; with --all, ROBOT-family",
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an output folder that holds other files.")] = False,
    root: Annotated[
        str | None, typer.Option(metavar="NAME", help="The top-level body to take, where the file has several.")
    ] = None,
    package: common.PackageOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the manifest as JSON.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")] = False,
) -> None:
    """Cut limbs off a robot and write the variants, with a manifest.json that says what is gone.

    A URDF stays a URDF and an MJCF an MJCF: comments, defaults, units and what morphkit does not
    know survive. What refers to a removed limb, such as its motors, goes too and is listed.
    """
    remove, splice = remove or [], splice or []
    _check_usage(remove, splice, every=every, name=name)

    from morphkit.ablation import ablate as cut
    from morphkit.family import sub_morphologies
    from morphkit.io.packages import parse_packages
    from morphkit.manifest import write_family
    from morphkit.robots import load

    description = load(robot, root=root, packages=parse_packages(package or []))
    if every:
        found = sub_morphologies(description, min_limbs=min_limbs, max_limbs=max_limbs, limit=limit)
        variants = list(islice(found, limit))
        folder = output or Path(f"{description.name}-family")
        if not variants:
            _no_variant(description, min_limbs, max_limbs)
    else:
        variants = [cut(description, remove=remove, splice=splice, name=name)]
        folder = output or Path(variants[0].description.name)

    manifest = write_family(description, variants, folder, force=force)
    if as_json:
        import json

        common.print_json({"folder": str(folder), **json.loads(manifest.read_text(encoding="utf-8"))})
    elif not quiet:
        shown = _family(variants) if every else _matches(description, remove, splice) + _variant(variants[0])
        sys.stdout.write(
            f"{shown}\nwritten: {folder}/ ({common.count(len(variants), 'variant')} and {manifest.name})\n"
        )


def _check_usage(remove: Sequence[str], splice: Sequence[str], *, every: bool, name: str | None) -> None:
    if every and (remove or splice or name):
        raise common.UsageError("--all makes every variant; leave out --remove, --splice and --name.")
    if name is not None and not re.fullmatch(r"\w[\w.-]*", name):
        raise common.UsageError(f"--name '{name}': a name has letters, digits, '_', '-' and '.' only.")
    if not every and not (remove or splice):
        raise common.UsageError("say what to cut: --remove LIMB, --splice LIMB, or --all for every variant.")


def _no_variant(description: Description, min_limbs: int, max_limbs: int | None) -> None:
    from morphkit.errors import AblationError
    from morphkit.io import read

    limbs = len(read(description).limbs)
    wanted = f"{min_limbs} or more" if max_limbs is None else f"{min_limbs} to {max_limbs}"
    raise AblationError(
        f"{description.name} has {common.count(limbs, 'limb')}, and no variant of it has {wanted}; "
        "change --min-limbs or --max-limbs."
    )


def _matches(description: Description, remove: Sequence[str], splice: Sequence[str]) -> str:
    from morphkit.io import read
    from morphkit.naming import match_limbs

    morphology = read(description)
    patterns = [*(("remove", pattern) for pattern in remove), *(("splice", pattern) for pattern in splice)]
    return "".join(
        f"{verb} '{pattern}' matched: {', '.join(match_limbs(morphology, pattern))}\n" for verb, pattern in patterns
    )


def _variant(variant: Variant) -> str:
    lines = [
        f"{word + ':':<10}{', '.join(limbs)}\n"
        for word, limbs in (("removed", variant.removed), ("spliced", variant.spliced), ("left", variant.limbs))
        if limbs
    ]
    if variant.lost:
        lines.append(f"\n{common.count(len(variant.lost), 'other element')} lost:\n")
        rows = [(loss.kind, loss.name or "-", loss.limb or "-", loss.reason) for loss in variant.lost]
        lines.append(table(("kind", "name", "limb", "reason"), rows, fold=True, width=terminal_width()))
    return "".join(lines)


def _family(variants: Sequence[Variant]) -> str:
    rows = [
        (
            variant.description.name,
            str(len(variant.limbs)),
            ", ".join((*variant.removed, *variant.spliced)),
            str(len(variant.lost)),
            ", ".join(variant.limbs),
        )
        for variant in variants
    ]
    return table(
        ("variant", "limbs", "gone", "also lost", "left"),
        rows,
        right=("limbs", "also lost"),
        dispensable=("also lost", "gone"),
        fold=True,
        width=terminal_width(),
    )
