"""Policies on the Hugging Face hub: a repository of models holds a policy folder."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from morphkit.errors import CheckpointError, DependencyError, MorphkitError, OutputError
from morphkit_rl.runs import saved_policy
from morphkit_rl.runs.saved_policy import SavedPolicy

PATTERNS = ["*.json", "*.md", "*.safetensors", "robots/*"]


def push(
    policy: SavedPolicy,
    repository: str,
    texts: Mapping[str, str],
    *,
    private: bool = False,
    token: str | None = None,
    endpoint: str | None = None,
) -> str:
    """Upload a policy folder as one commit; the repository is made where it is missing.

    Args:
        policy: The policy.
        repository: `OWNER/NAME`.
        texts: Further files by name, such as `README.md`.
        private: Whether a new repository is private.
        token: Access token; default: that of `hf auth login` or `HF_TOKEN`.
        endpoint: Address of the hub; default: huggingface.co or `HF_ENDPOINT`.

    Returns:
        Address of the repository.

    Raises:
        DependencyError: huggingface_hub is not installed.
        OutputError: The hub refuses, or is out of reach.
    """
    hub = _require_hub()
    api = hub.HfApi(endpoint=endpoint, token=token)
    with _failing_as(OutputError, repository), tempfile.TemporaryDirectory(prefix="morphkit-") as stage:
        folder = Path(stage) / "policy"
        saved_policy.save(policy, folder, texts)
        url = api.create_repo(repository, private=private, exist_ok=True)
        api.upload_folder(repo_id=repository, folder_path=folder, commit_message="Upload a policy of morphkit")
        return str(url)


@contextmanager
def fetched(
    repository: str, *, revision: str | None = None, token: str | None = None, endpoint: str | None = None
) -> Iterator[Path]:
    """A copy of a repository's policy folder, which goes at the end of the block.

    Args:
        repository: `OWNER/NAME`.
        revision: Branch, tag or commit; default: `main`.
        token: As in `push`.
        endpoint: As in `push`.

    Raises:
        DependencyError: huggingface_hub is not installed.
        CheckpointError: There is no such repository, or the hub is out of reach.
    """
    hub = _require_hub()
    with tempfile.TemporaryDirectory(prefix="morphkit-") as stage:
        with _failing_as(CheckpointError, repository):
            hub.snapshot_download(
                repository, revision=revision, local_dir=stage, allow_patterns=PATTERNS, token=token, endpoint=endpoint
            )
        yield Path(stage)


@contextmanager
def _failing_as(kind: type[MorphkitError], repository: str) -> Iterator[None]:
    from huggingface_hub import errors

    try:
        yield
    except MorphkitError:
        raise
    except (errors.HFValidationError, errors.LocalTokenNotFoundError, errors.HTTPError, OSError) as error:
        reason = " ".join(str(error).split())
        raise kind(f"{repository}: Hugging Face hub: {reason[:300] or type(error).__name__}") from None


def _require_hub() -> Any:
    try:
        import huggingface_hub
    except ImportError:
        raise DependencyError("the hub needs huggingface_hub; install it with: pip install 'morphkit[hub]'") from None
    return huggingface_hub
