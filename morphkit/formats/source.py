"""An XML source that is edited as a tree and written back byte for byte where nothing was edited."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from typing import Any
from xml.sax.saxutils import escape

from morphkit.formats.document import Document
from morphkit.formats.xml import Span, serialize

_ATTRIBUTE = re.compile(r"""(\s+)([^\s=<>"'/]+)(\s*=\s*)("[^"]*"|'[^']*')""")
_WORD = re.compile(r"(\s*)(\S+)")


class Source:
    """A copy of a document's tree that remembers where each element was.

    lxml would rewrite quotes and the line breaks between attributes all over the file; `render` takes the original
    bytes wherever an element is as it was, and edits only the attributes that changed.

    Args:
        document: The parsed file.

    Attributes:
        root: The root element; edit the tree below it freely.
    """

    def __init__(self, document: Document) -> None:
        self._document, self._source = document, document.source
        self._crlf = b"\r\n" in self._source
        self._tree = document.copy()
        self.root: Any = self._tree.getroot()
        self._encoding = (self._tree.docinfo.encoding or "utf-8").lower()
        self._nodes = list(self.root.iter())  # keeps the proxies alive, so that id() identifies an element
        self._before = {id(node): _state(node) for node in self._nodes}
        self._spans: dict[int, Span] = {}
        self._edited: set[int] = set()
        elements = [node for node in self._nodes if isinstance(node.tag, str)]
        if len(document.spans) == len(elements):
            self._spans = {id(element): span for element, span in zip(elements, document.spans, strict=True)}

    def again(self) -> Source:
        """The file as it was read, to be edited anew."""
        return Source(self._document)

    def render(self) -> bytes:
        """The file's bytes after the edits."""
        if not self._spans:
            return serialize(self._tree)
        self._edited = set()
        self._find_edits(self.root)
        span = self._spans[id(self.root)]
        return self._source[: span[0]] + self._render(self.root) + self._source[span[3] :]

    def _render(self, node: Any) -> bytes:
        if not isinstance(node.tag, str):
            return self._bytes(_markup(node))
        span = self._spans.get(id(node))
        if span is not None and id(node) not in self._edited:
            return self._source[span[0] : span[3]]
        name = node.tag if node.prefix is None else f"{node.prefix}:{node.tag.rpartition('}')[2]}"
        content = self._text(node.text) + b"".join(self._render(child) + self._text(child.tail) for child in node)
        if span is None:
            start = self._bytes(f"<{name}" + "".join(f" {key}={_quote(value)}" for key, value in node.attrib.items()))
        else:
            start = self._source[span[0] : span[1]].removesuffix(b">").removesuffix(b"/")
            if self._before[id(node)][0] != tuple(node.attrib.items()):
                before = dict(self._before[id(node)][0])
                start = _edit_attributes(start.decode(self._encoding), before, dict(node.attrib)).encode(self._encoding)
        if not content and (span is None or self._source[span[1] - 2 : span[1]] == b"/>"):
            return start + b"/>"
        return start + b">" + content + self._bytes(f"</{name}>")

    def _find_edits(self, node: Any) -> bool:
        """Enter every node at or below `node` that is not as it was read, or holds one that is not."""
        edited = self._before.get(id(node)) != _state(node)
        for child in node:
            edited |= self._find_edits(child)
        if edited:
            self._edited.add(id(node))
        return edited

    def _bytes(self, text: str) -> bytes:
        if self._crlf:
            text = text.replace("\n", "\r\n")
        return text.encode(self._encoding, "xmlcharrefreplace")

    def _text(self, text: str | None) -> bytes:
        return self._bytes(escape(text)) if text else b""


def _state(node: Any) -> tuple[Any, ...]:
    """What tells whether a node was edited; its tail belongs to the parent."""
    children = tuple((id(child), child.tail) for child in node)
    return (tuple(node.attrib.items()) if isinstance(node.tag, str) else (), node.text, children)


def _markup(node: Any) -> str:
    from lxml import etree

    return str(etree.tostring(node, encoding="unicode", with_tail=False))


def _quote(value: str) -> str:
    return '"' + escape(value, {'"': "&quot;", "\n": "&#10;", "\t": "&#9;"}) + '"'


def _edit_attributes(start: str, before: dict[str, str], wanted: dict[str, str]) -> str:
    """The start tag `start`, without `>` or `/>`, with `wanted`; what is as `before` is left as written."""
    left = dict(wanted)

    def replace(match: re.Match[str]) -> str:
        space, name, equals, quoted = match.groups()
        if name == "xmlns" or ":" in name:
            left.pop(next((key for key in left if key.endswith("}" + name.partition(":")[2])), name), None)
            return match.group()
        if name not in left:
            return ""
        value = left.pop(name)
        if value == before.get(name):
            return match.group()
        return f"{space}{name}{equals}{_without_words(quoted, value) or _quote(value)}"

    edited = _ATTRIBUTE.sub(replace, start)
    end = len(edited.rstrip())
    return edited[:end] + "".join(f" {name}={_quote(value)}" for name, value in left.items()) + edited[end:]


def _without_words(quoted: str, value: str) -> str:
    """The attribute `quoted` over its lines as it is, without the words that `value` lacks; empty where it has others.

    Parsers hand out line breaks in attributes as spaces.
    """
    written = quoted[1:-1]
    words = _WORD.findall(written)
    line_starts = {number for number, (space, _) in enumerate(words) if "\n" in space}
    left = _words_left([word for _, word in words], value.split(), line_starts)
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


def _words_left(words: Sequence[str], wanted: Sequence[str], line_starts: Collection[int]) -> set[int]:
    """Which of `words` are left where `wanted` are; none where those are others.

    Among equal words it cannot be told. What a limb takes along is mostly together, and mostly from the start of a
    line.
    """
    gone = len(words) - len(wanted)
    head = _words_alike(words, wanted)
    tail = _words_alike(words[::-1], wanted[::-1])
    if gone > 0 and head + tail >= len(wanted):
        at = max((place for place in range(len(wanted) - tail, head + 1) if place in line_starts), default=head)
        return {*range(at), *range(at + gone, len(words))}
    left: set[int] = set()
    for number, word in enumerate(words):
        if len(left) < len(wanted) and word == wanted[len(left)]:
            left.add(number)
    return left if len(left) == len(wanted) else set()


def _words_alike(words: Sequence[str], others: Sequence[str]) -> int:
    """How many words from the start on are the same."""
    pairs = enumerate(zip(words, others, strict=False))
    return next((number for number, (one, other) in pairs if one != other), min(len(words), len(others)))
