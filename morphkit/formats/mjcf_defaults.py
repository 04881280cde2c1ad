"""MJCF defaults: which class an element follows, and what that class says of an attribute."""

from __future__ import annotations

from typing import Any


class Defaults:
    """The default classes of an MJCF file; several `<default>` sections count as one."""

    def __init__(self, root: Any) -> None:
        self._classes: dict[str, list[Any]] = {}
        self._parent: dict[str, str | None] = {}
        self._main = "main"
        for section in root.iterfind("default"):
            self._main = section.get("class", self._main)
        for section in root.iterfind("default"):
            self._add(section, self._main, None)

    def _add(self, section: Any, name: str, parent: str | None) -> None:
        self._classes.setdefault(name, []).append(section)
        self._parent.setdefault(name, parent)
        for nested in section.iterfind("default"):
            self._add(nested, nested.get("class", ""), name)

    def get(self, element: Any, attribute: str, fallback: str) -> str:
        """The value of `attribute` that counts: the element's own, its class's, a higher class's, or `fallback`."""
        own = element.get(attribute, "").strip()  # one without a word counts as one that is not there
        if own:
            return str(own)
        name: str | None = element.get("class") or inherited_class(element) or self._main
        while name is not None:
            for section in reversed(self._classes.get(name, [])):
                found = section.find(element.tag)
                if found is not None and found.get(attribute, "").strip():
                    return str(found.get(attribute))
            name = self._parent.get(name)
        return fallback


def inherited_class(element: Any) -> str | None:
    """The nearest `childclass` around `element`; None where its elements follow the main class."""
    for ancestor in element.iterancestors():
        if ancestor.get("childclass") is not None:
            return str(ancestor.get("childclass"))
    return None
