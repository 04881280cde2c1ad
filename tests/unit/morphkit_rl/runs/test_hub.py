"""Policies go to a stand-in for the Hugging Face hub and come back."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from morphkit.errors import CheckpointError, DependencyError, OutputError
from morphkit.registry import load
from morphkit_cli.main import run as morphkit
from morphkit_rl.algorithms.policy import Policy
from morphkit_rl.training.trainer import train
from tests.support.hub_server import hub_server
from tests.support.run_folders import small_config


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("hub") / "run"
    train([load("hopper_3")], folder, small_config(), steps=16)
    return folder


def test_a_policy_that_was_pushed_comes_back(
    run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with hub_server() as server:
        monkeypatch.setenv("HF_TOKEN", "hf_none")
        with monkeypatch.context() as patched:
            patched.setattr("huggingface_hub.constants.ENDPOINT", server.url)
            assert morphkit(["push", str(run), "me/hoppers"]) == 0
        assert capsys.readouterr().out == f"{server.url}/me/hoppers\n"
        files = server.repositories["me/hoppers"]
        assert files.keys() == {
            *("README.md", "config.json", "policy.json", "policy.safetensors", "robots/000-hopper_3.xml"),
        }
        assert b"# hoppers" in files["README.md"]
        assert b"Its returns were not measured." in files["README.md"]
        own, policy = Policy.load(run), Policy.from_hub("me/hoppers", endpoint=server.url)
        (robot,) = policy.prepare([load("hopper_3")])
        obs = np.random.default_rng(0).standard_normal((4, len(robot.spec.sensors))).astype(np.float32)
        np.testing.assert_array_equal(policy.act(robot.spec, obs), own.act(robot.spec, obs))
        own.push_to_hub("me/again", card="mine\n", endpoint=server.url)
        assert server.repositories["me/again"]["README.md"] == b"mine\n"
        with pytest.raises(CheckpointError, match="me/nothing: Hugging Face hub: "):
            Policy.from_hub("me/nothing", endpoint=server.url)


def test_what_cannot_be_reached_or_named_is_one_line(
    run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("HF_TOKEN", "hf_none")
    assert morphkit(["push", str(run), "a/b/c"]) == 2
    assert capsys.readouterr().err.startswith("error: a/b/c: Hugging Face hub: ")
    with pytest.raises(OutputError, match="me/hoppers: Hugging Face hub: "):
        Policy.load(run).push_to_hub("me/hoppers", endpoint="http://127.0.0.1:9")
    monkeypatch.setitem(sys.modules, "huggingface_hub", None)
    with pytest.raises(DependencyError, match=r"morphkit\[hub\]"):
        Policy.from_hub("me/hoppers")
