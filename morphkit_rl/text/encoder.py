"""Frozen text encoder: names of sensors and actuators in, vectors out."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import groupby
from pathlib import Path
from typing import Any, get_args

import numpy as np

from morphkit.errors import ConfigError, DependencyError
from morphkit_rl.text.cache import EmbeddingCache
from morphkit_rl.text.model_files import ModelSource, Pooling, find_model

_BATCH = 32
_KEPT_TOGETHER = 1024


class TextEncoder:
    """A pretrained BERT-like model as a function from texts to vectors, cached on disk.

    The weights are read only when a text is not in the cache. Texts are encoded without padding, together with others
    of as many tokens only, so that a vector depends on what else was asked for in its last bits at most. What is in the
    cache first counts.

    Args:
        model: `minilm` (all-MiniLM-L6-v2, shipped, works offline), a folder that `save_pretrained` of transformers
            wrote, or a name on the Hugging Face hub such as `bert-base-uncased`.
        pooling: `cls`, the last layer's vector of the first token (BERT and the MA-BERT study), or `mean`, the average
            over all tokens of the text. None: what suits the model, `mean` for minilm and `cls` else.
        cache_dir: Folder of the disk cache; default `$MORPHKIT_CACHE`, else the user's cache folder.
        device: Torch device that texts are encoded on.

    Raises:
        ConfigError: Unknown pooling.
        DependencyError: The model's files are missing, damaged or out of reach.
    """

    def __init__(
        self,
        model: str = "minilm",
        *,
        pooling: Pooling | None = None,
        cache_dir: Path | None = None,
        device: str = "cpu",
    ) -> None:
        if pooling is not None and pooling not in get_args(Pooling):
            raise ConfigError(f"unknown pooling {pooling!r}: expected one of {', '.join(get_args(Pooling))}")
        self.source: ModelSource = find_model(model)
        self.pooling: Pooling = pooling or self.source.pooling
        self.device = device
        self.size: int = self.source.size
        self._cache = EmbeddingCache(f"{self.source.identity}-{self.pooling}", self.size, cache_dir)
        self._known: dict[str, np.ndarray] = {}
        self._network: tuple[Any, Any, int | None] | None = None

    def encode(self, texts: Sequence[str]) -> np.ndarray:
        """Encode texts.

        Args:
            texts: n texts; equal ones are encoded once.

        Returns:
            float32 array, shape (n, size), in the order of `texts`.

        Raises:
            DependencyError: The weights are damaged, or not those that the model's name stands for.
        """
        if isinstance(texts, str):
            raise TypeError("encode takes a sequence of texts, not a single string")
        missing = [text for text in dict.fromkeys(texts) if text not in self._known]
        if missing:
            self._known.update(self._cache.get(missing))
            left = [text for text in missing if text not in self._known]
            for first in range(0, len(left), _KEPT_TOGETHER):  # what is done is kept where the rest is interrupted
                new = self._encode_new(left[first : first + _KEPT_TOGETHER])
                self._known.update(self._cache.put(new))
        result = np.empty((len(texts), self.size), dtype=np.float32)
        for row, text in enumerate(texts):
            result[row] = self._known[text]
        return result

    def trainable(self) -> tuple[Callable[[Sequence[str]], dict[str, Any]], Any]:
        """A function from texts to the network's padded inputs, and a network of its own whose weights can learn.

        Raises:
            DependencyError: The weights are damaged, or not those that the model's name stands for.
        """
        self.source.check_weights()
        tokenizer, network, max_length = _load(self.source, self.device)

        def tokenize(texts: Sequence[str]) -> dict[str, Any]:
            return dict(
                tokenizer(
                    list(texts), return_tensors="pt", padding=True, truncation=max_length is not None,
                    max_length=max_length,
                )
            )  # fmt: skip

        return tokenize, network.requires_grad_(True)

    def _encode_new(self, texts: Sequence[str]) -> dict[str, np.ndarray]:
        if self._network is None:
            self.source.check_weights()
            self._network = _load(self.source, self.device)
        tokenizer, _, max_length = self._network
        tokens = tokenizer(list(texts), truncation=max_length is not None, max_length=max_length)["input_ids"]
        order = sorted(range(len(texts)), key=lambda index: len(tokens[index]))
        found: dict[str, np.ndarray] = {}
        for _, alike in groupby(order, key=lambda index: len(tokens[index])):
            rows = list(alike)
            for first in range(0, len(rows), _BATCH):
                batch = rows[first : first + _BATCH]
                vectors = self._run([tokens[index] for index in batch])
                found.update((texts[index], vector) for index, vector in zip(batch, vectors, strict=True))
        for text, vector in found.items():
            if vector.shape != (self.size,) or not np.isfinite(vector).all():
                raise DependencyError(
                    f"text encoder {self.source.name!r}: expected {self.size} finite numbers for {text!r}, "
                    f"got an array of shape {vector.shape}; the weights in {self.source.folder} are damaged"
                )
        return found

    def _run(self, tokens: Sequence[Sequence[int]]) -> np.ndarray:
        """Vectors (texts, size) of texts with equally many tokens."""
        import torch

        assert self._network is not None
        ids = torch.tensor(tokens, device=self.device)
        with torch.inference_mode():
            hidden = self._network[1](input_ids=ids, attention_mask=torch.ones_like(ids)).last_hidden_state.float()
            vectors = hidden[:, 0] if self.pooling == "cls" else hidden.mean(dim=1)
        array: np.ndarray = vectors.cpu().numpy()
        return array


def _load(source: ModelSource, device: str) -> tuple[Any, Any, int | None]:
    """Tokenizer, network in float32 and greatest number of tokens, from local files alone, without code of theirs."""
    try:
        with _quiet_transformers():
            from transformers import AutoModel, AutoTokenizer

            folder = str(source.folder)
            options = {"local_files_only": True, "trust_remote_code": False}  # unset, it asks on the terminal
            tokenizer = AutoTokenizer.from_pretrained(folder, **options)
            network, report = AutoModel.from_pretrained(folder, output_loading_info=True, **options)
            network = network.float().eval().requires_grad_(False).to(device)
    except Exception as error:  # The loader fails in many ways on damaged or foreign files.
        reason = f"{type(error).__name__}: {error}".split("\n")[0][:300]
        raise DependencyError(
            f"text encoder {source.name!r} cannot be loaded from {source.folder}: {reason}"
        ) from error
    # transformers fills what the file lacks with random numbers; only the pooler is not used here.
    absent = sorted(key for key in report["missing_keys"] if "pooler" not in key)
    if absent:
        raise DependencyError(
            f"text encoder {source.name!r}: the weights in {source.folder} lack {len(absent)} tensors, "
            f"such as {absent[0]}; download the model again"
        )
    positions = getattr(network.config, "max_position_embeddings", None)
    limits = [limit for limit in (tokenizer.model_max_length, positions) if limit and limit < 1_000_000]
    return tokenizer, network, min(limits, default=None)


@contextmanager
def _quiet_transformers() -> Iterator[None]:
    """Keep transformers from printing its progress bars and load reports."""
    from transformers.utils import logging

    verbosity, bars = logging.get_verbosity(), logging.is_progress_bar_enabled()
    logging.set_verbosity_error()
    logging.disable_progress_bar()
    try:
        yield
    finally:
        logging.set_verbosity(verbosity)
        if bars:
            logging.enable_progress_bar()
