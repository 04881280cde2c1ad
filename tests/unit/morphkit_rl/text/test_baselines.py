"""Stand-ins for text embeddings, and embeddings that learn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from morphkit.errors import ConfigError
from morphkit.registry import load
from morphkit_rl.algorithms.td3 import TD3
from morphkit_rl.config.train_config import TD3Config, load_config
from morphkit_rl.evaluation.evaluate import evaluate
from morphkit_rl.models import build
from morphkit_rl.models.layout import build_layout
from morphkit_rl.models.vocabulary import Vocabulary
from morphkit_rl.text.baselines import OneHotTexts, RandomTexts, ShuffledTexts, controlled
from morphkit_rl.text.embedder import TokenEmbedder
from morphkit_rl.text.encoder import TextEncoder
from morphkit_rl.text.model_files import Pooling
from morphkit_rl.text.tuning import TunedEncoder, make_tuner
from morphkit_rl.training.trainer import resume, train
from tests.support.networks import SIZE, batch_of, embed, layout_of, networks, rows, small, tiny_overrides
from tests.support.run_folders import assert_same

KNOWN = ["foot ctrl", "foot angle", "leg angle", "torso position x"]


class Hashed:
    """A source of vectors that need no model."""

    size = SIZE

    def encode(self, texts: list[str]) -> np.ndarray:
        return embed(texts)


def test_random_vectors_are_fixed_and_of_the_text_alone() -> None:
    source = RandomTexts(400)
    vectors = source.encode(KNOWN)
    np.testing.assert_array_equal(source.encode(KNOWN[::-1]), vectors[::-1])
    assert abs(np.corrcoef(vectors) - np.eye(4)).max() < 0.25
    assert source.encode([]).shape == (0, 400)


@pytest.mark.parametrize("known", [KNOWN, KNOWN[:2], KNOWN[:3], [f"text {n}" for n in range(40)]])
def test_shuffled_texts_trade_vectors_and_none_keeps_its_own(known: list[str]) -> None:
    source = ShuffledTexts(Hashed(), known)
    own, traded = embed(known), source.encode(known)
    places = [int(np.flatnonzero((own == vector).all(1))[0]) for vector in traded]
    assert sorted(places) == list(range(len(known)))
    assert all(place != number for number, place in enumerate(places))
    np.testing.assert_array_equal(ShuffledTexts(Hashed(), known[::-1]).encode(known), traded)
    np.testing.assert_array_equal(source.encode(["new text"]), embed(["new text"]))


def test_one_hot_texts_number_what_is_known() -> None:
    source = OneHotTexts(KNOWN)
    vectors = source.encode([*sorted(KNOWN), "new text"])
    np.testing.assert_array_equal(vectors, np.eye(5, 4))
    assert controlled(Hashed(), "one-hot", KNOWN).size == 4
    assert controlled(Hashed(), "random", KNOWN).size == SIZE
    assert isinstance(controlled(Hashed(), "none", KNOWN), Hashed)


def test_embeddings_stay_as_they_are_without_standardizing() -> None:
    embedder = TokenEmbedder.fit(Hashed(), KNOWN, standardize=False)
    np.testing.assert_array_equal(embedder(KNOWN), embed(KNOWN))
    assert abs(TokenEmbedder.fit(Hashed(), KNOWN)(KNOWN).mean(0)).max() < 1e-5


@pytest.mark.parametrize("method", ["limb-former", "ma-bert"])
def test_a_residual_starts_at_nothing_learns_and_leaves_unknown_texts_alone(method: str) -> None:
    config = small(method)
    layout, other = layout_of(method, "hopper_3"), layout_of(method, "cheetah")
    vocabulary = Vocabulary.of(layout.specs)
    tune = make_tuner("residual", TokenEmbedder.fit(Hashed(), KNOWN, standardize=False), vocabulary.texts)
    torch.manual_seed(0)
    learner = TD3(config, TD3Config(), SIZE, vocabulary=vocabulary, tune=tune)
    plain, _ = networks(config, ["hopper_3"])
    obs, _ = rows(layout)
    torch.testing.assert_close(learner.actor(obs, layout), plain(obs, layout))
    for _ in range(4):
        learner.update(batch_of(layout), None, None, layout, np.random.default_rng(0))
    learned = dict(zip(vocabulary.texts, learner.actor.embeddings.table.abs().amax(1), strict=True))
    assert all(learned[text] > 0 for text in layout.texts)
    seen = torch.tensor([text in vocabulary.texts for text in other.texts])
    moved = (learner.actor.tuned(other).embeddings != other.embeddings).any(1)
    assert 0 < seen.sum() < len(seen)
    assert torch.equal(moved, seen)
    names = learner.actor.read_names(layout)
    assert torch.equal(learner.actor(obs, layout, names), learner.actor(obs, layout))


def test_methods_without_text_ignore_tuning() -> None:
    tune = make_tuner("residual", TokenEmbedder.fit(Hashed(), KNOWN), KNOWN)
    actor, critic = build(small("smp"), SIZE, Vocabulary(scalars=19, children=2), tune)
    assert not any("table" in name for net in (actor, critic) for name, _ in net.named_parameters())
    assert make_tuner("frozen", TokenEmbedder.fit(Hashed(), KNOWN), KNOWN) is None


@pytest.mark.parametrize("pooling", ["cls", "mean"])
def test_the_encoder_itself_learns(tiny_bert: Path, tmp_path: Path, pooling: Pooling) -> None:
    encoder = TextEncoder(str(tiny_bert), pooling=pooling, cache_dir=tmp_path)
    layout = layout_of("ma-bert", "hopper_3")
    vocabulary = Vocabulary.of(layout.specs)
    embedder = TokenEmbedder.fit(encoder, vocabulary.texts)
    layout, other = (
        build_layout(specs, embedder, actions="limbs")
        for specs in (layout.specs, layout_of("ma-bert", "cheetah").specs)
    )
    tune = make_tuner("encoder", embedder, vocabulary.texts)
    torch.manual_seed(0)
    learner = TD3(small("ma-bert"), TD3Config(), embedder.size, vocabulary=vocabulary, tune=tune)
    tuned = learner.actor.tuned
    torch.testing.assert_close(tuned(layout).embeddings, layout.embeddings, atol=1e-3, rtol=1e-3)
    for _ in range(4):
        learner.update(batch_of(layout), None, None, layout, np.random.default_rng(0))
    assert (tuned(layout).embeddings - layout.embeddings).abs().amax(1).min() > 1e-3
    seen = torch.tensor([text in vocabulary.texts for text in other.texts])
    assert torch.equal((tuned(other).embeddings - other.embeddings).abs().amax(1) > 1e-3, seen)


def test_only_a_true_encoder_can_learn() -> None:
    with pytest.raises(ConfigError, match=r"text\.control"):
        TunedEncoder(KNOWN, TokenEmbedder.fit(Hashed(), KNOWN))


@pytest.mark.parametrize(
    "setting",
    [
        "text.control=random",
        "text.control=shuffled",
        "text.control=one-hot",
        "text.tune=residual",
        "text.tune=encoder",
        "td3.reset_updates=3",
    ],
)
@pytest.mark.parametrize("method", ["limb-former", "ma-bert"])
def test_options_train_resume_and_load(
    tmp_path: Path, tiny_bert: Path, monkeypatch: pytest.MonkeyPatch, method: str, setting: str
) -> None:
    monkeypatch.setenv("MORPHKIT_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("MORPHKIT_ENCODERS", str(tiny_bert))
    run = ["trainer.num_envs=2", "trainer.start_steps=4", "td3.batch_size=4", "text.naming=canonical", setting]
    encoder = str(tiny_bert) if setting == "text.tune=encoder" else "minilm"
    run += [f"text.encoder={encoder}", "trainer.precision=float32"]
    config = load_config(overrides=[*tiny_overrides(method), *run])
    train([load("hopper_3")], tmp_path / "whole", config, steps=12)
    assert train([load("hopper_3")], tmp_path / "run", config, steps=8).updates > 3
    assert resume(tmp_path / "run", steps=12).steps == 12
    assert_same(tmp_path / "whole", tmp_path / "run")
    (result,) = evaluate(tmp_path / "run", [load("hopper_4")], episodes=1)
    assert np.isfinite(result.returns).all()
