"""Where what can be made again is kept: embeddings of texts and compiled kernels."""

from __future__ import annotations

import os
from pathlib import Path

import platformdirs


def cache_dir() -> Path:
    """The cache folder of morphkit: `$MORPHKIT_CACHE`, else morphkit's own in the user's cache folder.

    For a user without a home, as containers may have, it is one that cannot be made.
    """
    try:
        return Path(os.environ.get("MORPHKIT_CACHE") or platformdirs.user_cache_dir("morphkit")).expanduser()
    except RuntimeError:
        return Path(os.devnull) / "morphkit"
