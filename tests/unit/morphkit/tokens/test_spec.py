"""Tokens of hand-made robots: order, names, units, bounds, and the JSON and CSV forms."""

from __future__ import annotations

import csv
import io
import json
import math
from dataclasses import replace
from typing import Any

import pytest

from morphkit.errors import ConfigError, DescriptionError
from morphkit.morphology import Actuator, Joint, JointKind, Limb, Morphology
from morphkit.naming.unique import fold
from morphkit.tokens.spec import TokenSpec, token_spec


def hinge(name: str, kind: JointKind = "hinge") -> Joint:
    return Joint(name, kind, True, -1.0, 1.0)


def motor(name: str, limb: str | None, joint: str | None = None) -> Actuator:
    return Actuator(name, limb, joint, -1.0, 1.0, "1")


def make(limbs: tuple[Limb, ...], actuators: tuple[Actuator, ...] = ()) -> Morphology:
    return Morphology("arm", "arm.xml", "mjcf", "a" * 64, "fixed", "arm", "raise", (("hand",),), limbs, actuators)


ARM = make(
    (
        Limb("base", None, (), ("base",)),
        Limb("shoulder", "base", (hinge("shoulder_pan"), hinge("shoulder_lift")), ("shoulder",)),
        Limb("lhand", "shoulder", (hinge("hand_joint", "slide"),), ("lhand", "palm"), "hand"),
        Limb("free", "base", (hinge("free_joint"),), ("free",)),
    ),
    (
        motor("m1", "shoulder", "shoulder_pan"),
        Actuator("m2", "shoulder", "shoulder_lift", -math.inf, math.inf, "N*m"),
        motor("pull", None),
        motor("m3", "lhand", "hand_joint"),
    ),
)

BODY_SCALARS = [
    *(f"{quantity}_{axis}" for quantity in ("position", "translational_velocity") for axis in "xyz"),
    *(f"{quantity}_{axis}" for quantity in ("rotational_velocity", "exponential_map") for axis in "xyz"),
    *(f"type_{i}" for i in range(4)),
]
JOINT_SCALARS = ["angle", "joint_range_low", "joint_range_high"]


def test_a_limb_has_sixteen_body_scalars_and_three_a_joint() -> None:
    spec = token_spec(ARM)
    expected = [f"base_{scalar}" for scalar in BODY_SCALARS + JOINT_SCALARS]
    expected += [f"shoulder_{scalar}" for scalar in BODY_SCALARS]
    expected += [f"shoulder_{joint}_{s}" for joint in ("shoulder_pan", "shoulder_lift") for s in JOINT_SCALARS]
    expected += [f"{limb}_{scalar}" for limb in ("lhand", "free") for scalar in BODY_SCALARS + JOINT_SCALARS]
    assert [sensor.name for sensor in spec.sensors] == expected
    assert [sensor.index for sensor in spec.sensors] == list(range(79))


def test_token_limb_and_actuator_limb_say_what_belongs_where() -> None:
    spec = token_spec(ARM)
    assert spec.token_limb.tolist() == [0] * 19 + [1] * 22 + [2] * 19 + [3] * 19
    assert spec.actuator_limb.tolist() == [1, 1, -1, 2]


@pytest.mark.parametrize(
    ("name", "fields"),
    [
        ("base_position_x", ("position", "x", "m", "world", None, None)),
        ("base_translational_velocity_z", ("translational_velocity", "z", "m/s", "world", -10.0, 10.0)),
        ("base_rotational_velocity_y", ("rotational_velocity", "y", "rad/s", "world", None, None)),
        ("base_exponential_map_y", ("exponential_map", "y", "rad", "world", None, None)),
        ("base_type_3", ("type", "3", "1", None, None, None)),
        ("base_angle", ("angle", None, "1", None, None, None)),
        ("shoulder_shoulder_lift_joint_range_low", ("joint_range_low", None, "1", None, None, None)),
        ("lhand_angle", ("angle", None, "m", None, None, None)),
        ("lhand_joint_range_high", ("joint_range_high", None, "m", None, None, None)),
    ],
)
def test_quantity_component_unit_frame_and_bounds(name: str, fields: tuple[Any, ...]) -> None:
    sensor = next(sensor for sensor in token_spec(ARM).sensors if sensor.name == name)
    assert (
        sensor.quantity,
        sensor.component,
        sensor.unit,
        sensor.frame,
        sensor.low,
        sensor.high,
    ) == fields


def test_actuator_names_say_limb_then_joint_where_a_limb_has_several() -> None:
    names = [actuator.name for actuator in token_spec(ARM).actuators]
    assert names == ["shoulder_shoulder_pan_ctrl", "shoulder_shoulder_lift_ctrl", "pull_ctrl", "lhand_ctrl"]
    unbounded = token_spec(ARM).actuators[1]
    assert (unbounded.low, unbounded.high, unbounded.unit, unbounded.joint) == (None, None, "N*m", "shoulder_lift")


def test_two_actuators_on_one_joint_are_called_by_their_own_names() -> None:
    limbs = (Limb("base", None, (), ("base",)), Limb("arm", "base", (hinge("j"),), ("arm",)))
    spec = token_spec(make(limbs, (motor("push", "arm", "j"), motor("pull", "arm", "j"), motor("site", "arm"))))
    assert [actuator.name for actuator in spec.actuators] == ["arm_push_ctrl", "arm_pull_ctrl", "arm_site_ctrl"]


def test_text_has_words_and_the_raw_style_has_the_name() -> None:
    assert token_spec(ARM).sensors[0].text == "base position x"
    assert token_spec(ARM, text_style="raw").sensors[0].text == "base_position_x"
    assert token_spec(ARM, text_style="raw").actuators[3].text == "lhand_ctrl"


def test_canonical_names_keep_the_limbs_of_the_file() -> None:
    spec = token_spec(ARM, naming="canonical")
    sensor = spec.sensors[41]
    assert (sensor.name, sensor.text, sensor.limb) == ("left_hand_position_x", "left hand position x", "lhand")
    assert [limb.name for limb in spec.limbs] == ["base", "shoulder", "lhand", "free"]
    assert [sensor.text for sensor in spec.sensors[35:39:3]] == ["shoulder pan angle", "shoulder lift angle"]
    assert [a.text for a in spec.actuators] == [
        "shoulder pan ctrl",
        "shoulder lift ctrl",
        "pull ctrl",
        "left hand ctrl",
    ]
    given = token_spec(ARM, naming="canonical", canonical={"lhand": "gripper"})
    assert (given.sensors[41].name, given.actuators[3].text) == ("gripper_position_x", "gripper ctrl")


def test_limbs_called_by_their_first_joint() -> None:
    names = [sensor.name for sensor in token_spec(ARM, limb_names="joint").sensors]
    assert names[0] == "base_position_x"
    assert names[19] == "shoulder_pan_position_x"
    assert names[41] == "hand_joint_position_x"
    assert token_spec(ARM, limb_names="joint").actuators[3].name == "hand_joint_ctrl"


@pytest.mark.parametrize("naming", ["raw", "canonical"])
@pytest.mark.parametrize("limb_names", ["body", "joint"])
def test_names_and_texts_are_unique_even_uncased(naming: Any, limb_names: Any) -> None:
    limbs = (
        Limb("Foot", None, (), ("Foot",)),
        Limb("foot", "Foot", (hinge("arm_a"),), ("foot",)),
        Limb("arm", "foot", (hinge("a"), hinge("b")), ("arm",)),
        Limb("arm_a", "arm", (hinge("A"),), ("arm_a",)),
        Limb("l_calf", "arm", (hinge("c"),), ("l_calf",)),
        Limb("left_shin", "arm", (hinge("d"),), ("left_shin",)),
    )
    actuators = (*(motor(limb.name, limb.name) for limb in limbs[1:]), motor("m", "arm"), motor("m", "arm"))
    actuators += (motor("arm_a", None), motor("foot", None))
    spec = token_spec(make(limbs, actuators), naming=naming, limb_names=limb_names)
    for field in ("name", "text"):
        values = [fold(getattr(token, field)) for token in (*spec.sensors, *spec.actuators)]
        assert len(set(values)) == len(values)
    assert spec == token_spec(make(limbs, actuators), naming=naming, limb_names=limb_names)


def test_json_has_the_keys_of_the_schema_in_order_and_reads_back() -> None:
    spec = token_spec(ARM)
    text = spec.to_json()
    document = json.loads(text)
    assert list(document) == [
        *("schema_version", "morphology", "source", "naming", "family", "task", "base"),
        *("limbs", "sensors", "actuators"),
    ]
    assert document["schema_version"] == 1
    assert document["source"] == {"file": "arm.xml", "format": "mjcf", "sha256": "a" * 64}
    assert document["limbs"][1] == {
        "name": "shoulder",
        "parent": "base",
        "type": None,
        "joints": ["shoulder_pan", "shoulder_lift"],
    }
    assert list(document["sensors"][0]) == [
        *("index", "name", "text", "limb", "quantity", "component", "unit", "frame", "low", "high"),
    ]
    assert list(document["actuators"][0]) == ["index", "name", "text", "limb", "joint", "unit", "low", "high"]
    assert document["actuators"][1]["low"] is None
    assert text.startswith('{\n  "schema_version": 1,\n')
    assert text.endswith("\n}\n")
    assert TokenSpec.from_json(text) == spec
    assert TokenSpec.from_json(text).to_json() == text


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("schema_version",), 2, "schema_version is 2"),
        (("schema_version",), ..., "schema_version is missing"),
        (("source", "sha256"), ..., "source.sha256 is missing"),
        (("sensors", 3, "unit"), ..., r"sensors\[3\].unit is missing"),
        (("sensors",), {}, "sensors must be a list"),
        (("limbs", 1), "shoulder", r"limbs\[1\] must be an object"),
        (("limbs", 1, "joints"), None, r"limbs\[1\].joints must be a list"),
        (("sensors", 3, "limb"), "tail", r"sensors\[3\].limb 'tail' is not among limbs"),
        (("actuators", 1, "index"), 0, r"actuators\[1\].index is 0, expected 1"),
    ],
)
def test_damaged_json_is_refused(path: tuple[Any, ...], value: Any, message: str) -> None:
    document = json.loads(token_spec(ARM).to_json())
    place = document
    for key in path[:-1]:
        place = place[key]
    if value is ...:
        del place[path[-1]]
    else:
        place[path[-1]] = value
    with pytest.raises(DescriptionError, match=message):
        TokenSpec.from_json(json.dumps(document))


def test_cut_json_is_refused() -> None:
    with pytest.raises(DescriptionError, match="no JSON"):
        TokenSpec.from_json(token_spec(ARM).to_json()[:500])


def test_csv_has_a_row_a_token() -> None:
    rows = list(csv.DictReader(io.StringIO(token_spec(ARM).to_csv())))
    assert len(rows) == 79 + 4
    assert rows[3] | {"kind": "sensor", "name": "base_translational_velocity_x", "low": "-10.0", "joint": ""} == rows[3]
    assert rows[80]["kind"] == "actuator"
    assert (rows[80]["quantity"], rows[80]["joint"], rows[80]["low"]) == ("ctrl", "shoulder_lift", "")


def test_a_limb_without_joints_has_one_angle_like_the_root() -> None:
    spec = token_spec(make((Limb("base", None, (), ("base",)), Limb("stub", "base", (), ("stub",)))))
    assert [sensor.name for sensor in spec.sensors[-3:]] == [f"stub_{scalar}" for scalar in JOINT_SCALARS]


@pytest.mark.parametrize("option", ["naming", "limb_names", "text_style"])
def test_an_option_with_another_value_is_refused(option: str) -> None:
    with pytest.raises(ConfigError, match=f"{option} is 'both', expected one of"):
        token_spec(ARM, **{option: "both"})  # type: ignore[arg-type]


@pytest.mark.parametrize("limited", [True, False])
def test_a_slide_is_in_metres_throughout(limited: bool) -> None:
    joint = Joint("rail", "slide", limited, -0.5 * limited, 1.0 * limited)
    spec = token_spec(make((Limb("base", None, (), ("base",)), Limb("cart", "base", (joint,), ("cart",)))))
    assert [sensor.unit for sensor in spec.sensors[-3:]] == ["m", "m", "m"]


def test_control_bounds_are_kept() -> None:
    arm = replace(ARM, actuators=(Actuator("m", "free", "free_joint", -2.0, 3.5, "N*m"),))
    assert (token_spec(arm).actuators[0].low, token_spec(arm).actuators[0].high) == (-2.0, 3.5)
