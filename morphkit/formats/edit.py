"""Take elements out of an lxml tree and put them elsewhere without leaving holes in the layout."""

from __future__ import annotations

from typing import Any


def detach(element: Any) -> None:
    """Remove `element` and its line; comments next to it and the indentation of what follows stay."""
    parent, previous, following = element.getparent(), element.getprevious(), element.getnext()
    before = (parent.text if previous is None else previous.tail) or ""
    tail = element.tail or ""
    merged = before if following is not None else tail  # where nothing follows, the closing tag's indentation
    if before.strip() or tail.strip():
        merged = before + tail
    elif following is not None and "\n" in before and "\n" in tail:
        merged = before.rpartition("\n")[0] + "\n" + tail.rpartition("\n")[2]
    parent.remove(element)
    if previous is None:
        parent.text = merged
    else:
        previous.tail = merged


def detach_emptied(section: Any) -> None:
    """Remove `section` where nothing but white space is left in it."""
    if len(section) == 0 and not (section.text or "").strip():
        detach(section)


def lift(element: Any, before: Any) -> None:
    """Move `element` to be before `before`, at its indentation."""
    own, wanted = _indentation(element), _indentation(before)
    detach(element)
    for node in element.iter():
        if node.text and isinstance(node.tag, str):
            node.text = _reindent(node.text, own, wanted)
        if node is not element and node.tail:
            node.tail = _reindent(node.tail, own, wanted)
    element.tail = "\n" + wanted
    before.addprevious(element)


def _indentation(element: Any) -> str:
    previous = element.getprevious()
    before = (element.getparent().text if previous is None else previous.tail) or ""
    return str(before.rpartition("\n")[2]) if "\n" in before else ""


def _reindent(text: str, own: str, wanted: str) -> str:
    if text.strip() or not own.startswith(wanted):
        return text
    lines = text.split("\n")
    return "\n".join([lines[0], *(wanted + line[len(own) :] if line.startswith(own) else line for line in lines[1:])])
