"""What the checks of both formats share: numbers out of text, unique names, names that tools accept."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from typing import Any

from morphkit.formats.poses import numbers as parse_numbers
from morphkit.readers.urdf_structure import MAY_BE_INFINITE, NUMBERS
from morphkit.utils.suggest import did_you_mean
from morphkit.validation.document import CheckedDocument

_BAD_NAME = re.compile(r"""^\s|\s$|["'<>&\\`]|[\x00-\x1f\x7f]|^$""")
_LONGEST = 100
_XACRO = re.compile(r"\$[({]")


def read_numbers(
    doc: CheckedDocument, element: Any, attribute: str, counts: range, *, owner: str
) -> list[float] | None:
    """Return the finite numbers in an attribute; None where it is absent or wrong, which is then reported.

    Args:
        doc: Receives the finding.
        element: The element.
        attribute: Its attribute.
        counts: How many numbers there may be.
        owner: What the element belongs to, for the message, such as `joint 'knee'`.
    """
    text = element.get(attribute)
    if text is None or _XACRO.search(text):  # an expression is a finding of its own
        return None
    where = f'{attribute}="{shorten(text)}" in <{element.tag}> of {owner}'
    try:
        numbers = parse_numbers(text).tolist()
    except ValueError:
        doc.add("number-invalid", element, f"{where}, expected {_expected(counts)}")
        return None
    if len(numbers) not in counts or any(math.isnan(number) for number in numbers):
        doc.add("number-invalid", element, f"{where}, expected {_expected(counts)}")
        return None
    if any(math.isinf(number) for number in numbers):
        if element.tag in NUMBERS and element.tag not in MAY_BE_INFINITE:
            doc.add("number-invalid", element, f"{where}, expected finite numbers")
            return None
        doc.add("number-infinite", element, where)
        return None
    return numbers


def _expected(counts: range) -> str:
    if len(counts) == 1:
        return "a number" if counts[0] == 1 else f"{counts[0]} numbers"
    return f"{counts[0]} to {counts[-1]} numbers"


def shorten(text: str, length: int = 60) -> str:
    """`text` in at most `length` characters."""
    return text if len(text) <= length else text[: length - 3] + "..."


def check_name(doc: CheckedDocument, element: Any, what: str) -> None:
    """Report a name with characters that tools stumble over."""
    name = element.get("name")
    if name is not None and _BAD_NAME.search(name) and not _XACRO.search(name):
        doc.add("name-characters", element, f"{what} is called {shorten(name)!r}", name=name)


def index_names(doc: CheckedDocument, found: Iterable[Any], what: str, *, required: bool) -> dict[str, Any]:
    """Return name -> element; a name that is missing or used twice is reported, and the first one counts."""
    known: dict[str, Any] = {}
    for element in found:
        name = element.get("name")
        if not name:
            if required:
                doc.add("name-missing", element, f"<{element.tag}> without a name")
            continue
        check_name(doc, element, what)
        if name in known:
            first = "{}:{}".format(*doc.place(known[name]))
            doc.add("name-duplicate", element, f"two {what}s are called {name!r}; the first is at {first}", name=name)
        else:
            known[name] = element
    return known


def unknown(doc: CheckedDocument, what: str, name: str, known: Iterable[str]) -> str:
    """`link 'foo', which does not exist; did you mean 'foot'?`; the hint is left out where there were many."""
    doc.hints_left -= 1
    hint = did_you_mean(name[:_LONGEST], known) if doc.hints_left >= 0 else ""
    return f"{what} {shorten(name)!r}, which does not exist{hint}"


def start_is_said(joint: str, start: str | Mapping[str, float]) -> bool:
    """Whether `robot.toml` says where a joint starts."""
    return bool(start) if isinstance(start, str) else joint in start
