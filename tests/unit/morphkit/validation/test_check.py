"""Every kind of finding: a file that has it, and its line."""

from __future__ import annotations

import struct
from itertools import pairwise
from pathlib import Path

import pytest

from morphkit.validation.findings import Report, rules
from tests.support.faulty_robots import BALL, LIMIT, check_text, inertial, lines_of, mjcf, moments, urdf, visual


def follower(name: str, target: str, *, limit: str = LIMIT, mimic: str = "") -> str:
    return (
        f'<link name="{name}_link">{inertial()}{BALL}</link>'
        f'<joint name="{name}" type="revolute"><parent link="base"/><child link="{name}_link"/><axis xyz="0 1 0"/>'
        f'{limit}<mimic joint="{target}" {mimic}/></joint>'
    )


URDFS = {
    "xml-malformed": ("<robot>\n<link name='a'>\n</robot>", 3),
    "root-element": ("<sdf/>", 1),
    "xacro-unexpanded": (urdf(hip='<limit lower="${low}" upper="1" effort="1" velocity="1"/>'), 4),
    "xacro-leftover": (urdf(extra='<xacro:property xmlns:xacro="http://www.ros.org/wiki/xacro" name="a"/>'), 5),
    "robot-empty": ("<robot>\n</robot>", 1),
    "name-missing": (urdf(extra="<link/>"), 5),
    "name-duplicate": (urdf(extra='<link name="leg"/>'), 5),
    "name-characters": (urdf(extra=follower(" odd", "hip")), 5),
    "reference-unknown": (urdf(extra=follower("knee", "hpi")), 5),
    "reference-ignored": (urdf(extra='<gazebo reference="lge"/>'), 5),
    "material-undefined": (urdf(leg=visual("<sphere radius='0.1'/>").replace("</v", '<material name="x"/></v')), 3),
    "roots-several": (urdf(extra=f'<link name="lonely">{inertial()}</link>'), 5),
    "parents-several": (
        urdf(extra='<joint name="j" type="fixed"><parent link="base"/><child link="leg"/></joint>'),
        5,
    ),
    "cycle": (urdf(extra='<joint name="j" type="fixed"><parent link="leg"/><child link="base"/></joint>'), 5),
    "joint-type": (urdf(kind="revolut"), 4),
    "floating-inside": (urdf(kind="floating", hip=""), 4),
    "number-invalid": (urdf(hip=LIMIT.replace("-1", "x")), 4),
    "number-infinite": (urdf(hip=LIMIT.replace('"5"', '"inf"')), 4),
    "axis-zero": (urdf().replace("0 1 0", "0 0 0"), 4),
    "axis-length": (urdf().replace("0 1 0", "0 2 0"), 4),
    "axis-missing": (urdf().replace("<axis xyz", "<axis xzy"), 4),
    "element-repeated": (urdf(hip=LIMIT + LIMIT), 4),
    "attribute-unknown": (urdf(hip=LIMIT.replace("upper", "uper")), 4),
    "world-mass": (urdf().replace('"base"', '"world"'), 2),
    "world-inside": (urdf().replace('"leg"', '"world"'), 4),
    "limit-missing": (urdf(hip=""), 4),
    "limit-inverted": (urdf(hip=LIMIT.replace("-1", "3")), 4),
    "limit-empty": (urdf(hip='<limit effort="5" velocity="2"/>'), 4),
    "limit-partial": (urdf(hip=LIMIT.replace('lower="-1"', "")), 4),
    "limit-ignored": (urdf(kind="spherical"), 4),
    "limit-degrees": (urdf(hip=LIMIT.replace('"1"', '"90"')), 4),
    "effort-missing": (urdf(hip='<limit lower="-1" upper="1" velocity="2"/>'), 4),
    "effort-zero": (urdf(hip=LIMIT.replace('"5"', '"0"')), 4),
    "velocity-missing": (urdf(hip='<limit lower="-1" upper="1" effort="2"/>'), 4),
    "velocity-zero": (urdf(hip=LIMIT.replace('"2"', '"0"')), 4),
    "dynamics-negative": (urdf(hip=LIMIT + '<dynamics damping="-1"/>'), 4),
    "joint-unactuated": (
        urdf(extra='<transmission name="t"><joint name="knee"/></transmission>' + follower("knee", "hip")).replace(
            '<mimic joint="hip" />', ""
        ),
        4,
    ),
    "mimic-cycle": (urdf(extra=follower("a", "b") + follower("b", "a")), 5),
    "mimic-fixed": (urdf(kind="fixed", hip="", extra=follower("knee", "hip")), 5),
    "mimic-range": (urdf(extra=follower("knee", "hip", mimic='multiplier="2"')), 5),
    "transmission-idle": (
        urdf(kind="fixed", hip="", extra='<transmission name="t"><joint name="hip"/></transmission>'),
        5,
    ),
    "zero-outside": (urdf(hip=LIMIT.replace('"-1"', '"0.5"')), 4),
    "mass-negative": (urdf(leg=inertial("-1") + BALL), 3),
    "mass-missing": (urdf(leg=BALL), 3),
    "inertial-incomplete": (urdf(leg=inertial(inertia="") + BALL), 3),
    "inertia-massless": (urdf(leg=inertial("0") + BALL), 3),
    "inertia-negligible": (
        urdf(
            extra=f'<link name="logo">{inertial("1e-7", moments("2e-15", "2e-15", "2e-15"))}</link>'
            '<joint name="j" type="fixed"><parent link="leg"/><child link="logo"/></joint>'
        ),
        5,
    ),
    "inertia-negative": (urdf(leg=inertial(inertia=moments("1", "1", "-1"))), 3),
    "inertia-zero": (urdf(leg=inertial(inertia=moments("0", "0", "0"))), 3),
    "inertia-triangle": (urdf(leg=inertial(inertia=moments("0.01", "0.01", "0.03"))), 3),
    "inertia-rounded": (urdf(leg=inertial(inertia=moments("0.01", "0.01", "0.02001"))), 3),
    "inertia-size": (urdf(leg=inertial(inertia=moments("10", "10", "10")) + BALL), 3),
    "center-outside": (urdf(leg=inertial(origin='<origin xyz="30 0 0"/>') + BALL), 3),
    "mass-density": (urdf(leg=inertial("5000", moments("20", "20", "20")) + BALL), 3),
    "geometry-missing": (urdf(leg=inertial() + "<collision/>"), 3),
    "geometry-empty": (urdf(leg=inertial() + BALL + visual('<box size="0 0 0"/>')), 3),
    "geometry-unknown": (urdf(leg=inertial() + visual('<cone radius="1" length="1"/>', tag="collision")), 3),
    "geometry-impossible": (urdf(leg=inertial() + visual('<box size="1 1 -1"/>', tag="collision")), 3),
    "geometry-size": (urdf(leg=inertial() + visual('<box size="1 1 0"/>', tag="collision")), 3),
    "visual-impossible": (urdf(leg=inertial() + BALL + visual('<sphere radius="-1"/>')), 3),
    "file-outside": (urdf(leg=inertial() + BALL + visual('<mesh filename="/etc/hostname"/>')), 3),
    "collision-missing": (urdf(leg=inertial() + visual('<sphere radius="0.1"/>')), 3),
    "mesh-missing": (urdf(leg=inertial() + visual('<mesh filename="no.stl"/>', tag="collision")), 3),
    "mesh-missing-visual": (urdf(leg=inertial() + BALL + visual('<mesh filename="no.stl"/>')), 3),
    "mesh-scale-zero": (urdf(leg=inertial() + BALL + visual('<mesh filename="no.stl" scale="1 0 1"/>')), 3),
    "asset-unused": (urdf(extra='<material name="red"><color rgba="1 0 0 1"/></material>'), 5),
}
MJCFS = {
    "include-missing": (mjcf(head='<include file="no.xml"/>'), 2),
    "bodies-several": (mjcf().replace("</worldbody>", '\n<body name="box"><geom size="0.1"/></body></worldbody>'), 8),
    "range-inverted": (mjcf(hip='range="60 -60"'), 6),
    "range-units": (mjcf(hip='range="-1 1"', leg='<joint name="x" range="-2 2"/>'), 5),
    "control-unbounded": (mjcf(actuator='<motor name="m" joint="hip"/>'), 8),
    "keyframe-size": (mjcf(tail='<keyframe><key name="k" qvel="1 2 3 4 5 6 7 8"/></keyframe>'), 9),
    "keyframe-short": (mjcf(tail='<keyframe><key name="k" qpos="1 2 3"/></keyframe>'), 9),
    "self-collision": (mjcf(leg='<body name="foot" pos="0 0 0.48"><joint range="-9 9"/><geom size="0.1"/></body>'), 5),
    "zero-outside": (mjcf(hip='range="20 60"'), 6),
    "simulator-refuses": (mjcf(leg='<site name="s" shape="round"/>'), 5),
    "name-duplicate": (mjcf(leg='<site name="s"/><site name="s"/>'), 5),
    "reference-unknown": (mjcf(actuator='<motor name="m" joint="hpi"/>'), 8),
    "asset-unused": (mjcf(head='<asset><material name="red"/></asset>'), 2),
    "joint-unactuated": (mjcf(leg='<body name="toe"><joint/><geom size="0.01"/></body>'), 5),
    "mesh-missing": (mjcf(head='<asset><mesh name="m" file="no.stl"/></asset>'), 2),
    "inertia-triangle": (mjcf(leg='<inertial pos="0 0 0" mass="1" diaginertia="1 1 3"/>'), 5),
    "mass-negative": (mjcf(leg='<inertial pos="0 0 0" mass="-1" diaginertia="1 1 1"/>'), 5),
    "number-invalid": (mjcf(leg='<site pos="0 nan 0"/>'), 5),
    "axis-zero": (mjcf().replace("0 1 0", "0 0 0"), 6),
    "robot-empty": ("<mujoco><worldbody/></mujoco>", 1),
}
COMPILED = {
    "range-units", "control-unbounded", "keyframe-size", "keyframe-short", "self-collision", "simulator-refuses",
    "joint-unactuated", "zero-outside",
}  # fmt: skip


def stl(path: Path, *, size: float = 0.1, faces: int = 0) -> None:
    """A tetrahedron of edge `size`, followed by `faces` copies of its first face."""
    a, b, c, d = (0, 0, 0), (size, 0, 0), (0, size, 0), (0, 0, size)
    triangles = [(a, c, b), (a, b, d), (a, d, c), (b, c, d), *[(a, c, b)] * faces]
    body = b"".join(struct.pack("<12fH", 0, 0, 0, *p, *q, *r, 0) for p, q, r in triangles)
    path.write_bytes(bytes(80) + struct.pack("<I", len(triangles)) + body)


@pytest.mark.parametrize("rule", URDFS)
def test_urdf_with_one_mistake(tmp_path: Path, rule: str) -> None:
    text, line = URDFS[rule]
    report = check_text(tmp_path, "r.urdf", text, deep=False)
    assert lines_of(report, rule)[:1] == [line]


@pytest.mark.parametrize("rule", MJCFS)
def test_mjcf_with_one_mistake(tmp_path: Path, rule: str) -> None:
    text, line = MJCFS[rule]
    report = check_text(tmp_path, "r.xml", text, deep=rule in COMPILED)
    assert lines_of(report, rule)[:1] == [line]


@pytest.mark.parametrize(
    ("extra", "rules_found"),
    [
        ("<xacro:arm/>", ["xacro-unexpanded"]),
        ("<xacro:if value='1'><link name='x'/></xacro:if>", ["xacro-unexpanded"]),
        ("<xacro:macro name='arm'><xacro:if value='1'/></xacro:macro>", ["xacro-leftover"]),
        ("<xacro:include filename='x'/>", ["xacro-leftover"]),
        ("<material name='m'><color rgba='1 0 0 0 1'/></material>", ["number-invalid", "asset-unused"]),
        ("<material name='m'><color/></material>", ["number-invalid", "asset-unused"]),
    ],
)
def test_what_is_left_of_xacro_and_colors(tmp_path: Path, extra: str, rules_found: list[str]) -> None:
    text = urdf(extra=extra).replace("<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" ')
    report = check_text(tmp_path, "r.urdf", text, deep=False)
    assert [found.rule for found in report.findings] == rules_found


def test_a_joint_without_a_name_is_checked_like_others(tmp_path: Path) -> None:
    text = urdf(hip=LIMIT.replace('"-1"', '"2"')).replace('name="hip" ', "")
    report = check_text(tmp_path, "r.urdf", text, deep=False)
    assert [(found.rule, found.line) for found in report.findings] == [("name-missing", 4), ("limit-inverted", 4)]


MESHES = {
    "mesh-scale": "large.stl",
    "mesh-unreadable": "broken.stl",
    "mesh-format": "part.off",
    "mesh-faces": "fine.stl",
}


@pytest.fixture(scope="module")
def mesh_report(tmp_path_factory: pytest.TempPathFactory) -> Report:
    folder = tmp_path_factory.mktemp("meshes")
    stl(folder / "large.stl", size=100.0)
    stl(folder / "fine.stl", faces=200_000)
    stl(folder / "good.stl")
    (folder / "broken.stl").write_bytes(b"not a mesh")
    (folder / "part.off").write_text("OFF\n4 4 0\n0 0 0\n.1 0 0\n0 .1 0\n0 0 .1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n")
    names = [*MESHES.values(), "good.stl"]
    visuals = "\n".join(visual(f'<mesh filename="{name}"/>') for name in names)
    heavy = inertial("1", moments("0.001", "0.001", "0.001")) + visual('<mesh filename="good.stl"/>', tag="collision")
    joint = '<joint name="j" type="fixed"><parent link="base"/><child link="heavy"/></joint>'
    extra = f'{joint}<link name="heavy">{heavy}</link>'
    return check_text(folder, "r.urdf", urdf(leg=f"{inertial()}\n{BALL}\n{visuals}", extra=extra), deep=True)


@pytest.mark.parametrize("rule", MESHES)
def test_meshes(mesh_report: Report, rule: str) -> None:
    assert lines_of(mesh_report, rule) == [5 + list(MESHES).index(rule)]
    assert MESHES[rule] in next(found.message for found in mesh_report.findings if found.rule == rule)


def test_mass_far_from_the_volume_of_a_mesh(mesh_report: Report) -> None:
    # 1 kg in a tetrahedron of 1/6 * 0.1**3 m^3 is 6000 kg/m^3, which is fine; the good mesh raises nothing.
    assert {found.element for found in mesh_report.findings} <= {"leg", ""}


def test_scales_have_three_numbers(tmp_path: Path) -> None:
    stl(tmp_path / "m.stl")
    for scale in ("1", "1 1"):
        text = urdf(leg=inertial() + BALL + visual(f'<mesh filename="m.stl" scale="{scale}"/>'))
        assert lines_of(check_text(tmp_path, "r.urdf", text, deep=False), "number-invalid") == [3]


def test_density_of_a_mesh(tmp_path: Path) -> None:
    stl(tmp_path / "m.stl")
    leg = inertial("100", moments("0.5", "0.5", "0.5")) + visual('<mesh filename="m.stl"/>', tag="collision")
    report = check_text(tmp_path, "r.urdf", urdf(leg=leg), deep=True)
    assert lines_of(report, "mass-density") == [3]
    assert "6e+05 kg/m^3" in next(found.message for found in report.findings if found.rule == "mass-density")


def test_mjcf_mesh_in_millimetres_beside_explicit_mass(tmp_path: Path) -> None:
    (tmp_path / "assets").mkdir()
    stl(tmp_path / "assets" / "m.stl", size=100.0)
    head = '<compiler meshdir="assets"/><asset><mesh name="m" file="m.stl"/></asset>'
    leg = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><geom type="mesh" mesh="m"/>'
    text = mjcf(head=head, leg=leg).replace('<geom name="g" size="0.1"/>', "")
    report = check_text(tmp_path, "r.xml", text, deep=True)
    assert lines_of(report, "mesh-scale") == [2]
    assert lines_of(report, "mass-density") == [5]
    scaled = text.replace("<asset>", '<default><mesh scale="0.001 0.001 0.001"/></default><asset>')
    report = check_text(tmp_path, "r.xml", scaled, deep=True)
    assert not lines_of(report, "mesh-scale")
    assert not lines_of(report, "mass-density")


def test_a_skin_that_is_missing_is_found(tmp_path: Path) -> None:
    tail = '<deformable><skin name="s" file="gone.skn"/></deformable>'
    report = check_text(tmp_path, "r.xml", mjcf(tail=tail), deep=False)
    (finding,) = [each for each in report.findings if each.rule == "mesh-missing"]
    assert finding.message.startswith("skin 's': file 'gone.skn' not found")


def test_a_cycle_is_written_from_parent_to_child(tmp_path: Path) -> None:
    links = "".join(f'<link name="{name}"/>' for name in "abc")
    joints = "".join(
        f'<joint name="{a}{b}" type="fixed"><parent link="{a}"/><child link="{b}"/></joint>'
        for a, b in ("ab", "bc", "ca")
    )
    report = check_text(tmp_path, "r.urdf", f"<robot>{links}{joints}</robot>", deep=False)
    (finding,) = [each for each in report.findings if each.rule == "cycle"]
    loop = finding.message.removeprefix("links form a cycle: ").split(" -> ")
    assert loop[0] == loop[-1]
    assert {f"{a}{b}" for a, b in pairwise(loop)} == {"ab", "bc", "ca"}


def test_every_rule_has_a_case() -> None:
    elsewhere = {"include-repeated", "simulator-crash", "mesh-up-axis", "links-overlap", "start-tips"}
    assert {*URDFS, *MJCFS, *MESHES, *elsewhere} == set(rules())
