"""The poses that an SRDF names, and which of them a robot starts in."""

from __future__ import annotations

from pathlib import Path

import pytest

from morphkit.ablation.ablate import ablate
from morphkit.errors import DescriptionError
from morphkit.families.write import write_family
from morphkit.registry import load
from morphkit.simulation.build import build_simulation
from morphkit.validation.check import check

LINK = """<link name="{0}"><inertial><mass value="1"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/>
</inertial></link>"""
JOINT = """<joint name="{0}" type="revolute"><parent link="trunk"/><child link="{1}"/><axis xyz="0 1 0"/>
<limit lower="-2.8" upper="-0.8" effort="20" velocity="10"/></joint>"""
URDF = f"""<robot name="dog">{"".join(LINK.format(name) for name in ("trunk", "left", "right"))}
{JOINT.format("knee_left", "left")}{JOINT.format("knee_right", "right")}</robot>"""


def state(name: str, left: str = "-1.5", right: str = "-1.5") -> str:
    """A state of two groups, one a leg."""
    return f"""<group_state name="{name}" group="left"><joint name="root" value="0 0 1 0 0 0 1"/>
      <joint name="knee_left" value="{left}"/></group_state>
      <group_state name="{name}" group="right"><joint name="knee_right" value="{right}"/></group_state>"""


def write(folder: Path, srdf: dict[str, str], said: str = "") -> Path:
    """A URDF in `urdf/`, SRDF by their path, and what `robot.toml` says."""
    path = folder / "urdf" / "dog.urdf"
    path.parent.mkdir()
    path.write_text(URDF)
    for name, text in srdf.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    if said:
        (path.parent / "robot.toml").write_text(f'file = "dog.urdf"\n{said}\n')
    return path


def dog(*states: str, name: str = "dog") -> str:
    return f'<robot name="{name}">{"".join(states)}</robot>'


@pytest.mark.parametrize("place", ["srdf/dog.srdf", "urdf/other.srdf", "urdf/srdf/dog.srdf"])
def test_a_robot_starts_in_the_pose_that_its_srdf_says(tmp_path: Path, place: str) -> None:
    path = write(tmp_path, {place: dog(state("lying", "-2.5"), state("standing", "-1.2", "-1.4"))})
    simulation = build_simulation(load(path), base="free")
    assert list(simulation.start[7:]) == pytest.approx([-1.2, -1.4])


def test_an_earlier_name_goes_first_and_without_any_the_first_pose(tmp_path: Path) -> None:
    files = {"srdf/dog.srdf": dog(state("crouch", "-2.6"), state("standing"), state("home", "-1.1", "-1.3"))}
    path = write(tmp_path, files)
    assert load(path).info.start == {"knee_left": -1.1, "knee_right": -1.3}
    (tmp_path / "srdf" / "dog.srdf").write_text(dog(state("crouch", "-2.6"), state("other")))
    assert load(path).info.start == {"knee_left": -2.6, "knee_right": -1.5}


def test_the_srdf_that_is_called_as_the_urdf_goes_first(tmp_path: Path) -> None:
    files = {"srdf/dog.srdf": dog(state("home", "-1.1")), "srdf/dog-with-arm.srdf": dog(state("home", "-2.1"))}
    assert load(write(tmp_path, files)).info.start == {"knee_left": -1.1, "knee_right": -1.5}


def test_robot_toml_goes_first_and_can_name_a_pose(tmp_path: Path) -> None:
    files = {"srdf/dog.srdf": dog(state("home"), state("crouch", "-2.6", "-2.7"))}
    path = write(tmp_path, files, 'start = "crouch"')
    assert load(path).info.start == {"knee_left": -2.6, "knee_right": -2.7}
    for said, start in (('"middle"', "middle"), ("{knee_left = -0.9}", {"knee_left": -0.9})):
        (path.parent / "robot.toml").write_text(f'file = "dog.urdf"\nstart = {said}\n')
        assert load(path).info.start == start
    (path.parent / "robot.toml").write_text('file = "dog.urdf"\nstart = "croch"\n')
    with pytest.raises(DescriptionError, match="'croch', which is not there"):
        build_simulation(load(path))


@pytest.mark.parametrize(
    ("text", "start"),
    [
        (dog(state("home", "0.0", "-9")), {"knee_left": -0.8, "knee_right": -2.8}),
        (dog(state("home", "nan", "bent")), ""),
        (dog(state("home"), name="cat"), ""),
        (dog(), ""),
        ("<robot", ""),
        ("<mujoco/>", ""),
    ],
    ids=["outside limits", "no numbers", "another robot's", "no pose", "no XML", "no SRDF"],
)
def test_what_makes_no_sense_says_nothing(tmp_path: Path, text: str, start: str | dict[str, float]) -> None:
    assert load(write(tmp_path, {"srdf/dog.srdf": text})).info.start == start


def test_check_and_variants_start_there_too(tmp_path: Path) -> None:
    path = write(tmp_path, {"srdf/dog.srdf": dog(state("standing", "-1.2"))})
    assert not [finding for finding in check(path, deep=False).findings if finding.rule == "zero-outside"]
    source = load(path)
    manifest = write_family(source, [ablate(source, remove=["right"])], tmp_path / "family")
    assert load(manifest).info.start == {"knee_left": -1.2, "knee_right": -1.5}
