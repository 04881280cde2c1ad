"""A URDF with every kind of joint and mesh."""

from __future__ import annotations

from pathlib import Path

import trimesh

SPHERE = '<inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0.001" ixz="-0.002" iyz="0.003"/>'
INERTIAL = f'<inertial><origin xyz="0.01 -0.02 0.03" rpy="0.3 -0.2 0.9"/><mass value="{{}}"/>{SPHERE}</inertial>'
EVERYTHING = f"""<?xml version="1.0"?>
<robot name="everything">
  <link name="base">{INERTIAL.format(3)}
    <visual name="look"><geometry><mesh filename="meshes/part.dae" scale="2 2 2"/></geometry></visual>
    <collision name="look"><geometry><mesh filename="meshes/part.stl"/></geometry></collision>
  </link>
  <link name="upper">{INERTIAL.format(1)}
    <visual name="look"><geometry><mesh filename="meshes/text.stl"/></geometry></visual>
    <visual><geometry><mesh filename="meshes/missing.stl"/></geometry></visual>
    <collision><geometry><cylinder radius="0.05" length="0.4"/></geometry></collision>
  </link>
  <link name="sensor"><visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual></link>
  <link name="slider">{INERTIAL.format(0.5)}</link>
  <link name="axis"/>
  <link name="wheel"><inertial><mass value="0.7"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="finger"><inertial><mass value="0.1"/>
    <inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="revolute"><origin xyz="0.1 0.2 0.3" rpy="0.4 0.5 0.6"/><parent link="base"/>
    <child link="upper"/><axis xyz="0 0.6 0.8"/><limit lower="-1" upper="2" effort="30" velocity="3"/>
    <dynamics damping="0.7" friction="0.2"/></joint>
  <joint name="mount" type="fixed"><origin xyz="0 0 0.2" rpy="1 0 -1"/><parent link="upper"/>
    <child link="sensor"/></joint>
  <joint name="rail" type="prismatic"><origin rpy="0 1.2 0"/><parent link="upper"/><child link="slider"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="0.5" effort="80" velocity="1"/>
    <safety_controller k_velocity="10"/></joint>
  <joint name="turn" type="revolute"><parent link="slider"/><child link="axis"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="spin" type="continuous"><origin xyz="0 0.1 0"/><parent link="axis"/><child link="wheel"/>
    <axis xyz="0 0 1"/></joint>
  <joint name="grip" type="revolute"><origin xyz="0.3 0 0"/><parent link="upper"/><child link="finger"/>
    <axis xyz="0 0 1"/><limit lower="-3" upper="5" effort="4" velocity="1"/>
    <mimic joint="shoulder" multiplier="-1.5" offset="0.2"/></joint>
  <gazebo reference="base"><material>Gazebo/Red</material></gazebo>
</robot>
"""


def robot(folder: Path) -> Path:
    """A URDF with every kind of joint and mesh."""
    (folder / "meshes").mkdir(parents=True)
    box = trimesh.creation.box((0.2, 0.3, 0.4))
    box.export(folder / "meshes" / "part.stl")
    box.export(folder / "meshes" / "text.stl", file_type="stl_ascii")
    box.apply_scale(1000)
    dae = trimesh.exchange.dae.export_collada(box).decode()
    millimeters = dae.replace("</asset>", '<unit name="millimeter" meter="0.001"/></asset>')
    (folder / "meshes" / "part.dae").write_text(millimeters)
    path = folder / "everything.urdf"
    path.write_text(EVERYTHING)
    return path
