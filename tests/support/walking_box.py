"""A red box that slides along a floor and rises from it."""

from __future__ import annotations

import mujoco

WALKING_BOX = """
<mujoco>
  <worldbody>
    {floor}
    <body name="box" pos="0 0 {height}">
      <joint name="x" type="slide" axis="1 0 0"/>
      <joint name="z" type="slide" axis="0 0 1"/>
      <geom type="box" size=".3 .1 .1" rgba="1 0 0 1"/>
    </body>
  </worldbody>
</mujoco>
"""


def box(height: float = 0.5, floor: bool = True) -> mujoco.MjModel:
    plane = '<geom type="plane" size="9 9 1"/>' if floor else ""
    return mujoco.MjModel.from_xml_string(WALKING_BOX.format(floor=plane, height=height))
