"""Robot files with something wrong; what is looked for are errors that nobody foresaw."""

from __future__ import annotations

from pathlib import Path

from hypothesis import strategies as st

from . import target
from .strategies import broken_files


def examples() -> st.SearchStrategy[dict[str, bytes]]:
    """The bytes of a robot file after one to five changes."""
    return broken_files().map(lambda source: {"broken.xml": source})


def attempt(files: dict[str, bytes], folder: Path) -> str:
    """Read, tokenize, simulate and cut; return how far it got."""
    return target.attempt(files["broken.xml"])
