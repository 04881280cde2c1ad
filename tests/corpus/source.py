"""A cut robot's text against that of its source: nothing new, and nothing gone without a reason."""

from __future__ import annotations

import bisect
import re
from collections import Counter, defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any

from morphkit.ablation.ablate import Loss
from morphkit.formats import xml

_WORD = re.compile(rb"[\w.+-]+|[^\w\s]")
_KINDS = {"key": "keyframe", "body": "name"}
"""Tag -> the kind of a loss that belongs to no single limb."""


def foreign_lines(before: bytes, after: bytes) -> int:
    """How many lines of `after` do not are in `before`, in the same order; a line that only lost words is not new."""
    old = before.splitlines()
    places: dict[bytes, list[int]] = defaultdict(list)
    for number, line in enumerate(old):
        places[line.strip()].append(number)
    at, foreign = -1, 0
    for line in after.splitlines():
        known = places.get(line.strip(), [])
        following = bisect.bisect_right(known, at)
        same = known[following] if following < len(known) else len(old)
        nearest = next((number for number in range(at + 1, same) if _only_lost_words(old[number], line)), same)
        if nearest == len(old):
            foreign += 1
        else:
            at = nearest
    return foreign


def _only_lost_words(before: bytes, after: bytes) -> bool:
    words = iter(_WORD.findall(before))
    return all(word in words for word in _WORD.findall(after))


def unexplained(
    before: bytes, after: bytes, gone: Collection[str], lost: Collection[Loss], bodies: Sequence[str] = ()
) -> list[str]:
    """Elements of `before` that went or changed, although nothing says why.

    An element may go where it is in a removed body or link; where it, what it is in or a part of it mentions
    something that was there, or a loss that is listed; and with an element that may go.

    Args:
        before: The source.
        after: What is left of it.
        gone: Names of the removed bodies or links.
        lost: What is listed.
        bodies: Names of all bodies of an MJCF file in the file's order, for those that have none in the file.
    """
    signatures = _read(before)
    elements = list(signatures)
    own = [element for element in elements if element.tag == "body"]
    names = {id(element): name for element, name in zip(own, bodies, strict=True)} if len(own) == len(bodies) else {}
    removed = {id(part) for top in elements if _goes(top, gone, names) for part in top.iter("*")}
    known = {element.get("name", "") for element in elements if id(element) in removed}
    known |= {loss.name for loss in lost} | set(gone)
    known.discard("")
    staying = {element: signature for element, signature in signatures.items() if id(element) not in removed}
    unsettled = Counter(staying.values()) - Counter(_signatures(after).values())
    explained = set(removed)
    for element, signature in staying.items():
        if signature not in unsettled:
            continue
        around = [part for part in element.iterancestors() if part.getparent() is not None]
        mentioned = any(word in known for part in [*element.iter("*"), *around] for word in _words(part))
        listed = any(loss.kind == _KINDS.get(element.tag, element.tag) and not loss.limb for loss in lost)
        if mentioned or listed or id(element.getparent()) in explained:
            explained.add(id(element))
            unsettled[signature] -= 1
    # Of several that look alike it cannot be told which went.
    alike = {signature: element for element, signature in staying.items()}
    return [f"{alike[s].tag} {dict(alike[s].attrib)}"[:100] for s, count in unsettled.items() if count > 0]


def _goes(element: Any, gone: Collection[str], names: Mapping[int, str]) -> bool:
    """Whether an element is a removed body or link, or the joint that carries a removed link."""
    if element.tag in ("body", "link"):
        return names.get(id(element), element.get("name")) in gone
    child = element.find("child") if element.tag == "joint" else None
    return child is not None and child.get("link") in gone


@lru_cache(maxsize=1)
def _read(source: bytes) -> dict[Any, int]:
    return _signatures(source)


def _signatures(source: bytes) -> dict[Any, int]:
    """Every element -> a hash of it and of what it is in, its children aside."""
    found: dict[Any, int] = {}  # keeps the proxies alive, so that id() identifies an element
    for element in xml.parse(source, file="source").getroot().iter("*"):
        text = (element.text or "").strip()
        around = found.get(element.getparent(), 0)
        found[element] = hash((element.tag, tuple(sorted(element.attrib.items())), text, around))
    return found


def _words(element: Any) -> Iterator[str]:
    for value in (*element.attrib.values(), (element.text or "").strip()):
        yield value
        yield from value.split()
