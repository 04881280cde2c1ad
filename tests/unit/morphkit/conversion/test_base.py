"""Where a converted robot is: its root, the joints of its base, and the floor."""

from __future__ import annotations

from pathlib import Path

import mujoco
import pytest

import morphkit
from morphkit.conversion.convert import convert
from morphkit.errors import ConfigError
from morphkit.morphology import Base

LINK = (
    '<link name="{}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    '<collision><geometry><sphere radius="0.1"/></geometry></collision></link>'
)
FREE, SLIDE, HINGE = (int(getattr(mujoco.mjtJoint, f"mjJNT_{kind}")) for kind in ("FREE", "SLIDE", "HINGE"))


def on_world(folder: Path, joint: str) -> Path:
    """A robot of one link that a joint ties to a link called `world`."""
    tie = f'<joint name="j" type="{joint}"><parent link="world"/><child link="a"/><axis xyz="0 0 1"/></joint>'
    (folder / "r.urdf").write_text(f'<robot name="r"><link name="world"/>{LINK.format("a")}{tie}</robot>')
    return folder / "r.urdf"


@pytest.mark.parametrize(
    ("joint", "asked", "kinds", "height"),
    [
        ("floating", None, [FREE], 0.1),
        ("planar", None, [SLIDE, SLIDE, HINGE], 0.1),
        ("fixed", None, [], 0.0),
        ("fixed", "free", [FREE], 0.1),
        ("fixed", "planar", [SLIDE, SLIDE, HINGE], 0.1),
    ],
)
def test_base_of_a_robot_on_a_world_link(
    tmp_path: Path, joint: str, asked: Base | None, kinds: list[int], height: float
) -> None:
    model = convert(morphkit.load(on_world(tmp_path, joint)), base=asked).spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    assert model.jnt_type.tolist() == kinds
    assert data.body("a").xpos[2] == pytest.approx(height)
    assert (model.ngeom == 2) == bool(kinds)  # a floor where the base moves


def test_base_that_contradicts_the_file(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="makes it free"):
        convert(morphkit.load(on_world(tmp_path, "floating")), base="fixed")


def test_other_roots_are_left_out(tmp_path: Path) -> None:
    (tmp_path / "r.urdf").write_text(f'<robot name="r">{LINK.format("a")}{LINK.format("b")}</robot>')
    conversion = convert(morphkit.load(tmp_path / "r.urdf", root="b"))
    assert [body.name for body in conversion.spec.bodies] == ["world", "b"]
    assert "link 'a' is no part of the tree below 'b' and was left out" in conversion.notes
