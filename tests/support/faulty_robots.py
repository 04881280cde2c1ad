"""Robots of two parts whose files can hold a mistake at a known line, and checks of them."""

from __future__ import annotations

from pathlib import Path

from morphkit.validation.check import check
from morphkit.validation.findings import Report

GOOD_INERTIA = '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>'
LIMIT = '<limit lower="-1" upper="1" effort="5" velocity="2"/>'
BALL = '<collision><geometry><sphere radius="0.1"/></geometry></collision>'


def inertial(mass: str = "1", inertia: str = GOOD_INERTIA, origin: str = "") -> str:
    return f'<inertial>{origin}<mass value="{mass}"/>{inertia}</inertial>'


def moments(x: str, y: str, z: str) -> str:
    return f'<inertia ixx="{x}" iyy="{y}" izz="{z}" ixy="0" ixz="0" iyz="0"/>'


def urdf(*, leg: str = inertial() + BALL, hip: str = LIMIT, kind: str = "revolute", extra: str = "") -> str:
    """A robot of two links; the leg is in line 3, its joint in line 4, what is extra starts in line 5."""
    return (
        '<robot name="r">\n'
        f'<link name="base">{inertial()}{BALL}</link>\n'
        f'<link name="leg">{leg}</link>\n'
        f'<joint name="hip" type="{kind}"><parent link="base"/><child link="leg"/><axis xyz="0 1 0"/>{hip}</joint>\n'
        f"{extra}\n</robot>\n"
    )


def visual(geometry: str, *, tag: str = "visual") -> str:
    return f"<{tag}><geometry>{geometry}</geometry></{tag}>"


def mjcf(
    *, head: str = "", hip: str = 'range="-60 60"', leg: str = "", actuator: str | None = None, tail: str = ""
) -> str:
    """A robot of two bodies; the leg is in line 5, its joint in line 6, the actuator in line 8, the tail in line 9."""
    motor = '<motor name="m" joint="hip" ctrlrange="-1 1"/>' if actuator is None else actuator
    return (
        "<mujoco>\n"
        f"{head}\n"
        "<worldbody>\n"
        '<body name="base" pos="0 0 1"><freejoint name="root"/><geom name="b" size="0.1"/>\n'
        f'<body name="leg" pos="0 0 -0.5">{leg}\n'
        f'<joint name="hip" axis="0 1 0" {hip}/><geom name="g" size="0.1"/>\n'
        "</body></body></worldbody>\n"
        f"<actuator>{motor}</actuator>\n"
        f"{tail}\n</mujoco>\n"
    )


def lines_of(report: Report, rule: str) -> list[int | None]:
    return [found.line for found in report.findings if found.rule == rule]


def check_text(folder: Path, name: str, text: str, *, deep: bool) -> Report:
    (folder / name).write_text(text)
    return check(folder / name, shown=name, deep=deep)
