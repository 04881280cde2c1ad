"""What the study published: returns read off its figures."""

from __future__ import annotations

import json
import tomllib
from functools import cache
from importlib import resources
from typing import Any, Literal

Kind = Literal["train", "zero_shot"]
OVERALL = "overall"


def published_returns(kind: Kind, split: str, task: str) -> dict[str, float]:
    """Published returns by method; empty where the study reports none.

    Args:
        kind: `train`, with exploration noise on the training robots, or `zero_shot`, noise-free on the held-out ones.
        split: Name of the split.
        task: Name of the task, or `overall` (zero_shot only).
    """
    return {method: float(value) for method, value in _published()[kind].get(split, {}).get(task, {}).items()}


def published_steps() -> int:
    """Counted environment steps behind the published returns."""
    return int(_published()["steps"])


def paper_settings(split: str) -> list[str]:
    """Settings of the paper presets that the study chose for this split alone, as `section.name=value`."""
    return [f"{key}={json.dumps(value)}" for key, value in _published()["settings"].get(split, {}).items()]


@cache
def _published() -> dict[str, Any]:
    return tomllib.loads((resources.files("morphkit_rl.benchmark") / "published.toml").read_text("utf-8"))
