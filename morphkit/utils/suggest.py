"""The name that a user may have meant."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from itertools import islice

# The search takes time with the length of names and their number, and both may come from a hostile file.
_COMPARED_CHARACTERS, _COMPARED_NAMES = 100, 2000


def nearest(name: str, names: Iterable[str]) -> str | None:
    """The nearest of `names`; None where none is near; case does not count."""
    folded = {known.lower(): known for known in islice(names, _COMPARED_NAMES)}
    near = difflib.get_close_matches(name[:_COMPARED_CHARACTERS].lower(), folded, n=1)
    return folded[near[0]] if near else None


def did_you_mean(name: str, names: Iterable[str]) -> str:
    """`; did you mean 'x'?` with the nearest of `names`, or nothing where none is near."""
    near = nearest(name, names)
    return "" if near is None else f"; did you mean {near!r}?"


def did_you_mean_or_list(name: str, names: Iterable[str]) -> str:
    """As `did_you_mean`; where none is near, `; there is x, y, z` with all of them."""
    names = list(names)
    return did_you_mean(name, names) or f"; there is {', '.join(names)}"
