"""Embeddings that learn with the policy; texts that training does not know keep their frozen ones."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal
from weakref import WeakKeyDictionary

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from morphkit.errors import ConfigError
from morphkit_rl.models.layout import Layout
from morphkit_rl.text.embedder import TokenEmbedder
from morphkit_rl.text.encoder import TextEncoder

Tune = Literal["frozen", "residual", "encoder"]
Tuner = Callable[[], nn.Module]
"""Makes a module that gives a layout's embeddings (texts, size)."""


class Residual(nn.Module):
    """A learned summand for each known text, zero at first: e(text) + r(text)."""

    def __init__(self, known: Sequence[str], size: int):
        super().__init__()
        self.rows = _Rows(known)
        self.table = nn.Parameter(torch.zeros(len(known), size))

    def forward(self, layout: Layout) -> Tensor:
        """Embeddings of a layout's texts."""
        return layout.embeddings + F.pad(self.table, (0, 0, 0, 1))[self.rows(layout)]


class TunedEncoder(nn.Module):
    """The text encoder itself as a part of the policy: known texts are encoded anew with the weights of the moment."""

    def __init__(self, known: Sequence[str], embedder: TokenEmbedder):
        super().__init__()
        if not isinstance(embedder.source, TextEncoder):
            raise ConfigError("text.tune = 'encoder' needs a text encoder, so text.control = 'none'")
        self.rows, self.known, self.pooling = _Rows(known), list(known), embedder.source.pooling
        tokenize, network = embedder.source.trainable()
        self.network = network
        for name, values in tokenize(self.known).items():
            self.register_buffer(f"input_{name}", values, persistent=False)
        self.register_buffer("mean", torch.from_numpy(embedder.mean), persistent=False)
        self.register_buffer("std", torch.from_numpy(embedder.std), persistent=False)
        components = None if embedder.components is None else torch.from_numpy(embedder.components)
        self.components: Tensor | None
        self.register_buffer("components", components, persistent=False)

    def forward(self, layout: Layout) -> Tensor:
        """Embeddings of a layout's texts."""
        rows = self.rows(layout)
        used, place = rows.unique(return_inverse=True)
        known = used[used < len(self.known)]
        buffers = {name: value[known] for name, value in self.named_buffers(recurse=False) if name.startswith("input_")}
        inputs: dict[str, Any] = {name.removeprefix("input_"): value for name, value in buffers.items()}
        hidden = self.network(**inputs).last_hidden_state
        mask = inputs["attention_mask"][..., None].to(hidden.dtype)
        pooled = hidden[:, 0] if self.pooling == "cls" else (hidden * mask).sum(1) / mask.sum(1)
        embeddings = (pooled - self.mean) / self.std
        if self.components is not None:
            embeddings = embeddings @ self.components
        tuned = F.pad(embeddings, (0, 0, 0, 1))[place]
        return torch.where((rows < len(self.known))[:, None], tuned, layout.embeddings)


class _Rows:
    """Place of a layout's texts among known ones; the number of known texts where one is not known."""

    def __init__(self, known: Sequence[str]):
        self.number = len(known)
        self.row = {text: number for number, text in enumerate(known)}
        self.found: WeakKeyDictionary[Layout, Tensor] = WeakKeyDictionary()

    def __call__(self, layout: Layout) -> Tensor:
        if layout not in self.found:
            rows = [self.row.get(text, self.number) for text in layout.texts]
            self.found[layout] = torch.tensor(rows, device=layout.embeddings.device)
        return self.found[layout]


def make_tuner(tune: Tune, embedder: TokenEmbedder, known: Sequence[str]) -> Tuner | None:
    """How to make a network's tuned embeddings; None where embeddings are frozen.

    Args:
        tune: What learns.
        embedder: The frozen embeddings.
        known: The texts that training knows.
    """
    if tune == "residual":
        return lambda: Residual(known, embedder.size)
    return (lambda: TunedEncoder(known, embedder)) if tune == "encoder" else None
