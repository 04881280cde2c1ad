from __future__ import annotations

from pathlib import Path

import pytest

from morphkit.conversion.convert import Conversion, convert
from morphkit.conversion.write import write_conversion
from morphkit.errors import DependencyError
from morphkit.registry import load
from morphkit.viewer import offscreen


@pytest.fixture(scope="session")
def tiny_bert(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A BERT of 8 dimensions with random weights, saved as `save_pretrained` does."""
    import torch
    from transformers import BertConfig, BertModel, BertTokenizerFast

    folder = tmp_path_factory.mktemp("models") / "tiny"
    words = [
        "bthigh",
        "ctrl",
        "ffoot",
        "foot",
        "front",
        "high",
        "joint",
        "low",
        "position",
        "range",
        "torso",
        "x",
        "y",
        "z",
        "angle",
    ]
    folder.mkdir()
    (folder / "vocab.txt").write_text("\n".join(["[PAD]", "[UNK]", "[CLS]", "[SEP]", "[MASK]", *words]) + "\n")
    torch.manual_seed(0)
    config = BertConfig(
        vocab_size=5 + len(words),
        hidden_size=8,
        num_hidden_layers=2,
        num_attention_heads=2,
        intermediate_size=16,
        max_position_embeddings=12,
    )
    BertModel(config).save_pretrained(folder)
    BertTokenizerFast.from_pretrained(folder).save_pretrained(folder)
    return folder


@pytest.fixture(scope="module")
def everything(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A URDF with every kind of joint and mesh."""
    from tests.support.everything_urdf import robot

    return robot(tmp_path_factory.mktemp("robot"))


@pytest.fixture(scope="module")
def converted(everything: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Conversion, Path]:
    """That URDF as MJCF, and the file that it was written to."""
    path = tmp_path_factory.mktemp("out") / "out.xml"
    conversion = convert(load(everything))
    write_conversion(conversion, path)
    return conversion, path


@pytest.fixture
def gl() -> None:
    """Skip the test where pictures cannot be drawn."""
    try:
        offscreen.open_context(8, 8).free()
    except DependencyError as error:
        pytest.skip(str(error))
