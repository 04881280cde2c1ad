from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh

from morphkit.description import Description
from morphkit.errors import AssetError, ConfigError, DescriptionError
from morphkit.registry import load, shipped
from morphkit.simulation.build import Simulation, build_simulation, compile_plain
from morphkit.simulation.completion import FLOOR_NAME

INERTIAL = '<inertial><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial>'


def urdf(body: str = "", *, folder: Path | None = None) -> Description:
    """A box with one leg that ends 0.4 m below the box's frame."""
    source = f"""<robot name="crab">
      <link name="box">{INERTIAL}<collision><geometry><box size=".2 .2 .2"/></geometry></collision></link>
      <link name="leg">{INERTIAL}
        <collision><origin xyz="0 0 -.2"/><geometry><cylinder radius=".05" length=".4"/></geometry></collision>{body}
      </link>
      <joint name="hip" type="revolute"><parent link="box"/><child link="leg"/><axis xyz="0 1 0"/>
        <limit lower="-1" upper="1" effort="30" velocity="3"/></joint>
    </robot>"""
    return Description("crab", "crab.urdf", "urdf", source.encode(), folder=folder)


def mjcf(body: str, rest: str = "") -> Description:
    source = f"<mujoco><worldbody>{body}</worldbody>{rest}</mujoco>"
    return Description("thing", "thing.xml", "mjcf", source.encode())


PLANAR = '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/><joint axis="0 1 0"/>'


def lowest_of_compiled(simulation: Simulation) -> float:
    """Distance of the robot from the floor at the start, by MuJoCo's own collision functions, m."""
    model = simulation.model
    data = mujoco.MjData(model)
    data.qpos[:] = simulation.start
    mujoco.mj_forward(model, data)
    floor = model.geom(FLOOR_NAME).id
    touching = [g for g in range(model.ngeom) if g != floor and model.geom_contype[g]]
    return min(mujoco.mj_geomDistance(model, data, floor, g, 10.0, None) for g in touching)


@pytest.mark.parametrize("base", ["planar", "free"])
def test_urdf_gets_floor_base_and_motors(base: str) -> None:
    simulation = build_simulation(urdf(), base=base, actuation="torque")
    model = simulation.model
    joints = [model.joint(j).name for j in range(model.njnt)]
    assert joints == (["root_x", "root_z", "root_y"] if base == "planar" else ["root_free"]) + ["hip"]
    assert simulation.base == simulation.tokens.base == base
    assert lowest_of_compiled(simulation) == pytest.approx(0, abs=1e-6)
    np.testing.assert_array_equal(model.actuator_ctrlrange, [[-30, 30]])
    assert (simulation.tokens.actuators[0].low, simulation.tokens.actuators[0].high) == (-30, 30)
    assert model.qpos0[1 if base == "planar" else 2] == pytest.approx(0.4)
    assert any("floor" in note for note in simulation.notes)
    assert "1 motor was added, bounded by its joint's effort limit" in simulation.notes


def test_motor_torque_is_the_control() -> None:
    simulation = build_simulation(urdf(), base="fixed")
    data = mujoco.MjData(simulation.model)
    data.ctrl[:] = 7.0
    mujoco.mj_forward(simulation.model, data)
    assert data.qfrc_actuator[-1] == pytest.approx(7.0)


def test_planar_base_moves_along_the_world_whatever_the_root_frame() -> None:
    simulation = build_simulation(mjcf('<body name="a" euler="20 30 40"><geom size=".1"/></body>'), base="planar")
    data = mujoco.MjData(simulation.model)
    start = simulation.model.qpos0.copy()
    data.qpos[:] = start + np.array([0.3, 0.2, 0.0])
    mujoco.mj_kinematics(simulation.model, data)
    moved = data.body("a").xpos.copy()
    data.qpos[:] = start
    mujoco.mj_kinematics(simulation.model, data)
    np.testing.assert_allclose(moved - data.body("a").xpos, [0.3, 0, 0.2], atol=1e-9)
    data.qvel[:] = [0, 0, 1]
    mujoco.mj_forward(simulation.model, data)
    velocity = np.zeros(6)
    mujoco.mj_objectVelocity(simulation.model, data, mujoco.mjtObj.mjOBJ_XBODY, simulation.limb_body[0], velocity, 0)
    np.testing.assert_allclose(velocity[:3], [0, 1, 0], atol=1e-9)


@pytest.mark.parametrize(
    "geom",
    [
        'type="sphere" size=".1"',
        'type="capsule" size=".1 .3" euler="10 50 0"',
        'type="cylinder" size=".1 .3" euler="70 20 0"',
        'type="ellipsoid" size=".1 .2 .3" euler="30 40 50"',
        'type="box" size=".1 .2 .3" euler="30 40 50"',
        'type="mesh" mesh="wedge" euler="30 40 50"',
    ],
)
def test_any_geom_starts_on_the_floor(geom: str) -> None:
    mesh = '<asset><mesh name="wedge" vertex="0 0 0  .5 0 0  0 .4 0  0 0 .3"/></asset>'
    simulation = build_simulation(
        mjcf(f'<body name="a" pos="0 0 -3"><geom pos=".1 .2 .3" {geom}/></body>', mesh), base="free"
    )
    assert lowest_of_compiled(simulation) == pytest.approx(0, abs=1e-5)


@pytest.mark.parametrize("base", ["planar", "free"])
def test_a_root_within_a_turned_frame_starts_at_the_floor_and_leaves_what_else_is_there(base: str) -> None:
    body = '<body name="a" pos="0 0 1" euler="0 0 40"><geom type="box" size=".1 .2 .3"/></body>'
    source = mjcf(f'<frame pos="1 2 3" euler="90 0 20">{body}<site name="mark" pos="1 1 1"/></frame>')
    plain, simulation = compile_plain(source), build_simulation(source, base=base)
    assert lowest_of_compiled(simulation) == pytest.approx(0, abs=1e-6)
    np.testing.assert_allclose(simulation.model.body("a").quat, plain.body("a").quat, atol=1e-12)
    np.testing.assert_allclose(simulation.model.body("a").pos[:2], plain.body("a").pos[:2], atol=1e-12)
    np.testing.assert_allclose(simulation.model.site("mark").pos, plain.site("mark").pos, atol=1e-12)
    assert simulation.model.qpos0[1 if base == "planar" else 2] == pytest.approx(simulation.model.body("a").pos[2])


@pytest.mark.parametrize("joints", ["<freejoint/>", PLANAR], ids=["free", "planar"])
def test_a_robot_on_a_base_of_its_own_does_not_start_within_a_floor_that_was_added(joints: str) -> None:
    body = f'<body name="a" pos="0 0 {{}}">{joints}<geom type="box" size=".1 .2 .3"/></body>'
    sunken, above = (build_simulation(mjcf(body.format(height))) for height in (0.1, 0.5))
    assert lowest_of_compiled(sunken) == pytest.approx(0, abs=1e-6)
    assert lowest_of_compiled(above) == pytest.approx(0.2 * (joints == PLANAR), abs=1e-6)
    own_floor = build_simulation(mjcf(f'<geom type="plane" size="1 1 1" pos="0 0 -1"/>{body.format(0.1)}'))
    assert own_floor.model.body("a").pos[2] == 0.1


def test_own_base_and_floor_are_kept() -> None:
    simulation = build_simulation(load("cheetah"))
    plain = compile_plain(load("cheetah"))
    assert simulation.notes == ()
    np.testing.assert_array_equal(simulation.model.geom_pos, plain.geom_pos)
    np.testing.assert_array_equal(simulation.model.body_mass, plain.body_mass)
    np.testing.assert_array_equal(simulation.model.dof_damping, plain.dof_damping)
    assert simulation.model.nq == plain.nq


def test_a_base_that_contradicts_the_file_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"cheetah\.xml: base 'free' was asked for, but .*'torso' make it planar"):
        build_simulation(load("cheetah"), base="free")


def test_a_base_that_slides_over_the_floor_is_refused() -> None:
    joints = "".join(f'<joint name="{n}" type="{t}" axis="{a}"/>' for n, t, a in (
        ("east", "slide", "1 0 0"), ("north", "slide", "0 1 0"), ("yaw", "hinge", "0 0 1")
    ))  # fmt: skip
    with pytest.raises(DescriptionError, match="the root has east, north, yaw, along or about other axes"):
        build_simulation(mjcf(f'<body name="cart" pos="0 0 1">{joints}<geom size=".1"/></body>'))


def test_fixed_base_gets_a_floor_that_nothing_touches() -> None:
    simulation = build_simulation(urdf(), base="fixed")
    assert simulation.model.geom(FLOOR_NAME).contype[0] == 0
    assert simulation.base_joints == ()
    assert simulation.model.njnt == 1


@pytest.mark.parametrize("description", shipped(), ids=lambda d: d.name)
def test_sensors_come_last_and_match_forward(description: Description) -> None:
    simulation = build_simulation(description)
    model = simulation.model
    own = compile_plain(description).nsensordata
    size = simulation.limb_sensor.size
    np.testing.assert_array_equal(simulation.limb_sensor.ravel(), np.arange(own, own + size))
    assert model.nsensordata == own + size
    data, kinematics = mujoco.MjData(model), mujoco.MjData(simulation.kinematics)
    rng = np.random.default_rng(0)
    data.qpos[:] = model.qpos0 + rng.normal(0, 0.3, model.nq)
    mujoco.mj_normalizeQuat(model, data.qpos)
    data.qvel[:] = rng.normal(0, 1, model.nv)
    kinematics.qpos[:], kinematics.qvel[:] = data.qpos, data.qvel
    mujoco.mj_forward(model, data)
    mujoco.mj_step(simulation.kinematics, kinematics)
    limbs = simulation.limb_sensor
    np.testing.assert_allclose(kinematics.sensordata[limbs], data.sensordata[limbs], atol=1e-9)
    np.testing.assert_allclose(data.sensordata[limbs[:, :3]], data.xpos[simulation.limb_body], atol=1e-12)
    np.testing.assert_allclose(data.sensordata[limbs[:, 9:]], data.xquat[simulation.limb_body], atol=1e-12)


def test_limbs_are_sensed_where_the_file_switches_sensors_off() -> None:
    body = '<body name="a" pos="0 0 2"><freejoint/><geom size=".1"/></body>'
    blind = build_simulation(mjcf(body, '<option><flag sensor="disable"/></option>'))
    for model in (blind.model, blind.kinematics):
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data)
        np.testing.assert_array_equal(data.sensordata[blind.limb_sensor[0, :3]], [0, 0, 2])


@pytest.mark.parametrize("description", shipped(), ids=lambda d: d.name)
def test_controls_are_in_token_order(description: Description) -> None:
    simulation = build_simulation(description)
    model = simulation.model
    for i, token in enumerate(simulation.tokens.actuators):
        if token.joint is not None:
            assert model.joint(model.actuator_trnid[i, 0]).name == token.joint
        bounds = model.actuator_ctrlrange[i] if model.actuator_ctrllimited[i] else [None, None]
        assert list(bounds) == [token.low, token.high]
    names = [[model.joint(j).name for j in joints] for joints in simulation.limb_joints]
    assert names == [list(limb.joints) for limb in simulation.tokens.limbs]


def test_missing_visual_mesh_is_left_out_with_a_note(tmp_path: Path) -> None:
    visual = '<visual><geometry><mesh filename="package://crab/skin.stl"/></geometry></visual>'
    simulation = build_simulation(urdf(visual, folder=tmp_path), base="free")
    assert any("package://crab/skin.stl" in note for note in simulation.notes)
    assert simulation.model.nmesh == 0


def test_meshes_that_only_decorate_are_left_out_of_what_is_not_drawn(tmp_path: Path) -> None:
    """Servos and start height stay what they are in a model that is drawn, to the last bit."""
    trimesh.creation.box((0.3, 0.3, 1.4)).export(tmp_path / "skin.stl")
    visual = '<visual><geometry><mesh filename="skin.stl"/></geometry></visual>'
    lost = '<visual><geometry><mesh filename="lost.stl"/></geometry></visual>'
    whole = urdf(visual + lost, folder=tmp_path)
    whole = replace(whole, source=whole.source.replace(b'effort="30"', b'effort="3000"'))
    drawn, plain = (build_simulation(whole, base="free", drawn=drawn) for drawn in (True, False))
    assert (drawn.model.nmesh, plain.model.nmesh) == (1, 0)
    assert drawn.gains == plain.gains
    assert drawn.gains["hip"].stiffness < 3000 / 0.5
    np.testing.assert_array_equal(drawn.start, plain.start)
    assert [any("lost.stl" in note for note in each.notes) for each in (drawn, plain)] == [True, True]


def test_meshes_stay_where_nothing_else_says_how_high_a_robot_stands(tmp_path: Path) -> None:
    trimesh.creation.box((0.2, 0.2, 1.4)).export(tmp_path / "skin.stl")
    ghost = urdf('<visual><geometry><mesh filename="skin.stl"/></geometry></visual>', folder=tmp_path)
    source = re.sub(rb"<collision>.*?</collision>", b"", ghost.source, flags=re.DOTALL)
    simulation = build_simulation(replace(ghost, source=source), base="free", drawn=False)
    assert simulation.model.nmesh == 1
    assert simulation.start[2] == pytest.approx(0.7, abs=1e-5)


def test_missing_collision_mesh_is_named(tmp_path: Path) -> None:
    collision = '<collision><geometry><mesh filename="meshes/claw.stl"/></geometry></collision>'
    with pytest.raises(AssetError, match=r"crab\.urdf: mesh 'meshes/claw\.stl' is needed in simulation"):
        build_simulation(urdf(collision, folder=tmp_path), base="free")


@pytest.mark.parametrize("suffix", ["stl", "ply"])
def test_collision_mesh_is_loaded_and_converted_where_mujoco_cannot_read_it(tmp_path: Path, suffix: str) -> None:
    (tmp_path / "meshes").mkdir()
    trimesh.creation.box((0.2, 0.2, 1.4)).export(tmp_path / "meshes" / f"claw.{suffix}")
    collision = f'<collision><geometry><mesh filename="meshes/claw.{suffix}"/></geometry></collision>'
    simulation = build_simulation(urdf(collision, folder=tmp_path), base="free")
    assert simulation.model.nmesh == 1
    assert simulation.model.qpos0[2] == pytest.approx(0.7, abs=1e-5)


def test_two_meshes_of_one_file_name_stay_apart(tmp_path: Path) -> None:
    for folder, size in (("a", 0.2), ("b", 0.6)):
        (tmp_path / folder).mkdir()
        trimesh.creation.box((size, size, size)).export(tmp_path / folder / "part.stl")
    pair = "".join(f'<collision><geometry><mesh filename="{f}/part.stl"/></geometry></collision>' for f in ("a", "b"))
    model = build_simulation(urdf(pair, folder=tmp_path), base="free").model
    extents = sorted(float(np.ptp(model.mesh_vert[first : first + 8, 0])) for first in model.mesh_vertadr)
    np.testing.assert_allclose(extents, [0.2, 0.6], atol=1e-5)


def test_urdf_links_collide_with_the_floor_only() -> None:
    model = build_simulation(urdf(), base="free").model
    floor = model.geom(FLOOR_NAME).id
    robot = [g for g in range(model.ngeom) if g != floor]
    assert all(model.geom_contype[g] & model.geom_conaffinity[floor] for g in robot)
    assert not any(model.geom_contype[a] & model.geom_conaffinity[b] for a in robot for b in robot)


def test_what_mujoco_refuses_becomes_a_description_error() -> None:
    massless = mjcf('<body name="a"><geom size=".1"/><body name="b"><joint/></body></body>')
    with pytest.raises(DescriptionError, match=r"thing\.xml: MuJoCo cannot compile it: .*mass"):
        build_simulation(massless, base="fixed")


def test_unnamed_bodies_and_joints_work() -> None:
    simulation = build_simulation(
        mjcf('<body><freejoint/><geom size=".1"/><body><joint/><geom size=".1"/></body></body>')
    )
    assert simulation.base == "free"
    assert [len(joints) for joints in simulation.limb_joints] == [0, 1]
