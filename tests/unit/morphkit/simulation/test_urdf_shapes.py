"""Shapes of which nothing can be made: `check` and all that simulates say the same of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from morphkit.ablation.ablate import ablate
from morphkit.conversion.convert import convert
from morphkit.description import Description
from morphkit.errors import DescriptionError
from morphkit.readers import read
from morphkit.simulation.build import build_simulation
from morphkit.simulation.inspection_model import load_mechanics
from morphkit.validation.check import check

INERTIAL = '<inertial><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial>'
LIMIT = '<limit effort="1" velocity="1"/>'
NOTHING = ["", "<geometry/>", "<geometry><!-- box --></geometry>"]
UNKNOWN = ['<cone radius=".1" length=".2"/>', '<plane normal="0 0 1"/>']
WRONG = [
    "<sphere/>", '<sphere radius="-.1"/>', '<sphere radius="x"/>', '<sphere radius=""/>', '<sphere radius="1 1"/>',
    '<cylinder radius=".1"/>', '<cylinder length=".1"/>', '<capsule radius=".1" length="-1"/>', '<box size=".1 .1"/>',
    '<box size=".1 nan .1"/>', '<box size=".1 inf .1"/>', '<box size="1 -1 1"/>', '<mesh filename="m" scale="1 1 x"/>',
    '<mesh filename="m" scale="nan nan nan"/>',
]  # fmt: skip
FLAT = ['<box size=".1 .1 0"/>', '<sphere radius="0"/>', '<cylinder radius="0" length=".1"/>']


def urdf(part: str) -> str:
    joint = f'<joint name="j" type="continuous"><parent link="base"/><child link="arm"/>{LIMIT}</joint>'
    base, arm = (f'<link name="{name}">{INERTIAL}' for name in ("base", "arm"))
    return f'<robot name="r">{base}</link>\n{arm}{part}</link>{joint}</robot>'


def robot(part: str) -> Description:
    return Description("r", "r.urdf", "urdf", urdf(part).encode())


def part(tag: str, inside: str) -> str:
    return f"<{tag}>{inside}</{tag}>"


def shaped(tag: str, shape: str) -> str:
    return part(tag, f"<geometry>{shape}</geometry>")


LEFT_OUT = [
    *(part("visual", each) for each in NOTHING),
    *(shaped("visual", each) for each in UNKNOWN + WRONG + FLAT),
    shaped("collision", '<sphere radius="0"/>'),
]


REFUSED = [part("collision", each) for each in NOTHING] + [shaped("collision", each) for each in UNKNOWN + WRONG]


@pytest.mark.parametrize("text", LEFT_OUT)
def test_what_only_decorates_or_has_no_extent_is_left_out(text: str, tmp_path: Path) -> None:
    description = robot(text)
    assert len(read(description).limbs) == 2
    conversion = convert(description, thorough=False, floor=False)
    assert not list(conversion.spec.geoms)
    assert any("of link 'arm'" in note and note.endswith("and was left out") for note in conversion.notes)
    build_simulation(description)
    assert any("left out" in note for note in load_mechanics(description).notes)
    assert read(ablate(description, remove=["arm"]).description).root.name == "base"
    (tmp_path / "r.urdf").write_text(urdf(text))
    findings = check(tmp_path / "r.urdf", deep=False)
    assert not findings.count("error")
    assert findings.count("warning") == 1


@pytest.mark.parametrize("text", REFUSED)
def test_collisions_that_nothing_can_be_made_of_are_refused(text: str, tmp_path: Path) -> None:
    description = robot(text)
    for command in (convert, build_simulation, load_mechanics):
        with pytest.raises(DescriptionError, match=r"r\.urdf:2: a collision of link 'arm' has"):
            command(description)
    (tmp_path / "r.urdf").write_text(urdf(text))
    assert check(tmp_path / "r.urdf", deep=False).count("error") == 1


@pytest.mark.parametrize("reference", ["<mesh/>", '<mesh filename=""/>'])
def test_meshes_without_a_file_name_are_called_as_in_the_file(reference: str) -> None:
    (note, *_) = convert(robot(shaped("visual", reference)), thorough=False).notes
    assert note.startswith("mesh '' was left out: ")
