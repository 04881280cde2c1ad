"""Where the elements of a parsed MJCF model are, which MuJoCo says by line only: of whichever file it was in."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.parsers import expat

from lxml import etree

from morphkit.formats.mjcf_schema import EXPANDERS

Place = tuple[str | None, str | None]
"""Name that the file has for an element, and `file:line`; None for what is not known."""

_MAKERS = ("include", "model", *EXPANDERS)
_SECTIONS = ("actuator", "sensor")
_LINE = re.compile(r"line (\d+)")
_NAMED_LINE = re.compile(r"Element '([^']*)', line (\d+)")


class Places:
    """Finds the place of an `MjSpec` element in the files that a model was parsed from.

    A model in one file, which nothing multiplies, has MuJoCo's own lines. Of others MuJoCo tells the line, but neither
    the file nor which element a copy is of: those are found by line, tag and name.
    """

    def __init__(self, file: str, root: etree._Element) -> None:
        """Find places in the file called `file` with the root element `root`, before includes are flattened."""
        self._file = file
        self._plain = next(root.iter(*_MAKERS), None) is None
        self._attaches = False
        self._files: dict[int, str] = {}
        self._kept: list[etree._Element] = []  # keeps the proxies alive, so that id() identifies an element
        self._rows: dict[tuple[str, int], list[tuple[str | None, str]]] = {}
        self._named: dict[tuple[str, str], set[str]] = {}
        self._lines: dict[tuple[str, int], str] = {}

    def own(self, root: etree._Element, path: Path) -> None:
        """Remember that all elements below `root`, which are about to move elsewhere, are in the file `path`."""
        for element in root.iter("*"):
            self._kept.append(element)
            self._files[id(element)] = path.name

    def add(self, root: etree._Element, text: str | bytes, file: str, *, main: bool) -> None:
        """Enter what MuJoCo is given: the tree at `root`, whose own file is `file`, and the same as XML text."""
        if self._plain:
            return
        self._attaches |= next(root.iter("model"), None) is not None
        for element, line in zip(root.iter("*"), _start_lines(text), strict=False):
            where = f"{self._files.get(id(element), file)}:{element.sourceline}"
            if main and not self._attaches:  # lines in a message can be those of an attached file
                self._lines.setdefault((str(element.tag), line), where)
            if (kind := _kind(element)) is not None:
                self._rows.setdefault((kind, line), []).append((element.get("name"), where))
                self._named.setdefault((kind, element.get("name") or ""), set()).add(where)

    def find(self, element: Any, kind: str) -> Place:
        """The place of an `MjSpec` element of a kind: `body`, `joint`, `actuator` or `sensor`."""
        name = element.name or None
        line = _LINE.search(element.info or "")
        if line is None:  # as of free joints, which are in their body, and of what comes from a URDF
            original, where = (name, None) if self._plain else self._attached(kind, name)
            return original, where or (self.find(element.parent, "body")[1] if kind == "joint" else None)
        if self._plain:
            return name, f"{self._file}:{line[1]}"
        rows = {
            (own, where)
            for own, where in self._rows.get((kind, int(line[1])), ())
            if (name is None) == (own is None) and (own or "") in (name or "")
        }
        return rows.pop() if len(rows) == 1 else (None, None)

    def _attached(self, kind: str, name: str | None) -> Place:
        """The place of the element that an attached one called `name` is of: that with the longest name in it."""
        ends = [name[start:] for start in range(len(name))] if name else []
        own = next((end for end in ends if (kind, end) in self._named), None)
        places = self._named.get((kind, own or ""), set())
        return (own, next(iter(places))) if len(places) == 1 else (None, None)

    def of_message(self, message: str) -> str:
        """`file:line` of what a message of MuJoCo's is about; the file where it does not say which line."""
        if self._plain:
            line = _LINE.search(message)
            return f"{self._file}:{line[1]}" if line else self._file
        named = _NAMED_LINE.search(message)
        return self._lines.get((named[1], int(named[2])), self._file) if named else self._file


def _kind(element: etree._Element) -> str | None:
    parent = element.getparent()
    if parent is not None and parent.tag in _SECTIONS:
        return str(parent.tag)
    return {"body": "body", "link": "body", "joint": "joint", "freejoint": "joint"}.get(str(element.tag))


def _start_lines(text: str | bytes) -> Iterator[int]:
    """The line in which each start tag begins, as MuJoCo counts; lxml counts where it ends."""
    parser = expat.ParserCreate()
    lines: list[int] = []
    parser.StartElementHandler = lambda name, attributes: lines.append(parser.CurrentLineNumber)
    try:
        parser.Parse(text, True)
    except expat.ExpatError:  # such as an odd version, which lxml lets pass
        return iter(())
    return iter(lines)
