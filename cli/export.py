"""`morphkit export`: a policy for one robot as a file that other programs run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from . import common
from .terminal import note

EXAMPLES = (
    "morphkit export runs/first cheetah --onnx policy.onnx",
    "morphkit export runs/own my_robot.urdf --torchscript policy.pt",
)


def export(
    run: common.PolicyArgument,
    robot: common.RobotArgument,
    onnx: Annotated[Path | None, typer.Option("--onnx", metavar="FILE", help="Write ONNX, for onnxruntime.")] = None,
    torchscript: Annotated[
        Path | None, typer.Option("--torchscript", metavar="FILE", help="Write TorchScript, for PyTorch and libtorch.")
    ] = None,
    task: common.RunTaskOption = None,
    base: common.RunBaseOption = None,
    checkpoint: common.CheckpointOption = "latest",
    encoder: common.EncoderOption = None,
    root: common.RootOption = None,
    package: common.PackageOption = None,
    xacro_arg: common.XacroArgOption = None,
    trust_xacro: common.TrustXacroOption = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print what was written as JSON.")] = False,
) -> None:
    """Write a policy for one robot as a file that runs without morphkit.

    Actor, observation statistics and the robot's names are baked in. The input is a raw observation in the order of the
    robot's sensor tokens (see morphkit tokens), the output its controls in actuator order and units; names, units and
    control frequency are in the file's metadata.
    """
    if onnx is None and torchscript is None:
        raise common.UsageError("say what to write: --onnx FILE, --torchscript FILE, or both.")
    (body,) = common.load_robots(robot, root=root, package=package, xacro_arg=xacro_arg, trust_xacro=trust_xacro)

    from morphkit_rl.algorithms.policy import Policy
    from morphkit_rl.export.write import export_onnx, export_torchscript

    policy = Policy.load(run, encoder=encoder, checkpoint=checkpoint)
    (prepared,) = policy.prepare([body], task=task, base=base)
    written = []
    for path, write in ((onnx, export_onnx), (torchscript, export_torchscript)):
        if path is not None:
            difference = write(policy, prepared, path)
            written.append({"file": str(path), "robot": prepared.name, "largest_difference": difference})
            note(f"{path}: controls differ from the policy's by at most {difference:.1e}")
    if as_json:
        common.print_json(written)
