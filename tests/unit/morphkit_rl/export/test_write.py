"""Exported policies compute what the policy does, and say of whom they are."""

from __future__ import annotations

import json
import runpy
import sys
from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np
import onnxruntime
import pytest
import torch

from morphkit.errors import DependencyError, OutputError
from morphkit.registry import load
from morphkit_rl.algorithms.normalizer import Normalizer
from morphkit_rl.algorithms.policy import Policy
from morphkit_rl.config.methods import find_method, method_names
from morphkit_rl.config.train_config import load_config
from morphkit_rl.envs.batch_env import BatchEnv
from morphkit_rl.envs.robot import Robot, prepare
from morphkit_rl.export import write
from morphkit_rl.export.write import EXTRA_FILE, export_onnx, export_torchscript
from morphkit_rl.models import build
from morphkit_rl.models.vocabulary import Vocabulary
from tests.support.networks import SIZE, embed, tiny_overrides

EXAMPLE = Path(__file__).parents[4] / "examples" / "run_onnx.py"


def policy_for(method: str, robot: Robot) -> Policy:
    """A policy with random weights and observation statistics."""
    config = load_config(overrides=tiny_overrides(method))
    torch.manual_seed(0)
    vocabulary = Vocabulary.of([robot.spec])
    actor, _ = build(config.model, SIZE, vocabulary)
    normalizer = Normalizer()
    index = normalizer.index([robot.spec], grow=True)
    normalizer.update(np.random.default_rng(1).normal(0.3, 2.0, (50, len(index))), index)
    embedder = type("Embedder", (), {"size": SIZE, "__call__": staticmethod(embed)})()
    return Policy(actor, normalizer, embedder, config, vocabulary=vocabulary)


@pytest.mark.parametrize("method", method_names())
def test_both_formats_equal_the_policy_for_every_method(method: str, tmp_path: Path) -> None:
    robot = prepare(load("walker_4_main"))
    policy = policy_for(method, robot)
    obs = np.random.default_rng(2).normal(0, 3, (1000, len(robot.spec.sensors))).astype(np.float32)
    expected = policy.act(robot.spec, obs)
    assert np.ptp(expected) > 0.01
    assert export_onnx(policy, robot, tmp_path / "policy.onnx") < 1e-5
    session = onnxruntime.InferenceSession(tmp_path / "policy.onnx", providers=["CPUExecutionProvider"])
    np.testing.assert_allclose(session.run(["control"], {"observation": obs})[0], expected, rtol=0, atol=1e-5)
    np.testing.assert_allclose(session.run(["control"], {"observation": obs[:1]})[0], expected[:1], rtol=0, atol=1e-5)
    assert export_torchscript(policy, robot, tmp_path / "policy.pt") < 1e-5
    script = torch.jit.load(tmp_path / "policy.pt")
    np.testing.assert_allclose(script(torch.from_numpy(obs)).numpy(), expected, rtol=0, atol=1e-5)
    np.testing.assert_array_equal(policy.act(robot.spec, obs), expected)
    assert find_method(method).name == session.get_modelmeta().custom_metadata_map["method"]


def test_the_metadata_names_what_goes_in_and_out(tmp_path: Path) -> None:
    robot = prepare(load("arm"))
    policy = policy_for("limb-former", robot)
    export_torchscript(policy, robot, tmp_path / "policy.pt")
    files = {EXTRA_FILE: ""}
    torch.jit.load(tmp_path / "policy.pt", _extra_files=files)
    about = SimpleNamespace(**json.loads(files[EXTRA_FILE]))
    assert about.robot == "arm"
    assert about.sensor_names == [sensor.name for sensor in robot.spec.sensors]
    assert about.actuator_names == [actuator.name for actuator in robot.spec.actuators]
    assert about.actuator_units == [actuator.unit for actuator in robot.spec.actuators]
    timestep = robot.simulation.model.opt.timestep
    assert about.control_frequency_hz == pytest.approx(1 / (timestep * robot.task.frame_skip))
    ranges = [
        (joint, constant)
        for joint, quantity, constant in zip(
            about.sensor_joints, about.sensor_quantities, about.sensor_constants, strict=True
        )
        if quantity == "joint_range_low" and joint
    ]
    model = robot.simulation.model
    assert len(ranges) == model.njnt - len(robot.simulation.base_joints)
    for joint, low in ranges:  # the shoulder has two
        assert low == pytest.approx((180 + np.degrees(model.joint(joint).range[0])) / 360, abs=1e-6)


def test_the_example_senses_what_the_environment_does_and_drives(tmp_path: Path) -> None:
    robot = prepare(load("cheetah"))
    policy = policy_for("limb-former", robot)
    export_onnx(policy, robot, tmp_path / "policy.onnx")
    example = runpy.run_path(str(EXAMPLE))
    env = BatchEnv([robot.simulation], [robot.task], 1, specs=[robot.spec], seed=3)
    obs = env.reset()[0]
    for _ in range(5):
        obs = env.step([policy.act(robot.spec, obs)]).obs[0]
    file = Path(load("cheetah").folder or "") / "cheetah.xml"
    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = (values[0] for values in env.state(0))
    mujoco.mj_forward(model, data)
    session = onnxruntime.InferenceSession(tmp_path / "policy.onnx")
    about = session.get_modelmeta().custom_metadata_map
    tokens = list(zip(*(json.loads(about[key]) for key in example["KEYS"]), strict=True))
    np.testing.assert_allclose(example["sense"](model, data, tokens), obs, rtol=1e-5, atol=1e-5)
    before = data.body("torso").xpos[0]
    assert example["main"](tmp_path / "policy.onnx", str(file), seconds=0.5) != before
    env.close()


def test_what_cannot_be_written_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = prepare(load("hopper_3"))
    policy = policy_for("limb-former", robot)
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match=r"cannot write .*file/policy\.pt"):
        export_torchscript(policy, robot, tmp_path / "file" / "policy.pt")
    monkeypatch.setattr(write, "TOLERANCE", -1.0)
    with pytest.raises(OutputError, match=r"policy\.pt: not written: its controls differ from the policy's by"):
        export_torchscript(policy, robot, tmp_path / "policy.pt")
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(DependencyError, match=r"ONNX needs onnxruntime; .*morphkit\[export\]"):
        export_onnx(policy, robot, tmp_path / "policy.onnx")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_the_example_refuses_what_is_no_exported_policy(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "foreign.onnx").write_text("foreign")
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(EXAMPLE))["load"](str(tmp_path / "foreign.onnx"))
    assert ended.value.code == 2
    assert capsys.readouterr().err.count("\n") == 1
