"""`morphkit coverage`: how much of a robot a policy knows, before anything runs."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import typer

from morphkit.utils.printable import one_line

from . import common
from .table import table, terminal_width
from .terminal import write

if TYPE_CHECKING:
    from morphkit_rl.evaluation.coverage import Coverage

EXAMPLES = (
    "morphkit coverage zoo:cheetah-family my_robot.urdf",
    "morphkit coverage runs/first cheetah --json",
)


def coverage(
    run: common.PolicyArgument,
    robot: common.RobotArgument,
    task: common.RunTaskOption = None,
    base: common.RunBaseOption = None,
    encoder: common.EncoderOption = None,
    root: common.RootOption = None,
    package: common.PackageOption = None,
    xacro_arg: common.XacroArgOption = None,
    trust_xacro: common.TrustXacroOption = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, with every token.")] = False,
) -> None:
    """Say how much of a robot a policy was trained on, before anything runs.

    Lists, limb by limb, how many token texts training had and which trained text is nearest to the strangest of the
    others; what is unlike the training bodies; and a predicted normalized return, where returns were measured.
    """
    (body,) = common.load_robots(robot, root=root, package=package, xacro_arg=xacro_arg, trust_xacro=trust_xacro)

    from morphkit_rl.evaluation.coverage import coverage as compare

    found = compare(run, body, encoder=encoder, task=task, base=base)
    if as_json:
        common.print_json(asdict(found))
    else:
        write(_text(found))


def _text(found: Coverage) -> str:
    known = sum(match.trained for match in found.texts)
    lines = [f"{found.robot}: {known} of {len(found.texts)} token texts are those of training"]
    if not found.reads_names:
        lines.append("the policy's method reads no names, so that texts do not matter to it")
    if found.mirrored:
        lines.append(
            "the policy acts as for the mirror image, which training knew better: texts are those of the image"
        )
    rows = []
    for limb in found.limbs:
        strange = limb.farthest
        new = limb.trained < limb.tokens
        texts = (strange.text, strange.nearest, f"{strange.cosine:.2f}") if new else ("-", "-", "-")
        rows.append((limb.limb, f"{limb.trained} of {limb.tokens}", *texts))
    columns = ("limb", "trained", "strangest text", "nearest of training", "cosine")
    shown = table(columns, rows, right=("trained", "cosine"), width=terminal_width())
    if found.rests:
        lines.append(f"limbs that rest, since training had none of their names: {', '.join(found.rests)}")
    for each in found.outside:
        lines.append(
            f"outside of training: {each.what} {each.value:.4g}, training had {each.low:.4g} to {each.high:.4g}"
        )
    if not found.outside and not any(note.startswith("sizes") for note in found.notes):
        lines.append("number of limbs, masses, height and joint ranges are within those of training")
    first, *more = map(one_line, [*lines, *_prediction(found), *found.notes])
    return "\n".join([first, "", shown + "\n".join(["", *more])]) + "\n"


def _prediction(found: Coverage) -> list[str]:
    predicted = found.prediction
    if predicted is None:
        return []
    whose = {
        "held-out": f"the errors on {predicted.bodies} held-out bodies",
        "leave-one-out": f"leave-one-out errors over {predicted.bodies} training bodies, which is too good",
    }[predicted.calibrated_on]
    one = {"expert": "an expert's return", "training bodies": "the median return over the training bodies"}
    rank = "" if predicted.rank_correlation is None else f"; rank correlation there {predicted.rank_correlation:.2f}"
    return [
        f"predicted normalized return {predicted.value:.2f}, 90 % interval {predicted.low:.2f} to {predicted.high:.2f}",
        f"(1 is {one[predicted.reference]}; interval from {whose}{rank})",
    ]
