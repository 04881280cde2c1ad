"""An MJCF robot whose elements have no name, or one that others have or read like."""

from __future__ import annotations

from morphkit.description import Description
from morphkit.morphology import Morphology

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


def mjcf(text: str = MJCF) -> Description:
    return Description("r", "r.xml", "mjcf", text.encode())


def names(morphology: Morphology) -> list[str]:
    return [limb.name for limb in morphology.limbs]
