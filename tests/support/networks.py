"""Small networks of every method, and robots to give them."""

from __future__ import annotations

import dataclasses
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch

from morphkit.readers import read
from morphkit.registry import load
from morphkit.tokens.spec import TokenSpec, token_spec
from morphkit_rl.algorithms.normalizer import Normalizer
from morphkit_rl.algorithms.policy import Policy
from morphkit_rl.buffers.replay_buffer import Batch
from morphkit_rl.config.methods import ModelSettings, find_method
from morphkit_rl.config.train_config import TrainConfig
from morphkit_rl.models import build
from morphkit_rl.models.layout import Layout, build_layout
from morphkit_rl.models.vocabulary import Vocabulary
from morphkit_rl.runs import run_settings
from morphkit_rl.text.embedder import TokenEmbedder

TEXTS = ["ffoot position x", "front foot position x", "bthigh joint range low", "torso ctrl"]
SIZE = 12
SMALL: dict[str, Any] = {
    "d_model": 16, "layers": 2, "heads": 2, "feedforward": 24, "code_size": 6, "token_size": 4, "message_size": 3,
}  # fmt: skip
ROBOTS = ("hopper", "cheetah_4_back", "humanoid_2d_7_left_arm", "hopper_3")


def embed(texts: Sequence[str]) -> np.ndarray:
    """A vector of its own for every text."""
    return np.stack([np.random.default_rng(zlib.crc32(t.encode())).standard_normal(SIZE) for t in texts]).astype("f4")


def spec(name: str) -> TokenSpec:
    return token_spec(read(load(name)))


def layout_of(method: str, *names: str) -> Layout:
    return build_layout([spec(name) for name in names], embed, actions=find_method(method).actions)


def small(method: str = "limb-former", **changes: Any) -> ModelSettings:
    """Small settings of a method."""
    own = find_method(method).settings
    fields = {each.name for each in dataclasses.fields(own)}
    return own(method=method, **{key: size for key, size in SMALL.items() if key in fields} | changes)


def tiny_overrides(method: str) -> list[str]:
    """Overrides that make the networks of a method tiny."""
    sizes = {"d_model": 8, "layers": 1, "feedforward": 8, "code_size": 4, "token_size": 4, "message_size": 4}
    fields = {each.name for each in dataclasses.fields(find_method(method).settings)}
    return [f"model.method={method}", *(f"model.{key}={size}" for key, size in sizes.items() if key in fields)]


def networks(config: ModelSettings, names: Sequence[str] = ROBOTS) -> tuple[Any, Any]:
    torch.manual_seed(0)
    return build(config, SIZE, Vocabulary.of([spec(name) for name in names]))


def rows(layout: Layout, batch: int = 5) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(1)
    obs = torch.randn(batch, layout.num_tokens, generator=generator)
    return obs, torch.rand(batch, layout.num_actions, generator=generator) * 2 - 1


def batch_of(layout: Layout, size: int = 3, rng: np.random.Generator | None = None) -> Batch:
    rng = rng or np.random.default_rng(3)
    obs, next_obs = rng.standard_normal((2, size, layout.num_tokens)).astype("f4")
    action = rng.uniform(-1, 1, (size, layout.num_actions)).astype("f4")
    reward, discount = rng.random((2, size, layout.num_robots)).astype("f4")
    return Batch(obs, action, reward, next_obs, discount)


def random_policy(config: TrainConfig, trained_on: Sequence[str]) -> Policy:
    """A policy with random weights and observation statistics, as if trained on shipped robots."""
    torch.manual_seed(0)
    specs = [run_settings.prepare_robot(config, load(name)).spec for name in trained_on]
    vocabulary = Vocabulary.from_dict(Vocabulary.of(specs).to_dict())
    embedder = TokenEmbedder.fit(run_settings.make_encoder(config), [text for own in specs for text in own.texts])
    normalizer = Normalizer()
    normalizer.index(specs, grow=True)
    rng = np.random.default_rng(0)
    for own in specs:
        normalizer.update(rng.standard_normal((50, len(own.sensors))), normalizer.index([own]))
    actor, _ = build(config.model, embedder.size, vocabulary)
    return Policy(actor, normalizer, embedder, config, trained_on, vocabulary)
