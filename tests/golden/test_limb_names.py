"""Canonical names of other people's robots, reviewed by eye; a changed rule shows here what it does to them.

`limb_names.tsv` has one limb a row, in limb order; the robots are those of packages in the corpus.
`MORPHKIT_REGENERATE=1 pytest tests/golden` writes the last column anew.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

from morphkit.morphology import Joint, Limb, Morphology
from morphkit.naming.limbs import canonical_limb_names

FILE = Path(__file__).parent / "limb_names.tsv"
HEADER, *ROWS = (line.split("\t") for line in FILE.read_text("utf-8").splitlines())
ROBOTS = list(dict.fromkeys(row[0] for row in ROWS))


def names_of(robot: str) -> dict[str, str]:
    joint = (Joint("joint", "hinge", False, 0.0, 0.0),)
    rows = [(name, parent or None) for each, name, parent, _ in ROWS if each == robot]
    limbs = tuple(Limb(name, parent, joint if parent else (), (name,)) for name, parent in rows)
    morphology = Morphology(robot, "robot.xml", "mjcf", "", "fixed", None, None, (), limbs, ())
    return canonical_limb_names(morphology, {})


@pytest.mark.parametrize("robot", ROBOTS)
def test_canonical_names_are_those_on_file(robot: str) -> None:
    names = names_of(robot)
    if os.environ.get("MORPHKIT_REGENERATE"):
        rows = [[*row[:3], names[row[1]] if row[0] == robot else row[3]] for row in ROWS]
        ROWS[:] = rows
        FILE.write_text("".join("\t".join(row) + "\n" for row in (HEADER, *rows)), "utf-8")
    assert names == {name: plain for r, name, _, plain in ROWS if r == robot}


def test_written_sides_are_never_lost_and_counterparts_differ_in_the_side_alone() -> None:
    other = {"left": "right", "right": "left"}
    for robot in ROBOTS:
        names = names_of(robot)
        for raw, plain in names.items():
            written = re.findall("left|right", raw.lower())
            if len(written) == 1:
                assert written[0] in plain.split(), (robot, raw, plain)
                swapped = re.sub("left|right", lambda found: other[found[0]], raw)
                if swapped in names and swapped != raw:
                    assert names[swapped] == plain.replace(written[0], other[written[0]], 1), (robot, raw)
