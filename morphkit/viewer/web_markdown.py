"""Names from robot files inside Markdown, which browsers run: whatever they hold, they stay text."""

from __future__ import annotations

import re

_MEANINGFUL = frozenset(r"\`*_{}[]<>()#+-.!|~$&:")


def plain_text(text: str) -> str:
    """Text on one line whose characters mean nothing to Markdown."""
    return "".join(f"\\{char}" if char in _MEANINGFUL else char for char in " ".join(text.split()))


def fenced(text: str) -> str:
    """A block of code that its content cannot end."""
    longest = max((len(run) for run in re.findall(r"`+", text)), default=0)
    fence = "`" * max(3, longest + 1)
    return f"{fence}\n{text}\n{fence}"
