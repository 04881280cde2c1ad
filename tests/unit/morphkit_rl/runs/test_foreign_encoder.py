"""The text encoder that a run's `config.json` names is somebody else's choice."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from morphkit.errors import CheckpointError, ConfigError, DependencyError
from morphkit.registry import load
from morphkit_cli.main import run as command
from morphkit_rl.algorithms.policy import Policy
from morphkit_rl.evaluation.evaluate import evaluate
from morphkit_rl.text.encoder import TextEncoder
from morphkit_rl.training.trainer import resume, train
from tests.support.networks import TEXTS
from tests.support.run_folders import small_config


@pytest.fixture(scope="module")
def whole(tiny_bert: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = tmp_path_factory.mktemp("whole") / "run"
    train([load("hopper_3")], run, small_config(f"text.encoder={json.dumps(str(tiny_bert))}"), steps=20)
    return run


@pytest.fixture
def run(whole: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(whole, tmp_path / "run"))


def name_encoder(run: Path, name: str) -> None:
    config = json.loads((run / "config.json").read_text())
    config["config"]["text"]["encoder"] = name
    (run / "config.json").write_text(json.dumps(config))


@pytest.mark.parametrize("name", ["somebody/model", "bert-base-uncased", "", "/tmp", "./minilm", "minilm "])
def test_nothing_is_read_or_fetched_because_a_run_says_so(
    name: str, run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    name_encoder(run, name)

    def fail(name: str) -> None:
        raise AssertionError(f"looked for {name}")

    monkeypatch.setattr("morphkit_rl.text.encoder.find_model", fail)
    for use in (lambda: Policy.load(run), lambda: resume(run, steps=40), lambda: evaluate(run, [load("hopper_3")])):
        with pytest.raises(ConfigError, match=r"does not ship with morphkit.*--encoder"):
            use()
    for arguments in (["evaluate", str(run), "hopper_3"], ["train", "--run", str(run), "--resume", "--steps", "40"]):
        assert command(arguments) == 2
        assert capsys.readouterr().err.startswith("error: ")


def test_an_encoder_that_the_user_names_is_taken(run: Path, tiny_bert: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    name_encoder(run, "elsewhere/bert")
    assert Policy.load(run, encoder=str(tiny_bert)).embedder.source.size == 8
    resume(run, steps=40, encoder=str(tiny_bert))
    assert json.loads((run / "config.json").read_text())["config"]["text"]["encoder"] == "elsewhere/bert"
    assert command(["evaluate", str(run), "hopper_3", "--episodes", "1", "--encoder", str(tiny_bert)]) == 0
    name_encoder(run, str(tiny_bert))
    monkeypatch.setenv("MORPHKIT_ENCODERS", f"other, {tiny_bert}")
    Policy.load(run)


def test_an_encoder_of_another_size_is_refused(run: Path) -> None:
    with pytest.raises(CheckpointError, match="embeddings of size 8"):
        Policy.load(run, encoder="minilm")
    with pytest.raises(CheckpointError, match="does not fit the run"):
        resume(run, steps=40, encoder="minilm")


def test_a_new_run_takes_its_encoder_from_its_settings(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command(["train", "hopper_3", "--run", str(tmp_path / "run"), "--encoder", "minilm"]) == 2
    assert "--set text.encoder=NAME_OR_FOLDER" in capsys.readouterr().err


@pytest.mark.parametrize("kind", ["bert", "strange"])
def test_code_that_comes_with_an_encoder_is_never_run(kind: str, tiny_bert: Path, tmp_path: Path) -> None:
    folder, trace = tmp_path / "model", tmp_path / "trace"
    shutil.copytree(tiny_bert, folder)
    (folder / "code.py").write_text(f"open({str(trace)!r}, 'w').close()\nclass Model: pass\n")
    names = {"AutoConfig": "code.Model", "AutoModel": "code.Model"}
    config = json.loads((folder / "config.json").read_text())
    (folder / "config.json").write_text(json.dumps({**config, "model_type": kind, "auto_map": names}))
    tokenizer = folder / "tokenizer_config.json"
    values = json.loads(tokenizer.read_text()) if tokenizer.exists() else {}
    tokenizer.write_text(json.dumps({**values, "auto_map": {"AutoTokenizer": ["code.Model", "code.Model"]}}))
    encoder = TextEncoder(str(folder), cache_dir=tmp_path / "cache")
    if kind == "bert":
        assert encoder.encode(TEXTS).shape == (len(TEXTS), 8)
    else:
        with pytest.raises(DependencyError, match="cannot be loaded"):
            encoder.encode(TEXTS)
    assert not trace.exists()
