"""Attributes that are lists over several lines, as keyframes have them, and that lose some of their words."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence

_WORD = re.compile(r"(\s*)(\S+)")


def without_words(quoted: str, value: str) -> str:
    """The attribute `quoted` over its lines as it is, without the words that `value` lacks; empty where it has others.

    Parsers hand out line breaks in attributes as spaces.
    """
    written = quoted[1:-1]
    words = _WORD.findall(written)
    left = _left([word for _, word in words], value.split(), {n for n, (space, _) in enumerate(words) if "\n" in space})
    if "\n" not in written or "&" in written or not left:
        return ""
    kept, line_break = "", ""
    for number, (space, word) in enumerate(words):
        if "\n" in space:
            line_break = space
        if number in left:
            kept += (line_break or space) + word
            line_break = ""
    return quoted[0] + kept + written[len(written.rstrip()) :] + quoted[-1]


def _left(words: Sequence[str], wanted: Sequence[str], line_starts: Collection[int]) -> set[int]:
    """Which of `words` are left where `wanted` are; none where those are others.

    Among equal words it cannot be told. What a limb takes along mostly stands together, and mostly from the start of a
    line.
    """
    gone = len(words) - len(wanted)
    head = _alike(words, wanted)
    tail = _alike(words[::-1], wanted[::-1])
    if gone > 0 and head + tail >= len(wanted):
        at = max((place for place in range(len(wanted) - tail, head + 1) if place in line_starts), default=head)
        return {*range(at), *range(at + gone, len(words))}
    left: set[int] = set()
    for number, word in enumerate(words):
        if len(left) < len(wanted) and word == wanted[len(left)]:
            left.add(number)
    return left if len(left) == len(wanted) else set()


def _alike(words: Sequence[str], others: Sequence[str]) -> int:
    """How many words from the start on are the same."""
    pairs = enumerate(zip(words, others, strict=False))
    return next((number for number, (one, other) in pairs if one != other), min(len(words), len(others)))
