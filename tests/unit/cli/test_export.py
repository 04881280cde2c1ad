"""`morphkit export`, from a run of a few steps."""

from __future__ import annotations

import json
from pathlib import Path

import onnxruntime

from morphkit_cli.main import run

TINY = ("model.d_model=8", "model.layers=1", "model.feedforward=8", "td3.batch_size=4", "trainer.num_envs=1")


def test_a_run_becomes_an_onnx_file(tmp_path: Path, capsys) -> None:
    settings = [word for setting in TINY for word in ("--set", setting)]
    folder, file = str(tmp_path / "run"), tmp_path / "policy.onnx"
    assert run(["train", "hopper_3", "--run", folder, "--steps", "4", "--quiet", *settings]) == 0
    assert run(["export", folder, "hopper_4", "--onnx", str(file), "--json"]) == 0
    (written,) = json.loads(capsys.readouterr().out)
    assert written["robot"] == "hopper_4"
    assert written["largest_difference"] < 1e-5
    about = onnxruntime.InferenceSession(file).get_modelmeta().custom_metadata_map
    assert json.loads(about["actuator_names"]) == ["thigh_ctrl", "leg_ctrl", "foot_ctrl"]
    assert run(["export", folder, "hopper_4"]) == 2
    assert "say what to write" in capsys.readouterr().err
    assert run(["export", str(tmp_path / "none"), "hopper_4", "--onnx", str(file)]) == 2
    assert capsys.readouterr().err.startswith(f"error: {tmp_path / 'none'}: no such run folder")
