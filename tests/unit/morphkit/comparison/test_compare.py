"""What changed between two robots."""

from __future__ import annotations

import contextlib
import json
import os
import sys
from dataclasses import replace

import pytest
from rich.console import Console

from morphkit.ablation.ablate import ablate
from morphkit.comparison.compare import Change, Comparison, compare
from morphkit.comparison.matching import moved, pair_rest
from morphkit.description import Description
from morphkit.errors import DescriptionError
from morphkit.registry import load
from morphkit_cli.diff_report import render
from morphkit_cli.main import run
from morphkit_cli.terminal import show

URDF = b"""<robot name="r">
  <link name="trunk"><inertial><mass value="2"/><inertia ixx=".02" iyy=".03" izz=".04" ixy="0" ixz="0" iyz="0"/>
    </inertial></link>
  <link name="leg"><inertial><origin xyz="0 0 -.1"/><mass value="1"/>
    <inertia ixx=".01" iyy=".01" izz=".001" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><mesh filename="nowhere.stl"/></geometry></visual></link>
  <link name="foot"><inertial><mass value=".5"/><inertia ixx=".001" iyy=".001" izz=".001" ixy="0" ixz="0" iyz="0"/>
    </inertial></link>
  <joint name="hip" type="revolute"><origin xyz="0 0 -.2"/><parent link="trunk"/><child link="leg"/>
    <axis xyz="0 1 0"/><limit lower="-.5" upper="1" effort="10" velocity="1"/><dynamics damping=".2"/></joint>
  <joint name="sole" type="fixed"><origin xyz="0 0 -.3"/><parent link="leg"/><child link="foot"/></joint>
</robot>"""
MJCF = b"""<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body name="trunk">
      <inertial pos="0 0 0" mass="2" diaginertia=".04 .03 .02"/>
      <body name="leg" pos="0 0 -.2">
        <inertial pos="0 0 -.1" mass="1" diaginertia=".01 .01 .001"/>
        <joint name="hip" axis="0 1 0" range="-.5 1" damping=".2"/>
        <body name="foot" pos="0 0 -.3"><inertial pos="0 0 0" mass=".5" diaginertia=".001 .001 .001"/></body>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="hip" joint="hip" ctrllimited="true" ctrlrange="-10 10"/></actuator>
</mujoco>"""


def urdf(*changes: tuple[bytes, bytes]) -> Description:
    return description(URDF, "urdf", changes)


def mjcf(*changes: tuple[bytes, bytes]) -> Description:
    return description(MJCF, "mjcf", changes)


def description(source: bytes, kind: str, changes: tuple[tuple[bytes, bytes], ...]) -> Description:
    for old, new in changes:
        assert old in source
        source = source.replace(old, new)
    return Description("r", f"r.{kind}", kind, source)  # type: ignore[arg-type]


def found(comparison: Comparison) -> set[tuple[str, str, str, str | None]]:
    return {(c.subject, c.kind, c.name, c.fact) for c in comparison.changes}


def printed(comparison: Comparison) -> str:
    console = Console(width=160, color_system=None)
    with console.capture() as capture:
        console.print(render(comparison))
    return capture.get()


@pytest.mark.parametrize("name", ["cheetah", "arm", "quadruped"])
def test_a_robot_equals_itself(name: str) -> None:
    comparison = compare(load(name), load(name))
    assert comparison.equal
    assert "no difference" in printed(comparison)


def test_a_urdf_equals_the_mjcf_of_the_same_robot() -> None:
    assert compare(urdf(), mjcf()).changes == ()
    assert compare(mjcf(), urdf()).changes == ()


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (b'range="-.5 1"', b'range="-.5 .9"', ("joint", "changed", "hip", "range")),
        (b'axis="0 1 0"', b'axis="1 0 0"', ("joint", "changed", "hip", "axis")),
        (b'damping=".2"', b'damping=".3"', ("joint", "changed", "hip", "damping")),
        (b'mass=".5"', b'mass=".6"', ("limb", "changed", "leg", "mass")),
        (b'pos="0 0 -.3"', b'pos="0 0 -.4"', ("limb", "changed", "leg", "inertia")),
        (b'pos="0 0 -.2"', b'pos="0 0 -.1"', ("limb", "changed", "leg", "position")),
        (b'ctrlrange="-10 10"', b'ctrlrange="-9 9"', ("actuator", "changed", "hip", "bounds")),
        (b'joint="hip"', b'joint="hip" gear="3"', ("actuator", "changed", "hip", "gear")),
        (b'<body name="trunk"', b'<body name="trunk" pos="0 0 1"', ("robot", "changed", "", "start height")),
    ],
)
def test_what_changes_is_found(old: bytes, new: bytes, expected: tuple[str, str, str, str]) -> None:
    comparison = compare(mjcf(), mjcf((old, new)))
    assert expected in found(comparison)
    assert not any(change.kind != "changed" for change in comparison.changes)
    assert expected[3] in printed(comparison)


def test_numbers_carry_their_units() -> None:
    comparison = compare(mjcf(), mjcf((b'range="-.5 1"', b'range="-.5 .5"')))
    assert comparison.changes == (
        Change("joint", "changed", "hip", "hip", "leg", "range", (-0.5, 1.0), (-0.5, 0.5), "rad"),
    )
    assert "joint hip range -28.648 to 57.296° -> -28.648 to 28.648°" in printed(comparison)


def test_tolerance() -> None:
    almost = mjcf((b'mass="2"', b'mass="2.0001"'))
    assert not compare(mjcf(), almost).equal
    assert compare(mjcf(), almost, tolerance=1e-3).equal


def test_a_variant_lacks_what_was_cut() -> None:
    source = load("cheetah")
    comparison = compare(source, ablate(source, remove=["bshin"]).description)
    gone = {(c.subject, c.name) for c in comparison.changes if "token" not in c.subject}
    assert gone == {(subject, name) for subject in ("limb", "joint", "actuator") for name in ("bshin", "bfoot")}
    assert {change.kind for change in comparison.changes} == {"removed"}
    tokens = [change for change in comparison.changes if change.subject == "sensor token"]
    assert {change.limb for change in tokens} == {"bshin", "bfoot"}
    assert len(tokens) == 2 * 19
    text = printed(comparison)
    assert "- bshin  joint bshin; actuator bshin; 19 sensor tokens, 1 actuator token; 2.402 kg" in text
    assert "3 limbs without change: fthigh, fshin, ffoot" in text
    back = compare(ablate(source, remove=["bshin"]).description, source)
    assert {change.kind for change in back.changes} == {"added"}
    assert "+ bshin" in printed(back)


def test_a_spliced_limb_leaves_its_child_elsewhere() -> None:
    source = load("cheetah")
    changes = compare(source, ablate(source, splice=["bshin"]).description).changes
    moved_limb = next(change for change in changes if change.fact == "parent")
    assert (moved_limb.name, moved_limb.before, moved_limb.after) == ("bfoot", "bshin", "bthigh")


def test_renamed_limbs_are_recognized() -> None:
    """By their joint's name, by their name in plain words, or by place and shape."""
    by_joint = compare(mjcf(), mjcf((b'name="leg"', b'name="zzz"')))
    assert by_joint.limbs == {"trunk": "trunk", "leg": "zzz"}
    everything = ((b'name="leg"', b'name="zzz"'), (b'"hip"', b'"yyy"'))
    by_shape = compare(mjcf(), mjcf(*everything))
    assert by_shape.limbs == {"trunk": "trunk", "leg": "zzz"}
    kinds = {(change.subject, change.kind) for change in by_shape.changes}
    assert kinds == {(s, "renamed") for s in ("limb", "joint", "actuator", "sensor token", "actuator token")}
    assert "leg -> zzz" in printed(by_shape)
    assert "19 sensor tokens renamed: leg_position_x -> zzz_position_x and 18 more" in printed(by_shape)
    by_words = compare(load("planar_cheetah"), load("cheetah"))
    assert by_words.limbs["back_thigh"] == "bthigh"
    assert len(by_words.limbs) == 7


def test_unrelated_robots() -> None:
    comparison = compare(load("quadruped"), load("arm"))
    assert comparison.limbs == {}
    assert "two unrelated robots" in printed(comparison)
    assert {c.name for c in comparison.changes if (c.subject, c.kind) == ("limb", "added")} == set(
        comparison.second.limbs
    )


def test_a_new_order_is_a_change() -> None:
    legs = b"".join(
        b'<body name="%s"><joint name="%s"/><geom size=".1"/></body>' % (name, name) for name in (b"a", b"b", b"c")
    )
    text = b'<mujoco><worldbody><body name="t"><geom size=".1"/>%s</body></worldbody></mujoco>'
    robot = Description("r", "r.xml", "mjcf", text % legs)
    swapped = legs.replace(b'"a"', b'"X"').replace(b'"c"', b'"a"').replace(b'"X"', b'"c"')
    comparison = compare(robot, replace(robot, source=text % swapped))
    assert {change.kind for change in comparison.changes} == {"reordered"}
    assert "elsewhere in the order: 1 limb, 1 joint, 19 sensor tokens" in printed(comparison)


def test_moved_is_the_fewest_that_explain_an_order() -> None:
    pairs = {name: name.upper() for name in "abcde"}
    assert moved(pairs, list("ABCDE")) == ()
    assert moved(pairs, list("EABCD")) == ("e",)
    assert moved(pairs, list("AXCBDE")[:1] + list("CBDE")) in (("b",), ("c",))
    assert len(moved(pairs, list("EDCBA"))) == 4


def test_rest_is_paired_by_name_then_by_what_it_is() -> None:
    first = {"a": 1, "b": 2, "c": 2, "d": None}
    second = {"x": 2, "a": 9, "y": 2, "z": None}
    assert pair_rest(first, second) == {"a": "a", "b": "x", "c": "y"}


def test_a_missing_mesh_makes_a_mass_unknown_not_wrong() -> None:
    with_mesh = MJCF.replace(
        b'<inertial pos="0 0 -.1" mass="1" diaginertia=".01 .01 .001"/>', b'<geom type="mesh" mesh="m"/>'
    )
    with_mesh = with_mesh.replace(b"<worldbody>", b'<asset><mesh name="m" file="m.stl"/></asset><worldbody>')
    robot = Description("r", "r.xml", "mjcf", with_mesh)
    comparison = compare(robot, robot)
    assert comparison.equal
    assert comparison.first.mass is None
    assert "mass" not in comparison.first.limbs["leg"]
    assert comparison.first.limbs["trunk"]["mass"] == 2.0
    assert "unknown" in printed(comparison)
    assert len(comparison.first.notes) == 1


def test_command_prints_json_and_tells_by_its_exit_code(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["diff", "cheetah", "cheetah"]) == 0
    capsys.readouterr()
    assert run(["diff", "cheetah", "cheetah_3_balanced", "--json"]) == 1
    answer = json.loads(capsys.readouterr().out)
    assert answer["schema_version"] == 1
    assert answer["equal"] is False
    assert (answer["first"]["limbs"], answer["second"]["limbs"]) == (7, 3)
    assert {"subject": "limb", "kind": "removed", "name": "bshin"}.items() <= answer["changes"][0].items()
    assert run(["diff", "cheetah", "nothing.urdf"]) == 2


def test_output_into_a_pipe_has_no_color_and_whole_lines(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["diff", "planar_cheetah", "cheetah"]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert not any("\x1b" in line for line in lines)
    assert any(len(line) > 100 for line in lines)


def written_to(terminal: int) -> str:
    """All that was written to a terminal, which the system passes on a part at a time."""
    parts = []
    with contextlib.suppress(OSError):  # What Linux says at the end.
        while part := os.read(terminal, 4096):
            parts.append(part)
    os.close(terminal)
    return b"".join(parts).decode()


@pytest.mark.parametrize("no_color", [False, True])
def test_a_terminal_gets_colors_unless_it_wants_none(no_color: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pty")
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    if no_color:
        monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "100")
    ours, theirs = os.openpty()
    with os.fdopen(theirs, "w", encoding="utf-8") as terminal:
        monkeypatch.setattr(sys, "stdout", terminal)
        show(render(compare(load("cheetah"), load("cheetah_3_balanced"))))
        monkeypatch.undo()
    text = written_to(ours)
    assert "- bshin" in text
    assert ("\x1b[1;31m- bshin" in text) is not no_color


FINGERS = b"""<robot name="hand">
  <link name="palm"/><link name="one"/><link name="two"/>
  <joint name="j1" type="revolute"><parent link="palm"/><child link="one"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="3" velocity="2"/></joint>
  <joint name="j2" type="revolute"><parent link="palm"/><child link="two"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="3" velocity="2"/><mimic joint="j1" multiplier="-1"/></joint>
  <gazebo reference="palm"><sensor type="imu" name="imu"/></gazebo>
</robot>"""


def fingers(*changes: tuple[bytes, bytes]) -> Description:
    return description(FINGERS, "urdf", changes)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ((b' multiplier="-1"', b""), ("j2", "coupling", (0.0, -1.0), (0.0, 1.0), "")),
        ((b'<mimic joint="j1" multiplier="-1"/>', b""), ("j2", "follows", "j1", None, "")),
        ((b'velocity="2"/></joint>', b'velocity="3"/></joint>'), ("j1", "velocity limit", 2.0, 3.0, "rad/s")),
    ],
)
def test_mimics_and_velocity_limits_of_joints(change, told) -> None:
    changes = [each for each in compare(fingers(), fingers(change)).changes if each.subject == "joint"]
    assert told in [(each.name, each.fact, each.before, each.after, each.unit) for each in changes]


def test_velocity_limits_of_joints_without_a_name() -> None:
    nameless, faster = (b' name="j2"', b""), (b'velocity="2"/><mimic', b'velocity="3"/><mimic')
    changes = compare(fingers(nameless), fingers(nameless, faster)).changes
    told = [(each.name, each.fact, each.before, each.after) for each in changes]
    assert told == [("two_joint", "velocity limit", 2.0, 3.0)]


def test_a_variant_whose_joint_has_lost_its_leader() -> None:
    changes = compare(fingers(), ablate(fingers(), remove=["one"]).description).changes
    assert ("j2", "follows", "j1", None) in [(each.name, each.fact, each.before, each.after) for each in changes]


def test_declared_sensors_are_tokens_that_can_go() -> None:
    sensor = b'<gazebo reference="palm"><sensor type="imu" name="imu"/></gazebo>'
    changes = compare(fingers(), fingers((sensor, b""))).changes
    assert {(each.subject, each.kind) for each in changes} == {("sensor token", "removed")}
    assert len(changes) == 10


@pytest.mark.parametrize(
    ("before", "after", "fact"),
    [
        ('tendon="a"', 'tendon="b"', "drives"),
        ('tendon="a" dyntype="filter"', 'tendon="a" dyntype="integrator"', "dynamics"),
        ('tendon="a" dyntype="filter" dynprm=".1"', 'tendon="a" dyntype="filter" dynprm=".2"', "time constants"),
    ],
)
def test_what_an_actuator_drives_and_how_it_answers(before: str, after: str, fact: str) -> None:
    tendons = "".join(f'<fixed name="{name}"><joint joint="hip" coef="1"/></fixed>' for name in "ab")
    motor = b'<motor name="hip" joint="hip" ctrllimited="true" ctrlrange="-10 10"/>'
    first, second = (
        mjcf(
            (b"<actuator>", f"<tendon>{tendons}</tendon><actuator>".encode()),
            (motor, f'<general name="pull" {how}/>'.encode()),
        )
        for how in (before, after)
    )
    told = {each.fact for each in compare(first, second).changes if each.subject == "actuator"}
    assert fact in told
    assert compare(first, first).equal


@pytest.mark.parametrize(
    ("robot", "words"),
    [
        (urdf((b'<mass value="2"/>', b'<mass value="inf"/>')), "in <mass> of link 'trunk', which is not finite"),
        (mjcf((b'pos="0 0 -.2"', b'pos="0 0 inf"')), "the position of 'leg' is no finite number"),
    ],
)
def test_infinite_robots_are_refused(robot: Description, words: str) -> None:
    with pytest.raises(DescriptionError, match=words):
        compare(robot, robot)
