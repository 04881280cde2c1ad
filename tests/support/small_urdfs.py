"""Small URDFs put together of parts, and what every reader of them makes."""

from __future__ import annotations

import mujoco

from morphkit.conversion.convert import Conversion, convert
from morphkit.description import Description
from morphkit.readers import read
from morphkit.simulation.build import build_simulation, compile_plain
from morphkit.simulation.inspection_model import load_mechanics
from morphkit.tokens.spec import token_spec

TENSOR = '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>'
INERTIAL = f'<inertial><mass value="1"/>{TENSOR}</inertial>'
LIMIT = '<limit lower="-1" upper="1" effort="5" velocity="3"/>'
AXIS = '<axis xyz="0 1 0"/>'


def link(name: str, inside: str = INERTIAL) -> str:
    return f'<link name="{name}">{inside}</link>'


def joint(name: str, parent: str, child: str, inside: str = AXIS + LIMIT, *, kind: str = "revolute") -> str:
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{inside}</joint>'


def robot(*parts: str) -> str:
    return '<robot name="r">\n' + "\n".join(parts) + "\n</robot>\n"


def described(text: str) -> Description:
    return Description("r", "r.urdf", "urdf", text.encode())


def two(arm: str = INERTIAL, moving: str = AXIS + LIMIT, *, kind: str = "revolute", extra: str = "") -> str:
    """A base and an arm (line 3) on a joint (line 4); what is extra starts in line 5."""
    return robot(link("base"), link("arm", arm), joint("j", "base", "arm", moving, kind=kind), extra)


def by_all(text: str) -> Conversion:
    """The conversion of a robot that everything takes."""
    description = described(text)
    token_spec(read(description))
    compile_plain(description)
    load_mechanics(description)
    build_simulation(description)
    return convert(description)


def masses(model: mujoco.MjModel) -> dict[str, float]:
    return {model.body(body).name: float(model.body_mass[body]) for body in range(1, model.nbody)}
