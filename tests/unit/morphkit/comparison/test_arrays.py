"""`diff` sees every array of the compiled models, by name."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from morphkit.ablation.ablate import ablate
from morphkit.comparison import arrays
from morphkit.comparison.compare import Comparison, compare
from morphkit.description import Description
from morphkit.readers import read
from morphkit.registry import load, shipped

WORLD = """<body name="torso"><freejoint/><geom size=".2"/><site name="one"/>
  <body name="leg" pos=".5 0 0"{body}><joint name="hip" axis="0 1 0"{joint}/><geom size=".15"/>
    <site name="two" pos="0 0 {height}"/><body name="pad" pos="0 {pad} 0"><geom size=".1"/></body></body></body>"""
POSITION = '<actuator><position name="motor" joint="hip" kp="9"{0}/></actuator>'
TENDON = '<tendon><spatial{0}><site site="one"/><site site="two"/></spatial></tendon>'
WELD = '<equality><weld body1="leg" body2="torso"{0}/></equality>'
TOUCH = '<contact><pair name="p" geom1="toe" geom2="head"{0}/></contact>'
EXCLUDE = '<contact><exclude body1="leg" body2="torso"/></contact>'
GYRO = '<sensor><gyro name="gyro" site="one"{0}/></sensor>'


def robot(option: str = "", *, more: str = "", height: str = ".1", pad: str = ".3", **places: str) -> Description:
    world = WORLD.format(body=places.get("body", ""), joint=places.get("joint", ""), height=height, pad=pad)
    return Description("r", "r.xml", "mjcf", f"<mujoco>{option}<worldbody>{world}</worldbody>{more}</mujoco>".encode())


def told(comparison: Comparison) -> set[tuple[str, str, str, str | None]]:
    return {(change.subject, change.kind, change.name, change.fact) for change in comparison.changes}


def changed(subject: str, name: str, *facts: str) -> set[tuple[str, str, str, str | None]]:
    return {(subject, "changed", name, fact) for fact in facts}


@pytest.mark.parametrize(
    ("second", "expected"),
    [
        (robot(joint=' ref="10"'), changed("joint", "hip", "qpos0")),
        (robot(joint=' springref="10"'), changed("joint", "hip", "qpos_spring")),
        (robot(joint=' damping="0 2"'), changed("joint", "hip", "dof_dampingpoly")),
        (robot(joint=' stiffness="0 2"'), changed("joint", "hip", "jnt_stiffnesspoly")),
        (robot(joint=' actuatorfrcrange="-1 1"'), changed("joint", "hip", "jnt_actfrcrange", "jnt_actfrclimited")),
        (robot(joint=' solreflimit=".1 1"'), changed("joint", "hip", "jnt_solref")),
        (robot(body=' gravcomp="1"'), changed("body", "leg", "body_gravcomp")),
        (robot(height=".2"), changed("site", "two", "site_pos")),
        (robot(pad=".2"), changed("body", "pad", "body_pos") | changed("limb", "leg", "center of mass", "inertia")),
        (robot('<option gravity="0 0 -1" timestep=".001"/>'), changed("robot", "", "gravity", "timestep")),
        (robot(more=TENDON.format(' name="t"')), {("tendon", "added", "t", None)}),
        (robot(more=WELD.format("")), {("equality", "added", "of leg and torso", None)}),
    ],
)
def test_what_changes_is_found(second: Description, expected: set[tuple[str, str, str, str | None]]) -> None:
    assert told(compare(robot(), second)) == expected


@pytest.mark.parametrize(
    ("part", "change", "expected"),
    [
        (POSITION, ' delay=".1" nsample="60"', changed("actuator", "motor", "actuator_delay")),
        (POSITION, ' damping="2"', changed("actuator", "motor", "actuator_damping")),
        (POSITION, ' armature="2"', changed("actuator", "motor", "actuator_armature")),
        (TENDON, ' stiffness="2"', changed("tendon", "along one two", "tendon_stiffness")),
        (TENDON, ' limited="true" range="0 2"', changed("tendon", "along one two", "tendon_range", "tendon_limited")),
        (WELD, ' solref=".1 1"', changed("equality", "of leg and torso", "eq_solref")),
        (WELD, ' active="false"', changed("equality", "of leg and torso", "eq_active0")),
        (GYRO, ' noise="2"', changed("sensor", "gyro", "sensor_noise")),
    ],
)
def test_what_changes_in_a_part_is_found(
    part: str, change: str, expected: set[tuple[str, str, str, str | None]]
) -> None:
    assert told(compare(robot(more=part.format("")), robot(more=part.format(change)))) == expected


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ('friction="2 .1 .1"', ["geom_friction"]),
        ('condim="6"', ["geom_condim"]),
        ('contype="2" conaffinity="0"', ["geom_conaffinity", "geom_contype"]),
        ('priority="3" solref=".1 1"', ["geom_priority", "geom_solref"]),
        ('rgba="1 0 0 1"', []),
    ],
)
def test_how_shapes_touch_is_found(change: str, expected: list[str]) -> None:
    first = robot()
    source = first.source.decode().replace('size=".15"', f'size=".15" {change}')
    found = told(compare(first, Description("r", "r.xml", "mjcf", source.encode())))
    assert found == changed("geom", "of leg number 0", *expected)


WEIGHED = """<mujoco><worldbody><body name="torso" pos="{place} 0 1"><freejoint/>
  <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><geom name="hull" type="box" size=".1 .1 {size}" {touch}/>
</body></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("place", "size", "touch", "expected"),
    [
        ("0", ".2", "", {("geom", "hull", "geom_size")}),
        ("0", ".2", 'contype="0" conaffinity="0"', set()),
        (".5", ".1", "", {("body", "torso", "body_pos")}),
    ],
)
def test_shapes_count_where_they_touch_and_roots_where_they_stand(
    place: str, size: str, touch: str, expected: set[tuple[str, str, str]]
) -> None:
    texts = (WEIGHED.format(place=each, size=wide, touch=touch) for each, wide in (("0", ".1"), (place, size)))
    first, second = (Description("r", "r.xml", "mjcf", text.encode()) for text in texts)
    assert {(change.subject, change.name, change.fact) for change in compare(first, second).changes} == expected


def test_how_meshes_touch_is_found_without_their_files() -> None:
    text = """<mujoco><asset><mesh name="m" file="nowhere.obj"/></asset><worldbody><body name="b"><freejoint/>
      <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
      <geom name="g" type="mesh" mesh="m"{}/></body></worldbody></mujoco>"""
    first, second = (Description("r", "r.xml", "mjcf", text.format(each).encode()) for each in ("", ' condim="1"'))
    assert not compare(first, second).changes  # a file that is not there has no geom
    box = text.replace('file="nowhere.obj"', 'vertex="0 0 0 1 0 0 0 1 0 0 0 1"')
    first, second = (Description("r", "r.xml", "mjcf", box.format(each).encode()) for each in ("", ' condim="1"'))
    assert told(compare(first, second)) == changed("geom", "g", "geom_condim")


def test_contact_pairs_and_exclusions_are_compared() -> None:
    def with_geoms(more: str) -> Description:
        source = robot(more=more).source.decode().replace('size=".15"', 'name="toe" size=".15"')
        return Description("r", "r.xml", "mjcf", source.replace('size=".2"', 'name="head" size=".2"').encode())

    pair, slippery = with_geoms(TOUCH.format("")), with_geoms(TOUCH.format(' friction=".1"'))
    assert told(compare(pair, slippery)) == changed("contact pair", "p", "pair_friction")
    assert told(compare(with_geoms(""), pair)) == {("contact pair", "added", "p", None)}
    excluded = compare(with_geoms(EXCLUDE), with_geoms(""))
    assert told(excluded) == {("contact exclusion", "removed", "of torso and leg", None)}


def test_no_array_is_left_out_unless_a_reason_says_so() -> None:
    model = mujoco.MjModel.from_xml_string(robot().source.decode())
    names = {name for name in dir(model) if isinstance(getattr(model, name), np.ndarray)} - {"_sizes"}
    of_elements = {name for name in names if name.partition("_")[0] not in arrays.OTHER_PREFIXES}
    assert {name for name in of_elements if arrays.is_compared(name)} >= {
        *("body_gravcomp", "jnt_actfrcrange", "jnt_stiffnesspoly", "dof_dampingpoly", "qpos0", "qpos_spring"),
        *("actuator_delay", "actuator_armature", "tendon_damping", "eq_data", "sensor_noise", "cam_fovy", "site_quat"),
    }
    assert arrays.is_compared("dof_something_new")
    assert names >= arrays.ELSEWHERE


def test_renamed_limbs_and_joints_change_no_array() -> None:
    parts = POSITION.format("") + TENDON.format("") + WELD.format("")
    first = robot(more=parts)
    source = first.source.decode().replace('"leg"', '"shank"').replace('"hip"', '"hinge"')
    comparison = compare(first, Description("r", "r.xml", "mjcf", source.encode()))
    assert {change.kind for change in comparison.changes} == {"renamed"}


@pytest.mark.parametrize("name", [d.name for d in shipped() if d.format == "mjcf"])
def test_a_cut_changes_no_array_of_what_is_left(name: str) -> None:
    whole = load(name)
    variant = ablate(whole, remove=[read(whole).limbs[-1].name]).description
    kinds = {(change.subject, change.kind) for change in compare(whole, variant).changes if change.kind == "changed"}
    assert not {subject for subject, _ in kinds} & {"body", "site", "camera", "tendon", "equality", "sensor", "geom"}
