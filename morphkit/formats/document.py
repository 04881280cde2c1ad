"""An XML source that is parsed once: all that reads it shares one tree, and what edits it gets a copy."""

from __future__ import annotations

import copy
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lxml import etree

from morphkit.formats import xml

if TYPE_CHECKING:
    from morphkit.description import Description
    from morphkit.morphology import Format


class Document:
    """A parsed XML source.

    Args:
        source: The bytes of the file.
        file: What the file is called in messages.
        tree: What `source` parses to, where that is known already.

    Attributes:
        source: The bytes.
        tree: The parsed source. It is shared, so it must not be edited.

    Raises:
        DescriptionError: As `xml.parse`.
    """

    def __init__(self, source: bytes, *, file: str, tree: etree._ElementTree | None = None) -> None:
        self.source = source
        self.tree = xml.parse(source, file=file) if tree is None else tree
        self._file = file
        self._parts: dict[Path, Document] = {}

    @classmethod
    def open(cls, path: Path) -> Document:
        """The document in a file, which messages call by its name without folders.

        Raises:
            OSError: It cannot be read.
            DescriptionError: It is too large, or as `xml.parse`.
        """
        return cls(xml.read_limited(path), file=path.name)

    @classmethod
    def of_tree(cls, tree: etree._ElementTree, *, file: str) -> Document:
        """The document that is written for an edited tree, which is taken over."""
        return cls(xml.serialize(tree), file=file, tree=tree)

    @property
    def root(self) -> Any:
        """The root element; it must not be edited."""
        return self.tree.getroot()

    @cached_property
    def format(self) -> Format:
        """`urdf` or `mjcf`.

        Raises:
            DescriptionError: The root element is another.
        """
        return xml.root_format(self.tree, file=self._file)

    @cached_property
    def text(self) -> str:
        """The source as text, without byte order mark."""
        return xml.decode(self.source, self.tree)

    @cached_property
    def spans(self) -> list[xml.Span]:
        """Byte offsets of each element in document order; none where the encoding is not based on ASCII."""
        return xml.element_spans(self.source, self.tree)

    def copy(self) -> etree._ElementTree:
        """The tree, to be edited."""
        return copy.deepcopy(self.tree)

    def part(self, path: Path) -> Document:
        """Another file that belongs to this one, such as an included one; it is opened once. Raises as `open`."""
        if path not in self._parts:
            self._parts[path] = Document.open(path)
        return self._parts[path]


def document_of(description: Description) -> Document:
    """The parsed source of a description, parsed now where nobody has asked before.

    Raises:
        DescriptionError: As `xml.parse`.
    """
    known = description.document
    if isinstance(known, Document) and known.source is description.source:
        return known
    document = Document(description.source, file=description.file)
    description.keep(document)
    return document
