"""Names of strangers in terminals, tables and Markdown: without characters that steer what shows them."""

from __future__ import annotations

import re
from collections.abc import Sequence

UNSAFE = re.compile(
    "[\x00-\x09\x0b-\x1f\x7f-\x9f\xad\u061c\u180e\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb"
    "\ud800-\udfff\U000e0000-\U000e007f]"
)
"""Control characters but the newline, soft hyphen, what hides text or changes its direction; halves of surrogates."""


def printable(text: str) -> str:
    """Text with control characters, hidden ones and such that change its direction written as `\\x1b` or `\\u202e`."""
    return UNSAFE.sub(lambda found: found[0].encode("unicode_escape").decode(), text)


def one_line(text: str) -> str:
    """What `printable` gives, with newlines written as `\\n`: for names, which are not to begin a line."""
    return printable(text).replace("\n", "\\n")


def markdown_table(columns: Sequence[str], rows: Sequence[Sequence[str]], *, right: Sequence[str] = ()) -> str:
    """A table in Markdown, each row on a line; the columns in `right` are aligned right."""
    rules = ["--:" if column in right else "---" for column in columns]
    lines = [[one_line(cell.replace("\n", " ")).replace("|", "\\|") for cell in row] for row in (columns, rules, *rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"
