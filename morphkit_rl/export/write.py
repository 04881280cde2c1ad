"""A policy for one robot as an ONNX or a TorchScript file."""

from __future__ import annotations

import io
import json
import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch

from morphkit.errors import DependencyError, OutputError
from morphkit.utils.atomic_write import write_output
from morphkit_rl.algorithms.baked_policy import BakedPolicy
from morphkit_rl.algorithms.policy import Policy
from morphkit_rl.envs.robot import Robot
from morphkit_rl.export.interface import INPUT, OUTPUT, interface_of
from morphkit_rl.kernels import library

TOLERANCE = 1e-4
"""Largest difference from the policy that is let pass, relative to the largest control."""
EXTRA_FILE = "morphkit.json"
"""Name of the metadata within a TorchScript file."""
_TRACED, _CHECKED = 3, 64  # batches; a size of 1 would be taken for a constant


def export_onnx(policy: Policy, robot: Robot, path: str | Path) -> float:
    """Write an ONNX file: input `observation` (batch, tokens), output `control` (batch, actuators), both float32.

    Observations are raw, in token order and the tokens' units, controls in actuator order and units. The metadata
    holds an `Interface`, lists as JSON.

    Args:
        policy: The policy.
        robot: The robot, from `policy.prepare`.
        path: The file, which is replaced where it exists.

    Returns:
        Largest difference from the policy's controls on random observations, computed with onnxruntime on the CPU.

    Raises:
        DependencyError: onnx, onnxscript or onnxruntime is not installed.
        OutputError: The file cannot be written, or what it computes is not what the policy does.
    """
    runtime = _require_onnx()
    with _traceable(policy, robot) as (baked, obs), _quiet():
        program = torch.export.export(baked, (obs,), dynamic_shapes=({0: torch.export.Dim("batch")},), strict=False)
        made: Any = torch.onnx.export(
            program, input_names=[INPUT], output_names=[OUTPUT], external_data=False, verbose=False
        )
    made.model.metadata_props.update(interface_of(policy, robot).to_metadata())
    content = made.model_proto.SerializeToString()
    options = runtime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = runtime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    return _write(Path(path), content, policy, robot, lambda obs: session.run([OUTPUT], {INPUT: obs})[0])


def export_torchscript(policy: Policy, robot: Robot, path: str | Path) -> float:
    """Write a TorchScript file, for `torch.jit.load` and libtorch; its extra file `morphkit.json` is the metadata.

    Otherwise as `export_onnx`, without further packages.
    """
    extra = {EXTRA_FILE: json.dumps(asdict(interface_of(policy, robot)))}
    buffer = io.BytesIO()
    with _traceable(policy, robot) as (baked, obs), _quiet():
        script = torch.jit.freeze(torch.jit.trace(baked, (obs,), check_trace=False).eval(), optimize_numerics=False)
        torch.jit.save(script, buffer, _extra_files=extra)
        script = torch.jit.load(io.BytesIO(buffer.getvalue()))
    return _write(Path(path), buffer.getvalue(), policy, robot, lambda obs: script(torch.from_numpy(obs)).numpy())


@contextmanager
def _traceable(policy: Policy, robot: Robot) -> Iterator[tuple[BakedPolicy, torch.Tensor]]:
    """The policy for a robot, with what depends on names alone computed, and observations to trace it with."""
    with library.suspended(), torch.no_grad():
        baked = policy.bake(robot.spec)
        obs = torch.zeros(_TRACED, len(robot.spec.sensors))
        baked(obs)  # what is computed once must not become a part of the trace
        yield baked, obs


def _write(path: Path, content: bytes, policy: Policy, robot: Robot, run: Any) -> float:
    obs = np.random.default_rng(0).standard_normal((_CHECKED, len(robot.spec.sensors))).astype(np.float32)
    expected = policy.act(robot.spec, obs)
    difference = float(np.abs(run(obs) - expected).max(initial=0.0))
    if not difference <= TOLERANCE * max(1.0, float(np.abs(expected).max(initial=0.0))):
        raise OutputError(f"{path}: not written: its controls differ from the policy's by {difference:.3g}")
    write_output(path, lambda file: file.write_bytes(content))
    return difference


@contextmanager
def _quiet() -> Iterator[None]:
    """Around exporters that speak of their deprecation and of every step."""
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings(), redirect_stdout(io.StringIO()):
            warnings.simplefilter("ignore")
            yield
    finally:
        logger.setLevel(level)


def _require_onnx() -> Any:
    try:
        import onnx  # noqa: F401
        import onnxruntime
        import onnxscript  # noqa: F401
    except ImportError as error:
        raise DependencyError(f"ONNX needs {error.name}; install it with: pip install 'morphkit[export]'") from None
    return onnxruntime
