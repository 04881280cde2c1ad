"""Robots of a few links and boxes, as descriptions in memory."""

from __future__ import annotations

from pathlib import Path

from morphkit.description import Description

INERTIA = '<inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/>'
LINK = '<link name="{0}"><inertial><mass value="1"/>' + INERTIA + "</inertial>{1}</link>"
JOINT = (
    '<joint name="{0}" type="{1}"><origin xyz="0 0 .5"/><parent link="{2}"/><child link="{3}"/><axis xyz="0 1 0"/>{4}'
    "</joint>"
)
LIMIT = '<limit lower="{}" upper="{}" effort="1" velocity="1"/>'
BOX = '<{0}><geometry><box size=".1 .1 .4"/></geometry></{0}>'
MESH = '<{0}><geometry><mesh filename="{1}"/></geometry></{0}>'


def urdf(*elements: str, folder: Path | None = None) -> Description:
    return Description("r", "r.urdf", "urdf", f'<robot name="r">{"".join(elements)}</robot>'.encode(), folder=folder)


def mjcf(body: str, rest: str = "") -> Description:
    text = f"<mujoco><worldbody><body name='root'><geom size='.1'/>{body}</body></worldbody>{rest}</mujoco>"
    return Description("r", "r.xml", "mjcf", text.encode())


def arm(first: str = "", second: str = "", limit: str = LIMIT.format(-0.5, 1.0)) -> Description:
    return urdf(
        LINK.format("a", BOX.format("visual")),
        LINK.format("b", first),
        LINK.format("c", second),
        JOINT.format("ab", "revolute", "a", "b", limit),
        JOINT.format("bc", "revolute", "b", "c", limit),
    )
