"""What both readers share: limb types, unique names, and the choice among several roots."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from itertools import islice

from morphkit.description import RobotInfo
from morphkit.errors import DescriptionError, UnknownNameError
from morphkit.formats.limits import abridged

_COMPARED, _MANY = 100, 2000


def limb_type(info: RobotInfo, body: str, joints: Iterable[str]) -> str | None:
    """Return the first word of the first group of type words of which a word occurs in the limb's name.

    Args:
        info: Its `type_matched_in` says whether the body's name counts or those of its joints.
        body: Name of the limb's body.
        joints: Names of its moving joints; base joints do not count.
    """
    names = [body] if info.type_matched_in == "body" else list(joints)
    for group in info.type_words:
        if any(word in name for word in group for name in names):
            return group[0]
    return None


class Names:
    """Names given out so far; one that is taken gets a number: `foot`, `foot_2`, `foot_3`."""

    def __init__(self, taken: Iterable[str] = ()) -> None:
        self._taken = set(taken)
        self._numbers: dict[str, int] = {}

    def give(self, name: str) -> str:
        """Return `name`, or the first of `name_2`, `name_3`, ... that is free, and take it."""
        candidate, number = name, self._numbers.get(name, 1)
        while candidate in self._taken:
            number += 1
            candidate = f"{name}_{number}"
        self._numbers[name] = number
        self._taken.add(candidate)
        return candidate


def give_names(originals: Sequence[str | None], calls: Sequence[str]) -> list[str]:
    """A name of its own for each of several elements: its original one, else what `calls` says.

    A number is added where that is taken. Of elements that share a name the first keeps it; no given name takes one
    that stands in the file.
    """
    names = Names(original for original in originals if original)
    kept: set[str] = set()
    found = []
    for original, call in zip(originals, calls, strict=True):
        found.append(original if original and original not in kept else names.give(original or call))
        kept.add(original or "")
    return found


def nearest(name: str, names: Iterable[str]) -> str:
    """Return `; did you mean 'x'?` for the name closest to `name`, or nothing; of many names the first are compared."""
    close = difflib.get_close_matches(name[:_COMPARED], islice(names, _MANY), n=1)
    return f"; did you mean {close[0]!r}?" if close else ""


def choose_root(roots: Sequence[str], wanted: str | None, *, file: str, element: str, notes: Sequence[str] = ()) -> str:
    """Return the root to take.

    Args:
        roots: Names of the top-level bodies or links, in file order.
        wanted: `Description.root`.
        file: What the file is called in messages.
        element: `body` or `link`.
        notes: What else there is to say of them where one has to be chosen.

    Raises:
        UnknownNameError: `wanted` is not among them.
        DescriptionError: There are several and `wanted` is None.
    """
    listed = abridged(roots)
    if wanted is not None:
        if wanted not in roots:
            raise UnknownNameError(
                f"{file}: no top-level {element} {wanted!r}; there is {listed}{nearest(wanted, roots)}"
            )
        return wanted
    if len(roots) > 1:
        raise DescriptionError(
            f"{file}: {len(roots)} top-level {element} elements, expected one: {listed}. Say which with --root NAME,"
            " or join them" + "".join(f"\n  {note}" for note in notes)
        )
    return roots[0]
