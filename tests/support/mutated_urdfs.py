"""Random changes to a URDF, of the kinds that people and exporters make: parts again, gone, elsewhere, misspelled."""

from __future__ import annotations

import copy
from typing import Any

from hypothesis import strategies as st
from lxml import etree

SEED = b"""<robot name="r">
  <material name="steel"><color rgba=".5 .5 .5 1"/></material>
  <link name="base">
    <inertial><origin xyz="0 0 0"/><mass value="2"/>
      <inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><box size=".3 .2 .1"/></geometry><material name="steel"/></visual>
    <collision name="hull"><geometry><box size=".3 .2 .1"/></geometry></collision>
  </link>
  <link name="thigh">
    <inertial><mass value="1"/><inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><origin xyz="0 0 -.1" rpy="0 1 0"/><geometry><cylinder radius=".02" length=".2"/></geometry>
      <material name="dark"><color rgba=".1 .1 .1 1"/></material></visual>
    <collision><origin xyz="0 0 -.1"/><geometry><cylinder radius=".02" length=".2"/></geometry></collision>
  </link>
  <link name="shin">
    <inertial><mass value=".5"/><inertia ixx=".01" iyy=".01" izz=".005" ixy=".001" ixz="0" iyz="0"/></inertial>
    <collision><geometry><sphere radius=".05"/></geometry></collision>
  </link>
  <link name="foot">
    <inertial><mass value=".1"/><inertia ixx=".001" iyy=".001" izz=".001" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <link name="tail">
    <inertial><mass value=".1"/><inertia ixx=".001" iyy=".001" izz=".001" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <joint name="hip" type="revolute"><parent link="base"/><child link="thigh"/><origin xyz="0 .1 0" rpy="0 0 .1"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="1.5" effort="9" velocity="3"/>
    <dynamics damping=".1" friction="0"/></joint>
  <joint name="knee" type="revolute"><parent link="thigh"/><child link="shin"/><origin xyz="0 0 -.2"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="0" effort="9" velocity="3"/></joint>
  <joint name="weld" type="fixed"><parent link="shin"/><child link="foot"/><origin xyz="0 0 -.2"/>
    <axis xyz="0 0 1"/></joint>
  <joint name="wag" type="prismatic"><parent link="base"/><child link="tail"/><axis xyz="1 0 0"/>
    <limit lower="0" upper=".1" effort="9" velocity="3"/><mimic joint="knee" multiplier="-.1" offset="0"/></joint>
  <transmission name="t1"><joint name="hip"/><actuator name="m1"/></transmission>
  <transmission name="t2"><joint name="knee"/><actuator name="m2"/></transmission>
  <gazebo reference="foot"><mu1>1</mu1></gazebo>
</robot>
"""
VALUES = (
    "", "0", "0.5", "-1", "1e-14", "2e-15", "1e9", "1e400", "nan", "inf", "-inf", "1_0", "x", "1,0", "0 0 0", "1 2 3",
    "0 0", "1 1 0", "world", "base", "knee", "hip", "weld", "thigh", "fixed", "floating", "planar", "continuous",
    "spherical", "revolute", "steel", " ", "\u0661",
)  # fmt: skip
KINDS = (
    "again",
    "again otherwise",
    "gone",
    "attribute gone",
    "attribute",
    "misspelled",
    "moved",
    "equal limits",
    "tag",
    "shape gone",
)


@st.composite
def mutated_urdfs(draw: st.DrawFn) -> bytes:
    """A robot of five links after one to four changes."""
    root = etree.fromstring(SEED)
    for _ in range(draw(st.integers(1, 4))):
        _change(draw, root)
    return bytes(etree.tostring(root))


def _change(draw: st.DrawFn, root: Any) -> None:
    elements = list(root.iterdescendants("*"))
    if not elements:
        return
    element = draw(st.sampled_from(elements))
    kind = draw(st.sampled_from(KINDS))
    key = draw(st.sampled_from(sorted(element.attrib))) if element.attrib else None
    if kind.startswith("again"):
        twin = copy.deepcopy(element)
        if kind == "again otherwise" and key is not None:
            twin.set(key, draw(st.sampled_from(VALUES)))
        element.addnext(twin)
    elif kind == "gone":
        element.getparent().remove(element)
    elif kind == "moved":
        draw(st.sampled_from(elements)).insert(0, copy.deepcopy(element))
    elif kind == "shape gone":
        geometry = draw(st.sampled_from([*root.iter("geometry"), element]))
        geometry.clear()
    elif kind == "equal limits":
        for limit in root.iter("limit"):
            if draw(st.booleans()):
                limit.set("lower", limit.get("upper", "0"))
    elif kind == "tag":
        element.tag = draw(st.sampled_from([each.tag for each in elements]))
    elif key is not None:
        value = element.attrib.pop(key)
        if kind == "misspelled":
            element.set(key[::-1], value)
        elif kind == "attribute":
            element.set(key, draw(st.sampled_from(VALUES)))
