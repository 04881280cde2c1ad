"""The sensors that a file declares, against what MuJoCo's compiler makes of them."""

from __future__ import annotations

import json

import mujoco
import pytest

from morphkit.description import Description
from morphkit.errors import ConfigError
from morphkit.morphology import Reading
from morphkit.readers import read
from morphkit.tokens.declared_sensors import without_scalars
from morphkit.tokens.spec import TokenSpec, token_spec

MODEL = """<mujoco><worldbody><camera name="eye" pos="0 0 3"/>
<body name="trunk"><geom name="g" size="1"/><site name="imu" size=".1"/><freejoint/>
<body name="leg"><joint name="knee" range="0 90"/><geom size=".1"/>
<body name="foot"><joint name="slider" type="slide" range="0 1"/><geom name="sole" size=".1"/><site name="toe"/>
<body name="ball"><joint name="ball" type="ball"/><geom size=".1"/><camera name="cam" resolution="2 3"/></body>
</body></body></body></worldbody>
<tendon><fixed name="mix" range="0 1"><joint joint="knee" coef="1"/></fixed>
<spatial name="cord" range="0 9"><site site="imu"/><site site="toe"/></spatial></tendon>
<actuator><motor name="m" joint="slider"/><motor name="pull" tendon="cord"/><motor name="geared" joint="knee" gear="9"/>
</actuator><sensor>{}</sensor></mujoco>"""
ALL = """<touch site="imu" cutoff="2"/><accelerometer site="imu"/><velocimeter site="imu"/><gyro site="imu" cutoff="4"/>
<force site="imu"/><torque site="imu"/><magnetometer site="imu"/><camprojection site="imu" camera="eye"/>
<rangefinder site="imu" cutoff="2"/><rangefinder site="imu" data="dist dir origin point normal depth"/>
<rangefinder camera="cam" data="dist normal"/><jointpos joint="knee"/><jointvel joint="slider"/>
<tendonpos tendon="mix"/><tendonvel tendon="cord"/><actuatorpos actuator="m"/><actuatorvel actuator="geared"/>
<actuatorfrc actuator="pull"/><jointactuatorfrc joint="slider"/><tendonactuatorfrc tendon="cord"/>
<ballquat joint="ball"/><ballangvel joint="ball"/><jointlimitpos joint="knee"/><jointlimitvel joint="knee"/>
<jointlimitfrc joint="knee"/><tendonlimitpos tendon="mix"/><tendonlimitvel tendon="mix"/><tendonlimitfrc tendon="mix"/>
<framepos objtype="body" objname="leg" cutoff="3"/><framequat objtype="body" objname="leg"/>
<framexaxis objtype="body" objname="leg" reftype="site" refname="toe"/><frameyaxis objtype="body" objname="leg"/>
<framezaxis objtype="body" objname="leg"/><framelinvel objtype="site" objname="toe"/>
<frameangvel objtype="site" objname="toe"/><framelinacc objtype="site" objname="toe"/>
<frameangacc objtype="site" objname="toe"/><subtreecom body="leg"/><subtreelinvel body="leg"/>
<subtreeangmom body="leg"/><insidesite site="imu" objtype="body" objname="leg"/>
<distance geom1="g" geom2="sole" cutoff="1"/><normal geom1="g" geom2="sole"/><fromto geom1="g" geom2="sole"/>
<contact geom1="g" num="2" data="found force torque dist pos normal tangent"/><contact geom1="sole" data="found"/>
<contact geom1="g" data="force" reduce="netforce"/><e_potential/><e_kinetic/><clock/><user name="u" dim="3"/>
<user name="single" dim="1"/><user name="share" dim="2" datatype="positive" cutoff="3"/>"""


def robot(sensors: str) -> Description:
    return Description("r", "r.xml", "mjcf", MODEL.format(sensors).encode())


def test_every_kind_has_the_size_and_bounds_that_mujoco_gives_it() -> None:
    model = mujoco.MjModel.from_xml_string(MODEL.format(ALL))
    found = read(robot(ALL)).sensors
    assert [len(sensor.readings) for sensor in found] == list(model.sensor_dim)
    kinds = {kind.name for kind in mujoco.mjtSensor.__members__.values()} - {"mjSENS_PLUGIN", "mjSENS_TACTILE"}
    assert {f"mjSENS_{sensor.kind.upper()}" for sensor in found} == kinds
    for index, sensor in enumerate(found):
        kind, cutoff = model.sensor_datatype[index], float(model.sensor_cutoff[index])
        cut = cutoff if cutoff > 0 and kind in (0, 1) and sensor.kind != "contact" else None
        low = 0.0 if kind == mujoco.mjtDataType.mjDATATYPE_POSITIVE else cut and -cut
        assert {(reading.low, reading.high) for reading in sensor.readings} == {(low, cut)}, sensor.name


@pytest.mark.parametrize(
    ("xml", "unit", "frame", "limb"),
    [
        ('<gyro name="s" site="imu"/>', "rad/s", "imu", "trunk"),
        ('<jointpos name="s" joint="knee"/>', "rad", None, "leg"),
        ('<jointpos name="s" joint="slider"/>', "m", None, "foot"),
        ('<jointactuatorfrc name="s" joint="slider"/>', "N", None, "foot"),
        ('<jointlimitfrc name="s" joint="knee"/>', "N*m", None, "leg"),
        ('<tendonpos name="s" tendon="mix"/>', "rad", None, None),
        ('<tendonvel name="s" tendon="cord"/>', "m/s", None, None),
        ('<actuatorpos name="s" actuator="m"/>', "m", None, "foot"),
        ('<actuatorfrc name="s" actuator="geared"/>', "1", None, "leg"),
        ('<actuatorvel name="s" actuator="pull"/>', "m/s", None, None),
        ('<framepos name="s" objtype="body" objname="leg"/>', "m", "world", "leg"),
        ('<framelinvel name="s" objtype="body" objname="leg" reftype="site" refname="toe"/>', "m/s", "toe", "leg"),
        ('<framelinacc name="s" objtype="xbody" objname="leg"/>', "m/s^2", "world", "leg"),
        ('<contact name="s" geom1="sole" data="force"/>', "N", "contact", "foot"),
        ('<contact name="s" geom1="sole" data="force" reduce="netforce"/>', "N", "world", "foot"),
        ('<clock name="s"/>', "s", None, None),
    ],
)
def test_units_frames_and_limbs(xml: str, unit: str, frame: str | None, limb: str | None) -> None:
    (sensor,) = read(robot(xml)).sensors
    assert sensor.limb == limb
    assert {(reading.unit, reading.frame) for reading in sensor.readings} == {(unit, frame)}


def test_a_sensor_with_several_components_gives_several_tokens() -> None:
    morphology = read(robot('<gyro name="imu_gyro" site="imu" cutoff="4"/><clock/><touch name="left_toe" site="toe"/>'))
    spec = token_spec(morphology, source="declared")
    assert [token.name for token in spec.sensors] == ["imu_gyro_x", "imu_gyro_y", "imu_gyro_z", "clock", "left_toe"]
    first = spec.sensors[0]
    assert (first.text, first.limb, first.quantity, first.component) == ("imu gyro x", "trunk", "gyro", "x")
    assert (first.unit, first.frame, first.low, first.high) == ("rad/s", "imu", -4.0, 4.0)
    assert list(spec.token_limb) == [0, 0, 0, -1, 2]
    assert TokenSpec.from_json(spec.to_json()) == spec
    assert json.loads(spec.to_json())["sensors"][3]["limb"] is None


def test_all_is_limb_and_then_declared() -> None:
    morphology = read(robot('<touch name="leg_angle" site="toe"/>'))
    limb, declared, both = (token_spec(morphology, source=choice) for choice in ("limb", "declared", "all"))
    assert [token.name for token in limb.sensors] == [token.name for token in token_spec(morphology).sensors]
    assert [token.name for token in both.sensors] == [*(token.name for token in limb.sensors), "leg_angle_2"]
    assert [token.name for token in declared.sensors] == ["leg_angle"]
    assert limb.actuators == declared.actuators
    with pytest.raises(ConfigError, match="source"):
        token_spec(morphology, source="none")  # type: ignore[arg-type]


def test_sensors_of_another_body_tree_are_not_the_robots() -> None:
    text = MODEL.format('<gyro name="a" site="imu"/><gyro name="b" site="s"/>').replace(
        "</worldbody>", '<body name="box"><site name="s"/><geom size="1"/></body></worldbody>'
    )
    found = read(Description("r", "r.xml", "mjcf", text.encode(), root="trunk")).sensors
    assert [sensor.name for sensor in found] == ["a"]


def test_sensors_of_a_urdf() -> None:
    text = """<robot name="r"><link name="a"/><link name="b"/><link name="other"/>
    <joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint>
    <gazebo reference="a"><sensor name="imu" type="imu"/><sensor name="eye" type="camera"/></gazebo>
    <gazebo reference="j"><sensor name="ft" type="force_torque"/></gazebo>
    <gazebo reference="other"><sensor name="far" type="imu"/></gazebo></robot>"""
    morphology = read(Description("r", "r.urdf", "urdf", text.encode(), root="a"))
    spec = token_spec(morphology, source="declared", naming="canonical")
    assert len(spec.sensors) == 10 + 6
    assert [spec.sensors[i].name for i in (0, 4, 10)] == ["imu_orientation_w", "imu_angular_velocity_x", "ft_force_x"]
    assert [sensor.limb for sensor in morphology.sensors] == ["a", "a", "b"]
    assert morphology.sensors[2].readings[0] == Reading("force", "x", "N", "b")
    assert without_scalars(morphology) == ("camera 'eye'",)
