"""Labels for names that read alike: told apart, none taken twice, and the same after every cut."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from morphkit.ablation.ablate import ablate
from morphkit.families.write import write_family
from morphkit.morphology import Origin
from morphkit.naming.limbs import numbered_labels
from morphkit.naming.patterns import match_limbs
from morphkit.naming.unique import fold
from morphkit.readers import read
from morphkit.registry import load, load_all, shipped
from morphkit.tokens.spec import token_spec
from tests.support.nameless_robots import GEOM, MJCF, mjcf


def test_labels_of_the_source_stand_in_the_manifest(tmp_path: Path) -> None:
    (tmp_path / "r.xml").write_text(MJCF)
    robot = load(tmp_path / "r.xml")
    path = write_family(robot, [ablate(robot, remove=["Foot"])], tmp_path / "out")
    (variant,) = load_all(path)
    spec = token_spec(read(variant))
    assert "foot_2_position_x" in [sensor.name for sensor in spec.sensors]
    assert Origin("foot_2", "body", "foot", "r-no-Foot.xml:10", 7) in spec.given_names
    assert ablate(variant, remove=["foot_2"]).removed == ("foot",)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("foot", "Foot"),
        ("left_foot", "left foot"),
        ("é_arm", "e_arm"),
        ("toe-1", "toe - 1"),
        ("leg_🦿", "leg_🤖"),
        ("a​b", "ab"),
    ],
)
def test_names_that_read_alike_are_told_apart(one: str, other: str) -> None:
    limbs = "".join(f'<body name="{name}"><joint/>{GEOM}</body>' for name in (one, other))
    text = f'<mujoco><worldbody><body name="t">{GEOM}{limbs}</body></worldbody></mujoco>'
    morphology = read(mjcf(text))
    spec = token_spec(morphology)
    assert len({fold(text) for text in spec.texts}) == len(spec.texts)
    (given,) = (each for each in spec.given_names if each.kind == "body")
    assert (given.given, given.original) == (f"{other}_2", other)
    assert match_limbs(morphology, f"{other}_2") == [other]


@pytest.mark.parametrize(
    ("one", "other"), [("left", "right"), ("a_b", "ab"), ("toe.1", "toe 1"), ("左脚", "右脚"), ("leg_1", "leg_2")]
)
def test_names_that_an_encoder_tells_apart_stay(one: str, other: str) -> None:
    assert numbered_labels([one, other], {}) == {}


def test_labels_never_take_a_name_of_the_file() -> None:
    assert numbered_labels(["foot", "Foot", "foot_2"], {}) == {"Foot": "Foot_3"}
    assert numbered_labels(["Foot", "foot_2", "new"], {"Foot": "Foot_3"}) == {"Foot": "Foot_3"}


def test_shipped_robots_have_all_their_names() -> None:
    for robot in shipped():
        assert token_spec(read(robot), source="all").given_names == ()


@st.composite
def trees(draw: st.DrawFn) -> str:
    """A robot of up to eight bodies, whose names are missing, or like what others would be given."""
    free = [
        "a",
        "A",
        "a_body",
        "a_body_2",
        "b",
        "b_body",
        "torso_body",
        "torso_body_2",
        "j_body",
        "a_joint",
        "a_body_joint",
    ]
    bodies = draw(st.lists(st.sampled_from(free), max_size=8, unique=True))
    bodies = draw(st.permutations([*bodies, *[""] * (8 - len(bodies))]))
    joints = [
        f' name="{name}"' if name else ""
        for name in draw(st.permutations(["j", "a_joint", "b_joint", "k", "", "", "", ""]))
    ]
    parents = [draw(st.integers(-1, number - 1)) for number in range(8)]

    def body(number: int) -> str:
        name = f' name="{bodies[number]}"' if bodies[number] else ""
        below = "".join(body(child) for child in range(8) if parents[child] == number)
        return f"<body{name}><joint{joints[number]}/>{GEOM}{below}</body>"

    inside = "".join(body(number) for number in range(8) if parents[number] == -1)
    motors = draw(
        st.permutations(['joint="j"', 'joint="k"', 'joint="k" name="j"', 'joint="j" name="k_2"', 'joint="j"'])
    )
    sensors = draw(st.permutations(['joint="j"', 'joint="k"', 'joint="j" name="jointpos_k"', 'joint="j" name="x"']))
    return (
        f'<mujoco><worldbody><body name="torso">{GEOM}{inside}</body></worldbody>'
        f"<actuator>{''.join(f'<motor {motor}/>' for motor in motors)}</actuator>"
        f"<sensor>{''.join(f'<jointpos {sensor}/>' for sensor in sensors)}</sensor></mujoco>"
    )


@settings(max_examples=60, deadline=None, derandomize=True)
@given(text=trees(), data=st.data())
def test_names_are_unique_and_survive_every_cut(text: str, data: st.DataObject) -> None:
    morphology = read(mjcf(text))
    spec = token_spec(morphology)
    assert len({fold(text) for text in spec.texts}) == len(spec.texts)
    labels = {limb.name: morphology.labels.get(limb.name, limb.name) for limb in morphology.limbs}
    for label, name in [(label, name) for name, label in labels.items() if label != name]:
        assert match_limbs(morphology, label) == [name]
    wish = data.draw(st.sampled_from([name for name in labels if name != "torso"]))
    variant = ablate(mjcf(text), **{data.draw(st.sampled_from(["remove", "splice"])): [wish]})
    cut = read(variant.description)
    left = token_spec(cut)
    gone = {*variant.removed, *variant.spliced}
    for kind in ("actuators", "sensors"):
        stay = [each.name for each in getattr(morphology, kind) if each.limb not in gone]
        assert [each.name for each in getattr(cut, kind)] == stay
    assert [limb.name for limb in left.limbs] == [limb.name for limb in spec.limbs if limb.name not in gone]
    kept = [sensor for sensor in spec.sensors if sensor.limb not in gone]
    assert [sensor.name for sensor in left.sensors] == [sensor.name for sensor in kept]
    assert [limb.joints for limb in left.limbs] == [limb.joints for limb in spec.limbs if limb.name not in gone]
