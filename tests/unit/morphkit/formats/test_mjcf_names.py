"""Names for elements of an MJCF file that have none: unique, traced to the file, and kept by every cut."""

from __future__ import annotations

import json
from pathlib import Path

import mujoco
import pytest

from morphkit.ablation.ablate import ablate
from morphkit.errors import DescriptionError
from morphkit.readers import read
from morphkit.registry import load
from morphkit.tokens.spec import TokenSpec, token_spec
from morphkit_cli.main import run
from tests.support.nameless_robots import GEOM, MJCF, mjcf, names


def test_elements_of_an_mjcf_file_are_named_after_what_they_hold() -> None:
    morphology = read(mjcf())
    assert names(morphology) == ["torso", "thigh", "knee_body", "torso_body", "torso_body_2", "Foot", "foot"]
    assert morphology.limb("torso_body_2").members == ("torso_body_2", "torso_body_2_body")
    assert [joint.name for joint in morphology.joints[3:5]] == ["torso_body_joint", "torso_body_2_joint"]
    assert [actuator.name for actuator in morphology.actuators] == [
        "knee",
        "thigh",
        "hip",
        "pid_position",
        "pid_velocity",
    ]
    assert [sensor.name for sensor in morphology.sensors] == ["framepos_torso", "torso_position"]
    assert morphology.labels == {"foot": "foot_2"}


def test_the_map_of_an_mjcf_file() -> None:
    spec = token_spec(read(mjcf()), source="all")
    found = [(each.given, each.kind, each.original, each.where, each.id) for each in spec.given_names]
    assert found == [
        ("knee_body", "body", None, "r.xml:5", 3),
        ("torso_body", "body", None, "r.xml:8", 4),
        ("torso_body_2", "body", None, "r.xml:9", 5),
        ("torso_body_2_body", "body", None, "r.xml:9", 6),
        ("torso_body_joint", "joint", None, "r.xml:8", 4),
        ("torso_body_2_joint", "joint", None, "r.xml:9", 5),
        ("framepos_torso", "sensor", None, "r.xml:22", 0),
        ("knee", "actuator", None, "r.xml:16", 0),
        ("hip", "actuator", None, "r.xml:18", 2),
        ("pid_position", "actuator", "pid", "r.xml:19", 3),
        ("pid_velocity", "actuator", "pid", "r.xml:19", 3),
        ("foot_2", "body", "foot", "r.xml:11", 8),
        *((f"torso_position_{axis}_2", "sensor", "torso_position", "r.xml:23", 1) for axis in "xyz"),
        ("thigh_ctrl_2", "actuator", "thigh", "r.xml:17", 1),
    ]
    assert TokenSpec.from_json(spec.to_json()) == spec
    assert len(json.loads(spec.to_json())["given_names"]) == len(found)


def test_ids_are_those_of_the_compiled_model() -> None:
    expanding = MJCF.replace(
        '<body name="Foot">',
        '<replicate count="2"><body name="x"><joint name="y"/><geom size=".1"/></body></replicate>\n<body name="Foot">',
    )
    model = mujoco.MjModel.from_xml_string(expanding)
    for origin in read(mjcf(expanding)).origins:
        element = getattr(model, origin.kind)(origin.id)
        assert element.name == (
            ""
            if origin.original is None
            else {"x": origin.given, "y": origin.given}.get(origin.original, origin.original)
        )


def test_copies_are_traced_to_what_was_copied(tmp_path: Path) -> None:
    (tmp_path / "leg.xml").write_text(
        f"<mujocoinclude>\n\n<body name='leg'>{GEOM}<body>{GEOM}<joint/></body></body></mujocoinclude>"
    )
    (tmp_path / "arm.xml").write_text(
        f'<mujoco>\n<worldbody>\n<body\n name="arm"><joint name="j"/>{GEOM}</body></worldbody></mujoco>'
    )
    (tmp_path / "r.xml").write_text(f"""<mujoco><asset><model name="m" file="arm.xml"/></asset><worldbody>
<body name="base">{GEOM}
<replicate count="2"><body name="toe"><joint name="t"/>{GEOM}</body></replicate>
<include file="leg.xml"/>
<attach model="m" body="arm" prefix="l_"/><attach model="m" body="arm" prefix="r_"/>
</body></worldbody></mujoco>""")
    found = {each.given: (each.original, each.where) for each in token_spec(read(load(tmp_path / "r.xml"))).given_names}
    assert found == {
        **{f"toe{i}": ("toe", "r.xml:3") for i in range(2)},
        **{f"t{i}": ("t", "r.xml:3") for i in range(2)},
        "leg_body": (None, "leg.xml:3"),
        "leg_body_joint": (None, "leg.xml:3"),
        **{f"{side}_arm": ("arm", "arm.xml:4") for side in "lr"},
        **{f"{side}_j": ("j", "arm.xml:4") for side in "lr"},
    }


@pytest.mark.parametrize(
    "beside", ["", '<replicate count="2"><body name="toe"><joint/><geom size=".1"/></body></replicate>']
)
@pytest.mark.parametrize("name", ["", "root"])
def test_a_free_joint_stands_in_its_body(beside: str, name: str) -> None:
    text = MJCF.replace("<freejoint/>", f'<freejoint name="{name}"/>{beside}' if name else f"<freejoint/>{beside}")
    (joint,) = (each for each in read(mjcf(text)).origins if each.kind == "joint" and each.id == 0)
    assert (joint.given, joint.original, joint.where) == (name or "torso_joint", name or None, "r.xml:3")


def test_messages_name_the_line_of_an_included_file(tmp_path: Path) -> None:
    (tmp_path / "leg.xml").write_text("<mujocoinclude>\n\n<body><joint odd='1'/></body></mujocoinclude>")
    (tmp_path / "r.xml").write_text('<mujoco><worldbody><body><include file="leg.xml"/></body></worldbody></mujoco>')
    with pytest.raises(DescriptionError, match=r"^leg\.xml:3: "):
        read(load(tmp_path / "r.xml"))


@pytest.mark.parametrize("limb", ["thigh", "torso_body", "torso_body_2", "Foot", "foot_2", "knee_body"])
def test_no_cut_renames_a_limb_that_stays(limb: str) -> None:
    source = token_spec(read(mjcf()))
    variant = ablate(mjcf(), remove=[limb])
    left = token_spec(read(variant.description))
    assert {each.name for each in left.limbs} < {each.name for each in source.limbs}
    known = {(each.name, each.limb, each.text) for each in source.sensors}
    assert {(each.name, each.limb, each.text) for each in left.sensors} < known
    written = [loss.name for loss in variant.lost if loss.kind == "name"]
    assert written == (["torso_body_2"] if limb == "torso_body" else [])
    lines = set(MJCF.splitlines())
    changed = [
        line for line in variant.description.source.decode().splitlines() if line not in lines and "_body_2" not in line
    ]
    assert changed == []


def test_a_splice_keeps_names_that_come_from_the_limb_above() -> None:
    inner = f'<body name="b"><joint name="j"/>{GEOM}<body>{GEOM}<joint/></body></body>'
    text = f'<mujoco><worldbody><body name="a">{GEOM}{inner}</body></worldbody></mujoco>'
    variant = ablate(mjcf(text), splice=["b"])
    assert names(read(variant.description)) == ["a", "b_body"]


def test_bodies_beside_copies_keep_their_names_too() -> None:
    text = MJCF.replace(
        '<body name="Foot">',
        '<replicate count="2"><body><joint/><geom size=".1"/></body></replicate>\n<body name="Foot">',
    )
    assert names(read(mjcf(text)))[3:7] == ["torso_body", "torso_body_2", "torso_body_3", "torso_body_4"]
    variant = ablate(mjcf(text), remove=["torso_body"])
    assert "torso_body_2" in names(read(variant.description))
    gone = ablate(mjcf(text), remove=["thigh"])
    assert names(read(gone.description)) == [
        "torso",
        "torso_body",
        "torso_body_2",
        "torso_body_3",
        "torso_body_4",
        "Foot",
        "foot",
    ]
    assert b"<replicate" in gone.description.source


def test_the_command_says_which_names_are_given(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "r.xml").write_text(MJCF)
    assert run(["tokens", str(tmp_path / "r.xml"), "--format", "json"]) == 0
    shown = capsys.readouterr()
    assert "12 names not as in the file: 'knee_body' is a body without a name at r.xml:5;" in shown.err
    assert "8 more, see given_names" in shown.err
    assert [each["given"] for each in json.loads(shown.out)["given_names"]][-2:] == ["foot_2", "thigh_ctrl_2"]
    assert run(["ablate", str(tmp_path / "r.xml"), "--remove", "foot_2", "--dry-run"]) == 0
