"""Names for elements that have none, or one that others have or read like: unique, stable, and traced to the file."""

from __future__ import annotations

import json
from pathlib import Path

import mujoco
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from morphkit.ablation import ablate
from morphkit.conversion import convert
from morphkit.description import Description
from morphkit.errors import DescriptionError
from morphkit.io import read
from morphkit.morphology import Morphology, Origin
from morphkit.naming import fold, match_limbs, numbered_labels
from morphkit.robots import load, load_all, shipped
from morphkit.simulation import build
from morphkit.tokens import TokenSpec, tokens
from morphkit.writing import write_family
from morphkit_cli.main import run

GEOM = '<geom size=".1"/>'
MJCF = f"""<mujoco>
<worldbody>
<body name="torso"><freejoint/>{GEOM}
  <body name="thigh"><joint name="hip"/>{GEOM}
    <body
      pos="0 0 1"><joint name="knee"/><joint name="ankle" axis="1 0 0"/>{GEOM}</body>
  </body>
  <body><joint/>{GEOM}</body>
  <body><joint/>{GEOM}<body>{GEOM}</body></body>
  <body name="Foot"><joint name="f1"/>{GEOM}</body>
  <body name="foot"><joint name="f2"/>{GEOM}</body>
</body>
</worldbody>
<tendon><fixed name="thigh"><joint joint="hip" coef="1"/></fixed></tendon>
<actuator>
  <motor joint="knee"/>
  <motor name="thigh" tendon="thigh"/>
  <position joint="hip" kp="1"/>
  <pid name="pid" joint="ankle" input="pos vel" kp="1"/>
</actuator>
<sensor>
  <framepos objtype="body" objname="torso"/>
  <framepos name="torso_position" objtype="body" objname="foot"/>
</sensor>
</mujoco>
"""
INERTIA = '<mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
LINK = f'<link name="{{}}"><inertial>{INERTIA}</inertial></link>'
JOINT = """<joint{} type="revolute"><parent link="{}"/><child link="{}"/>
<limit lower="-1" upper="1" effort="3" velocity="1"/></joint>"""
URDF = "\n".join(
    [
        '<robot name="r">',
        *map(LINK.format, ("base", "stray", "stray", "left", "right", "toe")),
        "<link/>",
        JOINT.format(' name="hip"', "base", "left"),
        JOINT.format(' name="hip"', "base", "right"),
        JOINT.format("", "right", "toe"),
        '<gazebo reference="hip"><a/></gazebo>',
        '<gazebo reference="left"><sensor name="s" type="imu"/><sensor type="imu"/></gazebo>',
        '<gazebo reference="right"><sensor name="s" type="imu"/></gazebo>',
        "</robot>\n",
    ]
)


def mjcf(text: str = MJCF) -> Description:
    return Description("r", "r.xml", "mjcf", text.encode())


def urdf(text: str = URDF) -> Description:
    return Description("r", "r.urdf", "urdf", text.encode(), root="base")


def names(morphology: Morphology) -> list[str]:
    return [limb.name for limb in morphology.limbs]


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
    spec = tokens(read(mjcf()), sensors="all")
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
    found = {each.given: (each.original, each.where) for each in tokens(read(load(tmp_path / "r.xml"))).given_names}
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
    source = tokens(read(mjcf()))
    variant = ablate(mjcf(), remove=[limb])
    left = tokens(read(variant.description))
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


def test_labels_of_the_source_stand_in_the_manifest(tmp_path: Path) -> None:
    (tmp_path / "r.xml").write_text(MJCF)
    robot = load(tmp_path / "r.xml")
    path = write_family(robot, [ablate(robot, remove=["Foot"])], tmp_path / "out")
    (variant,) = load_all(path)
    spec = tokens(read(variant))
    assert "foot_2_position_x" in [sensor.name for sensor in spec.sensors]
    assert Origin("foot_2", "body", "foot", "r-no-Foot.xml:10", 7) in spec.given_names
    assert ablate(variant, remove=["foot_2"]).removed == ("foot",)


def test_links_and_joints_of_a_urdf_that_share_a_name() -> None:
    morphology = read(urdf())
    assert names(morphology) == ["base", "left", "right", "toe"]
    assert [joint.name for joint in morphology.joints] == ["hip", "hip_2", "toe_joint"]
    assert [(each.name, each.joint) for each in morphology.actuators] == [
        (name, name) for name in ("hip", "hip_2", "toe_joint")
    ]
    found = tokens(morphology, sensors="all").given_names
    assert [(each.given, each.kind, each.original, each.where, each.id) for each in found] == [
        ("hip_2", "joint", "hip", "r.urdf:11", None),
        ("toe_joint", "joint", None, "r.urdf:13", None),
        ("sensor", "sensor", None, "r.urdf:16", None),
        ("s_2", "sensor", "s", "r.urdf:17", None),
    ]
    by_joint = tokens(morphology, limb_names="joint")
    assert [actuator.name for actuator in by_joint.actuators] == ["hip_ctrl", "hip_2_ctrl", "toe_joint_ctrl"]


def test_several_roots_say_which_have_no_name_of_their_own() -> None:
    with pytest.raises(DescriptionError, match=r"base, stray, stray_2, link\.") as caught:
        read(Description("r", "r.urdf", "urdf", URDF.encode()))
    assert "stray_2 is another link called 'stray', at r.urdf:4" in str(caught.value)
    assert "link is a link without a name, at r.urdf:8" in str(caught.value)


@pytest.mark.parametrize("limb", ["left", "right", "toe"])
def test_cuts_leave_shared_names_as_they_stand(limb: str) -> None:
    variant = ablate(urdf(), remove=[limb])
    lines = set(URDF.splitlines())
    assert [line for line in variant.description.source.decode().splitlines() if line not in lines] == []
    assert b'<gazebo reference="hip">' in variant.description.source
    both = ablate(urdf(), remove=["left", "right"])
    assert b"hip" not in both.description.source


def test_a_urdf_with_shared_names_can_be_simulated_and_converted() -> None:
    model = build(urdf()).model
    assert [model.joint(i).name for i in range(model.njnt)] == ["hip", "hip_2", "toe_joint"]
    assert [actuator.name for actuator in convert(urdf()).spec.actuators] == ["hip", "hip_2", "toe_joint"]
    other = (
        JOINT.format(' name="hip"', "stray_base", "stray_arm") + LINK.format("stray_base") + LINK.format("stray_arm")
    )
    beside = urdf(URDF.replace('<robot name="r">', f'<robot name="r">{other}'))
    assert [joint.name for joint in read(beside).joints] == ["hip_2", "hip_3", "toe_joint"]
    assert [actuator.name for actuator in convert(beside).spec.actuators] == ["hip_2", "hip_3", "toe_joint"]


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
    spec = tokens(morphology)
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
        assert tokens(read(robot), sensors="all").given_names == ()


def test_the_command_says_which_names_are_given(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "r.xml").write_text(MJCF)
    assert run(["tokens", str(tmp_path / "r.xml"), "--format", "json"]) == 0
    shown = capsys.readouterr()
    assert "12 names not as in the file: 'knee_body' is a body without a name at r.xml:5;" in shown.err
    assert "8 more, see given_names" in shown.err
    assert [each["given"] for each in json.loads(shown.out)["given_names"]][-2:] == ["foot_2", "thigh_ctrl_2"]
    assert run(["ablate", str(tmp_path / "r.xml"), "--remove", "foot_2", "--dry-run"]) == 0


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


@settings(max_examples=60, deadline=None)
@given(text=trees(), data=st.data())
def test_names_are_unique_and_survive_every_cut(text: str, data: st.DataObject) -> None:
    morphology = read(mjcf(text))
    spec = tokens(morphology)
    assert len({fold(text) for text in spec.texts}) == len(spec.texts)
    labels = {limb.name: morphology.labels.get(limb.name, limb.name) for limb in morphology.limbs}
    for label, name in [(label, name) for name, label in labels.items() if label != name]:
        assert match_limbs(morphology, label) == [name]
    wish = data.draw(st.sampled_from([name for name in labels if name != "torso"]))
    variant = ablate(mjcf(text), **{data.draw(st.sampled_from(["remove", "splice"])): [wish]})
    cut = read(variant.description)
    left = tokens(cut)
    gone = {*variant.removed, *variant.spliced}
    for kind in ("actuators", "sensors"):
        stay = [each.name for each in getattr(morphology, kind) if each.limb not in gone]
        assert [each.name for each in getattr(cut, kind)] == stay
    assert [limb.name for limb in left.limbs] == [limb.name for limb in spec.limbs if limb.name not in gone]
    kept = [sensor for sensor in spec.sensors if sensor.limb not in gone]
    assert [sensor.name for sensor in left.sensors] == [sensor.name for sensor in kept]
    assert [limb.joints for limb in left.limbs] == [limb.joints for limb in spec.limbs if limb.name not in gone]
