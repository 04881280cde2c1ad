"""Small networks of every method, and robots to give them."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch

from morphkit.readers import read
from morphkit.registry import load
from morphkit.tokens.spec import TokenSpec, token_spec
from morphkit_rl.buffers.replay_buffer import Batch
from morphkit_rl.config.train_config import ModelConfig
from morphkit_rl.models import build, find
from morphkit_rl.models.layout import Layout, build_layout
from morphkit_rl.models.vocabulary import Vocabulary

TEXTS = ["ffoot position x", "front foot position x", "bthigh joint range low", "torso ctrl"]
SIZE = 12
SMALL = ModelConfig(d_model=16, layers=2, heads=2, feedforward=24, code_size=6, token_size=4, message_size=3)
ROBOTS = ("hopper", "cheetah_4_back", "humanoid_2d_7_left_arm", "hopper_3")


def embed(texts: Sequence[str]) -> np.ndarray:
    """A vector of its own for every text."""
    return np.stack([np.random.default_rng(zlib.crc32(t.encode())).standard_normal(SIZE) for t in texts]).astype("f4")


def spec(name: str) -> TokenSpec:
    return token_spec(read(load(name)))


def layout_of(method: str, *names: str) -> Layout:
    return build_layout([spec(name) for name in names], embed, actions=find(method).actions)


def networks(config: ModelConfig, names: Sequence[str] = ROBOTS) -> tuple[Any, Any]:
    torch.manual_seed(0)
    return build(config, SIZE, Vocabulary.of([spec(name) for name in names]))


def rows(layout: Layout, batch: int = 5) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(1)
    obs = torch.randn(batch, layout.num_tokens, generator=generator)
    return obs, torch.rand(batch, layout.num_actions, generator=generator) * 2 - 1


def batch_of(layout: Layout, size: int = 3) -> Batch:
    rng = np.random.default_rng(3)
    obs, next_obs = rng.standard_normal((2, size, layout.num_tokens)).astype("f4")
    action = rng.uniform(-1, 1, (size, layout.num_actions)).astype("f4")
    reward, discount = rng.random((2, size, layout.num_robots)).astype("f4")
    return Batch(obs, action, reward, next_obs, discount)
