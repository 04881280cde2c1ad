"""XML from strangers: parsed without entities, DTD or network, and written back as it was."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any, cast
from xml.parsers import expat

from lxml import etree

from morphkit.errors import DescriptionError
from morphkit.formats import limits
from morphkit.morphology import Format

Span = tuple[int, int, int, int]
"""Byte offsets of an element: start tag from, to; end tag from, to."""

MAX_BYTES = 64 * 1024 * 1024
_UTF16_MARKS = (b"\xff\xfe", b"\xfe\xff")
_PROLOG = re.compile(rb"(?:\xef\xbb\xbf)?(?:\s+|<\?.*?\?>|<!--.*?-->)*+", re.DOTALL)
_ASCII_BASED = {"utf-8", "us-ascii", "ascii", "iso-8859-1", "latin-1"}
_START_TAG = re.compile(rb"""<(?:[^"'>]|"[^"]*+"|'[^']*+')*+>""")
_HARMLESS = (etree.ErrorTypes.NS_ERR_UNDEFINED_NAMESPACE, etree.ErrorTypes.ERR_UNKNOWN_VERSION)
_FORMATS: dict[str, Format] = {"robot": "urdf", "mujoco": "mjcf"}


class _Parser(etree.XMLParser):
    """A parser that remembers what lxml does not keep: the bytes around the root element, and line ends."""

    prolog: bytes | None = None
    epilog: bytes = b""
    crlf: bool = False


def read_limited(path: Path) -> bytes:
    """Return the bytes of a file of at most 64 MiB; OSError where it cannot be read.

    Raises:
        DescriptionError: The file is larger.
    """
    with path.open("rb") as file:
        source = file.read(MAX_BYTES + 1)
    if len(source) > MAX_BYTES:
        raise _size_error(str(path), path.stat().st_size)
    return source


def parse(source: bytes, *, file: str) -> etree._ElementTree:
    """Parse XML safely; comments, whitespace and line numbers are kept.

    Nothing is fetched and no entity expanded: a document type declaration is refused, and so are files over 64 MiB
    and elements nested deeper than 256.

    Args:
        source: The bytes of the file.
        file: What the file is called in messages.

    Raises:
        DescriptionError: The bytes are not well-formed XML, or are refused; the message starts with `file:line:`.
    """
    if not source.strip(b" \t\r\n\xef\xbb\xbf"):
        raise DescriptionError(f"{file}:1: the file is empty; expected a URDF (<robot>) or MJCF (<mujoco>) description")
    if len(source) > MAX_BYTES:
        raise _size_error(file, len(source))
    if source.count(b"<") > limits.ELEMENTS:
        raise DescriptionError(f"{file}: more than the limit of {limits.ELEMENTS:,} tags and comments")
    wide = source.startswith(_UTF16_MARKS)
    if not wide and b"\0" in source:
        line = source.count(b"\n", 0, source.index(b"\0")) + 1
        raise DescriptionError(f"{file}:{line}: NUL byte; this is a binary file, not a URDF or MJCF description")
    prolog = b"" if wide else cast(re.Match[bytes], _PROLOG.match(source)).group()
    if source[len(prolog) :].startswith(b"<!DOCTYPE"):
        raise _doctype_error(file, prolog.count(b"\n") + 1)
    parser = _parser()
    try:
        tree = _parse_leniently(source, parser)
    except etree.XMLSyntaxError as error:
        fatal = _first_serious(parser)
        reason = " ".join((fatal.message if fatal is not None else error.msg or "unknown error").split())
        line = (fatal.line if fatal is not None else error.lineno) or 1
        if "Buffer size" in reason or ("Resource limit" in reason and "depth" not in reason):
            raise DescriptionError(f"{file}:{line}: a tag, attribute or text of more than 10 MB") from None
        if "depth" in reason:
            raise DescriptionError(
                f"{file}:{line}: elements are nested deeper than 256; a robot description is flatter"
            ) from None
        raise DescriptionError(
            f"{file}:{line}: not well-formed XML: {reason}; expected a URDF (<robot>) or MJCF (<mujoco>) description"
        ) from None
    except (LookupError, ValueError) as error:
        raise DescriptionError(f"{file}:1: cannot be read as XML: {error}; save the file as UTF-8") from None
    if tree.docinfo.internalDTD is not None:
        raise _doctype_error(file, 1)
    limits.check_size(tree.getroot(), file=file)
    parser = tree.parser  # the one that made the tree, and stays with it
    if not wide:
        parser.prolog = prolog
        parser.epilog = _epilog(source, tree)
        parser.crlf = source.count(b"\r\n") == source.count(b"\n") > 0
    return tree


def _parser(*, recover: bool = False) -> _Parser:
    return _Parser(
        recover=recover,
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        dtd_validation=False,
        attribute_defaults=False,
        huge_tree=False,
        strip_cdata=False,
    )


def _parse_leniently(source: bytes, parser: _Parser) -> etree._ElementTree:
    """Parse; a prefix without a namespace (`<drake:damping>`) and an odd XML version are no reason to refuse a file."""
    try:
        return cast(etree._ElementTree, etree.parse(io.BytesIO(source), parser))
    except etree.XMLSyntaxError:
        if not len(parser.error_log) or _first_serious(parser) is not None:
            raise
        again = _parser(recover=True)
        tree = cast(etree._ElementTree, etree.parse(io.BytesIO(source), again))
        if tree.getroot() is None or _first_serious(again) is not None:
            raise
        return tree


def _first_serious(parser: _Parser) -> Any:
    return next((entry for entry in parser.error_log if entry.type not in _HARMLESS), None)


def serialize(tree: etree._ElementTree) -> bytes:
    """Return the bytes of `tree`, in the encoding that it was read in.

    What is before and after the root element (declaration, comments, final newline) is written as it was read,
    byte for byte. Comments, CDATA, whitespace between elements and the order of attributes stay; inside a tag
    attributes are joined by single spaces.
    """
    encoding = tree.docinfo.encoding or "UTF-8"
    parser = tree.parser
    if not isinstance(parser, _Parser) or parser.prolog is None:
        return cast(bytes, etree.tostring(tree, encoding=encoding, xml_declaration=True))
    root = cast(bytes, etree.tostring(tree.getroot(), encoding=encoding, xml_declaration=False, with_tail=False))
    if parser.crlf:
        root = root.replace(b"\n", b"\r\n")
    return parser.prolog + root + parser.epilog


def decode(source: bytes, tree: etree._ElementTree) -> str:
    """Return the text of the file that `tree` was parsed from, without byte order mark."""
    encoding = "utf-16" if source.startswith(_UTF16_MARKS) else tree.docinfo.encoding or "utf-8"
    try:
        return source.decode(encoding).removeprefix("\ufeff")
    except (LookupError, UnicodeDecodeError):  # a codec that libxml2 knows and Python does not
        return etree.tostring(tree, encoding="unicode")


def root_format(tree: etree._ElementTree, *, file: str) -> Format:
    """Return `urdf` or `mjcf` by the root element; DescriptionError where it is another."""
    root = tree.getroot()
    tag = root.tag
    if tag in _FORMATS:
        return _FORMATS[tag]
    hint = ""
    if tag in ("mujocoinclude", "worldbody", "body"):
        hint = "; this is a part of an MJCF model, give the file that includes it"
    elif tag == "sdf":
        hint = "; convert it to URDF or MJCF first"
    elif str(tag).startswith("{"):
        hint = "; remove the namespace declaration xmlns=... from the root element"
    raise DescriptionError(
        f"{file}:{root.sourceline}: root element <{tag}>, expected <robot> (URDF) or <mujoco> (MJCF){hint}"
    )


def _size_error(file: str, size: int) -> DescriptionError:
    return DescriptionError(
        f"{file}: {size / 2**20:.0f} MiB of XML, more than the limit of {MAX_BYTES // 2**20} MiB;"
        " move meshes and other data into files of their own"
    )


def _doctype_error(file: str, line: int) -> DescriptionError:
    return DescriptionError(
        f"{file}:{line}: document type declarations (DTD, entities) are refused, because they can read other files"
        " and grow without bound; remove <!DOCTYPE ...> and write entities out"
    )


def _epilog(source: bytes, tree: etree._ElementTree) -> bytes:
    end = len(source.rstrip())
    node = tree.getroot()
    after = list(node.itersiblings())
    for sibling in reversed(after):
        opening = b"<!--" if sibling.tag is etree.Comment else b"<?"
        end = len(source[: source.rindex(opening, 0, end)].rstrip())
    return source[end:]


def element_spans(source: bytes, tree: etree._ElementTree) -> list[Span]:
    """Byte offsets of each element in document order; none where the encoding is not based on ASCII."""
    if (tree.docinfo.encoding or "utf-8").lower() not in _ASCII_BASED:
        return []
    parser = expat.ParserCreate()
    spans: list[Span] = []
    stack: list[int] = []

    def start(name: str, attributes: dict[str, str]) -> None:
        begin = parser.CurrentByteIndex
        end = _tag_end(source, begin)
        stack.append(len(spans))
        spans.append((begin, end, end, end))

    def end(name: str) -> None:
        index = stack.pop()
        begin, tag_end, _, _ = spans[index]
        if source[tag_end - 2 : tag_end] != b"/>":
            close = parser.CurrentByteIndex
            spans[index] = (begin, tag_end, close, source.index(b">", close) + 1)

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    try:
        parser.Parse(source, True)
    except expat.ExpatError:  # such as an odd version, which lxml lets pass: then the file is written out by lxml
        return []
    return spans


def _tag_end(source: bytes, begin: int) -> int:
    """Offset after the `>` that closes the start tag at `begin`; a `>` inside quotes closes nothing."""
    match = _START_TAG.match(source, begin)
    if match is None:
        raise ValueError("a start tag without its end")  # the parser has accepted the file, so this cannot be
    return match.end()
