"""One rule for what a URDF means: `check` says what is mended, and all that simulate mend it alike, or all refuse."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from morphkit.ablation.ablate import ablate
from morphkit.conversion.convert import convert
from morphkit.description import Description
from morphkit.errors import DescriptionError
from morphkit.readers import read
from morphkit.simulation.build import build_simulation, compile_plain
from morphkit.simulation.inspection_model import load_mechanics
from morphkit.validation.check import check
from tests.support.faulty_robots import check_text, lines_of
from tests.support.small_urdfs import AXIS, INERTIAL, LIMIT, TENSOR, by_all, described, joint, link, masses, robot, two

VISUAL = '<visual><geometry><box size=".1 .1 .1"/></geometry>{}</visual>'
COLORS = (
    '<material name="a"><color rgba="1 0 0 1"/></material>',
    '<material name="b"><color rgba="0 1 0 1"/></material>',
)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        (two(INERTIAL + VISUAL.format("".join(COLORS))), "material"),
        (two(moving=AXIS + '<axis xyz="1 0 0"/>' + LIMIT), "axis"),
        (two(moving=AXIS + LIMIT + LIMIT.replace("-1", "-2")), "limit"),
        (two(moving='<origin xyz="0 0 1"/><origin xyz="0 0 2"/>' + AXIS + LIMIT), "origin"),
        (two(INERTIAL + INERTIAL.replace('"1"', '"9"')), "inertial"),
        (two(INERTIAL.replace("</in", '<mass value="9"/></in', 1)), "mass"),
        (two(INERTIAL.replace("</in", TENSOR + "</in", 1)), "inertia"),
        (two(moving=AXIS + LIMIT + '<dynamics damping="1"/><dynamics damping="2"/>'), "dynamics"),
        (two(moving=AXIS + LIMIT + '<child link="base"/>'), "child"),
        (two(INERTIAL + VISUAL.format('<geometry><sphere radius="1"/></geometry>')), "geometry"),
    ],
)
def test_of_what_is_there_twice_the_first_counts(tmp_path: Path, text: str, what: str) -> None:
    conversion = by_all(text)
    assert [note for note in conversion.notes if f"second <{what}>" in note]
    once = conversion.spec.compile()
    assert masses(once) == {"base": 1, "arm": 1}
    assert once.joint("j").axis.tolist() == [0, 1, 0]
    assert once.joint("j").range.tolist() == [-1, 1]
    assert once.body("arm").pos[2] == (1 if what == "origin" else 0)
    assert once.dof_damping[0] == (1 if what == "dynamics" else 0.1)
    if what == "material":
        assert once.geom_rgba[0].tolist() == [1, 0, 0, 1]
    report = check_text(tmp_path, "r.urdf", text, deep=False)
    assert len(lines_of(report, "element-repeated")) == 1
    assert not report.count("error")


@pytest.mark.parametrize(
    ("inertial", "mass", "moments"),
    [
        ('<inertial><mass value="2"/></inertial>', 2, 2e-4),
        ("<inertial><mass/></inertial>", 1e-3, 1e-7),
        ("<inertial/>", 1e-3, 1e-7),
        (f"<inertial>{TENSOR}</inertial>", 1e-3, 1e-7),
        (INERTIAL.replace('ixy="0"', ""), 1, 0.01),
        (INERTIAL.replace(' ixy="0" ixz="0" iyz="0"', ""), 1, 0.01),
        (INERTIAL.replace('izz="0.01"', ""), 1, 1e-4),
    ],
)
def test_incomplete_inertials(tmp_path: Path, inertial: str, mass: float, moments: float) -> None:
    model = by_all(two(inertial)).spec.compile()
    assert model.body("arm").mass[0] == pytest.approx(mass)
    assert model.body("arm").inertia == pytest.approx([moments] * 3)
    report = check_text(tmp_path, "r.urdf", two(inertial), deep=False)
    assert lines_of(report, "inertial-incomplete") == [3]
    assert not report.count("error")
    simulated = build_simulation(described(two(inertial))).model
    assert simulated.body("arm").mass[0] == pytest.approx(mass)


def test_an_axis_without_direction_is_refused_where_something_moves(tmp_path: Path) -> None:
    typo = '<axis xzy="0 1 0"/>'
    for kind in ("revolute", "continuous", "prismatic", "planar"):
        text = two(moving=typo + LIMIT, kind=kind)
        for use in (read, convert, build_simulation, load_mechanics, compile_plain):
            with pytest.raises(DescriptionError, match=r"r\.urdf:4: joint 'j' has an <axis> without xyz, but xzy"):
                use(described(text))
        assert lines_of(check_text(tmp_path, "r.urdf", text, deep=False), "axis-missing") == [4]
    hand = link("hand") + joint("k", "arm", "hand", typo, kind="fixed")
    conversion = by_all(two(extra=hand))
    assert any("'xzy', which counts for nothing; did you mean 'xyz'?" in note for note in conversion.notes)
    report = check_text(tmp_path, "r.urdf", two(extra=hand), deep=False)
    assert lines_of(report, "attribute-unknown") == [5]
    assert not report.count("error")


def test_a_robot_of_the_world_alone_is_refused_by_all() -> None:
    for use in (read, convert, build_simulation, load_mechanics):
        with pytest.raises(DescriptionError, match="no <link> but 'world'"):
            use(described('<robot name="r"><link name="world"/></robot>'))


@pytest.mark.parametrize("kind", ["revolute", "continuous", "prismatic", "planar"])
def test_an_axis_of_length_zero_is_refused_by_all(kind: str) -> None:
    text = two(moving='<axis xyz="0 0 0"/>' + LIMIT, kind=kind)
    for use in (read, convert, build_simulation, load_mechanics, compile_plain):
        with pytest.raises(DescriptionError, match=r"r\.urdf:4: joint 'j' has the axis 0 0 0, which has no direction"):
            use(described(text))


def test_limits_of_a_ball_joint_count_for_nothing(tmp_path: Path) -> None:
    text = two(moving=LIMIT, kind="spherical")
    conversion = by_all(text)
    assert "lower and upper of spherical joint 'j' count for nothing: it has no single position" in conversion.notes
    model = conversion.spec.compile()
    assert not model.jnt_limited.any()
    assert read(described(text)).joints[0].kind == "ball"
    assert not check_text(tmp_path, "r.urdf", text, deep=False).count("error")


@pytest.mark.parametrize("encoding", ["utf-8-sig", "iso-8859-1", "utf-16", "windows-1252"])
def test_a_file_in_another_encoding_is_read_by_all(encoding: str) -> None:
    text = two().replace('"arm"', '"ärm"').removeprefix("<?xml version='1.0'?>")
    declared = f'<?xml version="1.0" encoding="{encoding.removesuffix("-sig")}"?>\n{text}'
    robot = Description("r", "r.urdf", "urdf", declared.encode(encoding))
    names = [limb.name for limb in read(robot).limbs]
    assert "ärm" in names
    model = convert(robot, thorough=False).spec.compile()
    assert {model.body(number).name for number in range(model.nbody)} >= set(names)
    build_simulation(robot)
    load_mechanics(robot)


@pytest.mark.parametrize(
    "other", ['<limit low="-1" uper="1" effort="5" velocity="3"/>', '<origin xzy="0 0 1"/>' + LIMIT]
)
def test_other_slips_of_the_pen_are_found(tmp_path: Path, other: str) -> None:
    report = check_text(tmp_path, "r.urdf", two(moving=AXIS + other), deep=False)
    assert lines_of(report, "attribute-unknown")


def test_the_world_has_no_mass(tmp_path: Path) -> None:
    tensor = '<inertia ixx="0.01" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/>'
    heavy = link("world", f'<inertial><mass value="0.01"/>{tensor}</inertial>')
    text = robot(
        heavy, link("base"), link("arm"), joint("w", "world", "base", "", kind="fixed"), joint("j", "base", "arm")
    )
    conversion = by_all(text)
    assert conversion.mass == 2
    assert any("'world' is the world: its <inertial> counts as none" in note for note in conversion.notes)
    assert lines_of(check_text(tmp_path, "r.urdf", text, deep=False), "world-mass") == [2]


BELOW = robot(
    link("map", ""),
    link("world", ""),
    link("base", INERTIAL + '<collision><geometry><box size=".2 .2 .2"/></geometry></collision>'),
    link("arm"),
    joint("mw", "map", "world", '<origin xyz="0 0 1"/>', kind="fixed"),
    joint("wb", "world", "base", '<origin xyz="0 1 0"/>', kind="fixed"),
    joint("j", "base", "arm"),
    '<sensor name="imu" type="imu"><parent link="world"/></sensor>',
    '<gazebo reference="world"><a/></gazebo>',
)


def test_a_link_called_world_that_is_no_root_is_a_link(tmp_path: Path) -> None:
    conversion = by_all(BELOW)
    model = conversion.spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert data.body("base").xpos.tolist() == [0, 1, 1]
    assert conversion.mass == 2
    report = check_text(tmp_path, "r.urdf", BELOW, deep=False)
    assert lines_of(report, "world-inside") == [6]
    assert not report.count("error")
    free = convert(described(BELOW), base="free").spec.compile()
    assert free.body_weldid[1:].all()
    fallen = mujoco.MjData(free)
    mujoco.mj_step(free, fallen, nstep=20)
    assert fallen.body("base").xpos[2] < fallen.body("world_link").xpos[2] + 1
    assert fallen.body("map").xpos[2] < free.body("map").pos[2]
    morphology = read(described(BELOW))
    assert morphology.root.members == ("map", "world_link", "base")
    assert morphology.sensors[0].limb == "map"
    assert {origin.original for origin in morphology.origins if origin.given == "world_link"} == {"world"}


def test_a_cut_leaves_and_takes_a_link_called_world_by_its_own_name() -> None:
    kept = ablate(described(BELOW), remove=["arm"]).description.source
    assert b"world_link" not in kept
    assert kept.count(b'"world"') == BELOW.count('"world"')
    gone = ablate(described(BELOW), remove=["world_link"])
    assert b"world" not in gone.description.source
    assert {loss.kind for loss in gone.lost} >= {"sensor", "gazebo"}


def test_world_on_a_hinge() -> None:
    text = robot(link("base"), link("world"), joint("j", "base", "world"))
    conversion = by_all(text)
    assert conversion.mass == 2
    assert conversion.spec.compile().body("world_link").jntnum[0] == 1
    assert any("'world' is no root: it is called 'world_link'" in note for note in conversion.notes)


def test_moments_below_what_mujoco_takes(tmp_path: Path) -> None:
    def moments(*values: str) -> str:
        return '<inertia ixx="{}" iyy="{}" izz="{}" ixy="0" ixz="0" iyz="0"/>'.format(*values)

    for mass, tensor in (
        ("6e-8", moments("2e-15", "2e-15", "2e-15")),
        ("1e-6", moments("5e-14", "5e-14", "2e-15")),
        ("1e-6", moments("1e-14", "1e-14", "1e-14")),
        ("0", moments("0", "0", "0.001")),
        ("0", moments("-1", "2", "0.001")),
        ("1e-12", moments("0", "0", "0.001")),
    ):
        logo = link("logo", f'<inertial><mass value="{mass}"/>{tensor}</inertial>') + joint(
            "k", "arm", "logo", "", kind="fixed"
        )
        conversion = by_all(two(extra=logo))
        assert conversion.mass == pytest.approx(2)
        assert np.isfinite(conversion.spec.compile().body_inertia).all()
        report = check_text(tmp_path, "r.urdf", two(extra=logo), deep=False)
        assert not report.count("error")
        assert report.findings


def test_a_transmission_of_no_joint_is_a_finding_only(tmp_path: Path) -> None:
    drive = '<transmission name="{0}"><joint name="{0}"/><actuator name="m_{0}"/></transmission>'
    text = two(extra=drive.format("q") + drive.format("j"))
    assert [actuator.name for actuator in read(described(text)).actuators] == ["m_j"]
    assert by_all(text).motors == 1
    assert by_all(two(extra=drive.format("q"))).motors == 1  # none is left: effort limits count
    report = check_text(tmp_path, "r.urdf", text, deep=False)
    assert lines_of(report, "reference-ignored") == [5]
    assert not report.count("error")


@pytest.mark.parametrize("number", ["1_0", "\u0661", "0x1", "1,0"])
def test_numbers_that_only_python_reads_are_none(tmp_path: Path, number: str) -> None:
    text = two(INERTIAL.replace('value="1"', f'value="{number}"'))
    with pytest.raises(DescriptionError, match=r"r\.urdf:3: value=.*expected a number"):
        read(described(text))
    assert lines_of(check_text(tmp_path, "r.urdf", text, deep=False), "number-invalid") == [3]


def test_infinite_masses_and_places_are_refused_by_all(tmp_path: Path) -> None:
    for text in (
        two(INERTIAL.replace('value="1"', 'value="inf"')),
        two(moving='<origin xyz="1e999 0 0"/>' + AXIS + LIMIT),
    ):
        with pytest.raises(DescriptionError, match="not finite"):
            read(described(text))
        assert lines_of(check_text(tmp_path, "r.urdf", text, deep=False), "number-invalid")


@pytest.mark.parametrize(
    ("bounds", "limits", "rule"),
    [
        ('lower="-1"', (-1.0, 0.0), "limit-partial"),
        ('upper="1"', (0.0, 1.0), "limit-partial"),
        ('lower="1" upper="-1"', None, "limit-inverted"),
        ('upper="-1"', None, "limit-inverted"),
    ],
)
@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_bounds_that_are_half_or_inverted_mean_the_same_to_all(
    bounds: str, limits: tuple[float, float] | None, rule: str, kind: str, tmp_path: Path
) -> None:
    text = two(moving=AXIS + f'<limit {bounds} effort="1" velocity="1"/>').replace("revolute", kind)
    (found,) = read(described(text)).joints
    assert (found.low, found.high) == (limits or (0.0, 0.0))
    conversion = by_all(text)
    assert any("joint 'j'" in note for note in conversion.notes)
    for model in (conversion.spec.compile(), build_simulation(described(text)).model):
        assert bool(model.jnt_limited[0]) == found.limited == (limits is not None)
        assert limits is None or np.allclose(model.jnt_range[0], limits)
    assert lines_of(check_text(tmp_path, "r.urdf", text, deep=False), rule)


def test_processing_instructions_say_nothing() -> None:
    text = two().replace("<link", "<?editor fold?><link").replace("<robot", "<?xml-model href='urdf.xsd'?><robot")
    assert by_all(text).bodies == 2


def test_a_world_that_carries_several_robots_has_several_roots(tmp_path: Path) -> None:
    arms = "".join(link(name, INERTIAL) + joint(f"j_{name}", "world", name, "", kind="fixed") for name in ("a", "b"))
    text = robot('<link name="world"/>' + arms)
    with pytest.raises(DescriptionError, match="2 top-level link elements, expected one: a, b"):
        read(described(text))
    assert lines_of(check_text(tmp_path, "r.urdf", text, deep=False), "roots-several")


def test_check_says_what_only_the_conversion_finds(tmp_path: Path) -> None:
    """A mesh that check's own look takes for sound, and MuJoCo refuses."""
    (tmp_path / "m.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    mesh = '<collision><geometry><mesh filename="m.obj"/></geometry></collision>'
    (tmp_path / "r.urdf").write_text(two(INERTIAL + mesh))
    report = check(tmp_path / "r.urdf")
    (finding,) = [found for found in report.findings if found.severity == "error"]
    assert finding.rule == "simulator-refuses"
    assert "m.obj" in finding.message
    assert not check(tmp_path / "r.urdf", deep=False).count("error")
    assert {path.name for path in tmp_path.iterdir()} == {"r.urdf", "m.obj"}
