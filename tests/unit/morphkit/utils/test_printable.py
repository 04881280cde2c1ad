"""Names of strangers in text and tables."""

from __future__ import annotations

import pytest

from morphkit.utils.printable import markdown_table, one_line, printable


@pytest.mark.parametrize(
    ("text", "shown"),
    [("\x1b[31m", r"\x1b[31m"), ("a\u202eb", r"a\u202eb"), ("a\nb", "a\nb"), ("é漢😀", "é漢😀"), ("\x7f", r"\x7f")],
)
def test_printable(text: str, shown: str) -> None:
    assert printable(text) == shown
    assert one_line(text) == shown.replace("\n", r"\n")


def test_a_cell_of_a_table_stays_one() -> None:
    assert markdown_table(("a", "b"), [("x|y", "1\n| forged |")], right=("b",)) == (
        "| a | b |\n| --- | --: |\n| x\\|y | 1 \\| forged \\| |\n"
    )
