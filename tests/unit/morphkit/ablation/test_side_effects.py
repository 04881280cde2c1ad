"""What a cut changes on limbs that stay: it is listed, and what is listed is what happens."""

from __future__ import annotations

import mujoco
import pytest

from morphkit.ablation.ablate import Variant, ablate
from morphkit.description import Description
from morphkit.readers import read

LIMBS = """<body name="torso"><freejoint/><geom size=".2"/>
  <body name="leg" pos=".5 0 0"><joint name="hip" axis="0 1 0"{joint}/><geom size=".15"/>
    <body name="foot" pos=".3 0 0"><joint name="ankle" axis="0 1 0"/><geom size=".1"/></body></body></body>"""


def mjcf(before: str = "", *, joint: str = "", after: str = "") -> Description:
    source = f"<mujoco>{before}<worldbody>{LIMBS.format(joint=joint)}</worldbody>{after}</mujoco>"
    return Description("r", "r.xml", "mjcf", source.encode())


def changes(variant: Variant) -> list[tuple[str, str]]:
    """Kind and name of what changed on limbs that are left."""
    return [(loss.kind, loss.name) for loss in variant.lost if not loss.limb]


def model(description: Description) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(description.source.decode())


@pytest.mark.parametrize(
    "compiler",
    ['<compiler settotalmass="14"/>', '<compiler settotalmass="3"/><compiler angle="radian" settotalmass="14"/>'],
)
def test_a_total_mass_is_kept_and_said(compiler: str) -> None:
    robot = mjcf(compiler)
    variant = ablate(robot, remove=["foot"])
    assert changes(variant) == [("compiler", "settotalmass")]
    assert "weighs 14 kg" in variant.lost[-1].reason
    before, after = model(robot), model(variant.description)
    assert before.body_mass.sum() == pytest.approx(14) == after.body_mass.sum()
    assert after.body("torso").mass[0] > before.body("torso").mass[0] + 0.3


@pytest.mark.parametrize("compiler", ["", '<compiler settotalmass="-1"/>', '<compiler settotalmass="0"/>'])
def test_nothing_is_said_where_no_total_is_set(compiler: str) -> None:
    assert changes(ablate(mjcf(compiler), remove=["foot"])) == []


@pytest.mark.parametrize(
    ("robot", "listed", "array"),
    [
        (mjcf(joint=' springdamper=".5 1"'), ("joint", "hip"), "jnt_stiffness"),
        (
            mjcf('<default><joint springdamper=".5 1"/></default>', joint=' class="main"'),
            ("joint", "hip"),
            "jnt_stiffness",
        ),
        (
            mjcf(after='<actuator><position name="m" joint="hip" kp="9" dampratio="1"/></actuator>'),
            ("actuator", "m"),
            "actuator_biasprm",
        ),
        (
            mjcf(after='<actuator><muscle joint="hip" lengthrange="0 1"/></actuator>'),
            ("actuator", "hip"),
            "actuator_acc0",
        ),
    ],
)  # fmt: skip
def test_what_follows_from_inertia_is_said(robot: Description, listed: tuple[str, str], array: str) -> None:
    variant = ablate(robot, remove=["foot"])
    assert listed in changes(variant)
    before, after = (getattr(model(each), array)[:2] for each in (robot, variant.description))
    assert abs(before - after).max() > 1e-3 * abs(before).max()


def test_what_a_file_states_itself_is_not_said_to_change() -> None:
    drives = (
        '<position joint="hip" kp="9" kv="1"/><muscle joint="hip" force="20" lengthrange="0 1"/><motor joint="hip"/>'
    )
    assert changes(ablate(mjcf(after=f"<actuator>{drives}</actuator>"), remove=["foot"])) == []


def urdf(*joints: str, more: str = "") -> Description:
    names = [f"link{i}" for i in range(len(joints) + 1)]
    links = "".join(f'<link name="{name}"/>' for name in names)
    return Description("r", "r.urdf", "urdf", f'<robot name="r">{links}{"".join(joints)}{more}</robot>'.encode())


def joint(number: int, parent: int, more: str = "", effort: float = 5) -> str:
    return (
        f'<joint name="j{number}" type="revolute"><parent link="link{parent}"/><child link="link{number}"/>'
        f'<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="{effort}" velocity="1"/>{more}</joint>'
    )


TRANSMISSION = '<transmission name="t{0}"><joint name="j{0}"/><actuator name="m{0}"/></transmission>'


@pytest.mark.parametrize(
    ("robot", "gained"),
    [
        (urdf(joint(1, 0), joint(2, 0, '<mimic joint="j1"/>')), ["j2"]),
        (urdf(joint(1, 0), joint(2, 0, '<mimic joint="j1"/>', effort=0)), []),
        (urdf(joint(1, 0), joint(2, 0, '<mimic joint="j1"/>'), joint(3, 2)), ["j2"]),
        (
            urdf(
                *(joint(1, 0), joint(2, 0, '<mimic joint="j1"/>'), joint(3, 0)),
                more=TRANSMISSION.format(1) + TRANSMISSION.format(2) + TRANSMISSION.format(3),
            ),
            ["j2"],
        ),
        (urdf(joint(1, 0), joint(2, 0), joint(3, 0), more=TRANSMISSION.format(1)), ["j2", "j3"]),
        (urdf(joint(1, 0), joint(2, 0), more=TRANSMISSION.format(2)), []),
        (urdf(joint(1, 0), joint(2, 0)), []),
    ],
)
def test_motors_that_joints_gain_are_said(robot: Description, gained: list[str]) -> None:
    variant = ablate(robot, remove=["link1"])
    assert [name for kind, name in changes(variant) if kind == "actuator"] == gained
    before, after = ({actuator.joint for actuator in read(each).actuators} for each in (robot, variant.description))
    assert sorted(name for name in after - before if name) == gained
