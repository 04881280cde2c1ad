"""The robots in robots/: their numbers, their `robot.toml`, and that they simulate."""

from __future__ import annotations

import json
import math
import tomllib
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from lxml import etree

from morphkit import registry

ROBOTS = Path(__file__).parents[3] / "robots"
DATA = Path(__file__).parents[2] / "data"
BENCHMARK = json.loads((DATA / "benchmark_robots.json").read_text())
DYNAMICS = json.loads((DATA / "benchmark_dynamics.json").read_text())
BODIES = json.loads((DATA / "benchmark_bodies.json").read_text())
ALL = ("arm", "cheetah", "hopper", "humanoid_2d", "planar_cheetah", "quadruped", "walker")
URDFS = ("planar_cheetah", "quadruped")
REQUIRED = {"description", "license", "source", "file", "family", "type_words", "type_matched_in", "task", "base"}


def robot_toml(name: str) -> dict[str, Any]:
    return tomllib.loads((ROBOTS / name / "robot.toml").read_text())


def urdf_tree(name: str) -> Any:
    return etree.parse(ROBOTS / name / f"{name}.urdf")


def robot_spec(name: str) -> mujoco.MjSpec:
    source = (ROBOTS / name / robot_toml(name)["file"]).read_bytes()
    if name in URDFS:
        tree = etree.fromstring(source)
        extension = etree.SubElement(tree, "mujoco")
        etree.SubElement(extension, "compiler", fusestatic="false", discardvisual="false")
        source = etree.tostring(tree)
    return mujoco.MjSpec.from_string(source.decode())


def grounded(name: str) -> mujoco.MjModel:
    """The robot with a floor and a base, standing on the floor."""
    spec = robot_spec(name)
    if name in URDFS:
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[10, 10, 1])
        root = spec.worldbody.first_body()
        root.pos = [0, 0, {"quadruped": 0.33, "planar_cheetah": 0.64}[name]]
        if robot_toml(name)["base"] == "free":
            root.add_freejoint()
        else:
            root.add_joint(name="x", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1, 0, 0])
            root.add_joint(name="z", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1])
            root.add_joint(name="pitch", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 1, 0])
    return spec.compile()


def test_folder_of_every_robot_is_known() -> None:
    assert tuple(sorted(path.parent.name for path in ROBOTS.glob("*/robot.toml"))) == ALL
    assert tuple(description.name for description in registry.shipped()) == ALL


@pytest.mark.parametrize("name", ALL)
def test_toml_has_the_required_keys(name: str) -> None:
    toml = robot_toml(name)
    assert toml.keys() >= REQUIRED
    assert (ROBOTS / name / toml["file"]).is_file()
    assert toml["license"] == "MIT"
    assert toml["base"] in ("free", "planar", "fixed")
    assert len(toml["type_words"]) == 4


@pytest.mark.parametrize("name", BENCHMARK)
def test_masses_and_inertias_are_the_benchmarks(name: str) -> None:
    model = robot_spec(name).compile()
    bodies = BENCHMARK[name]["bodies"]
    assert [model.body(i).name for i in range(1, model.nbody)] == list(bodies)
    np.testing.assert_allclose(model.body_mass[1:], [b["mass_kg"] for b in bodies.values()], rtol=0, atol=1e-9)
    np.testing.assert_allclose(model.body_inertia[1:], [b["inertia_kgm2"] for b in bodies.values()], rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", BENCHMARK)
def test_ranges_gears_and_start_are_the_benchmarks(name: str) -> None:
    model, expected = robot_spec(name).compile(), BENCHMARK[name]
    assert [model.joint(i).name for i in range(model.njnt)] == list(expected["joint_range_rad"])
    ranges = list(expected["joint_range_rad"].values())
    np.testing.assert_allclose(model.jnt_range, ranges, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(model.jnt_limited, [low < high for low, high in ranges])
    assert [model.joint(i).name for i in model.actuator_trnid[:, 0]] == list(expected["gear_nm"])
    np.testing.assert_array_equal(model.actuator_gear[:, 0], list(expected["gear_nm"].values()))
    np.testing.assert_array_equal(model.actuator_ctrlrange, [[-1, 1]] * model.nu)
    np.testing.assert_array_equal(model.qpos0, expected["qpos0"])
    assert model.opt.timestep == expected["timestep_s"]


@pytest.mark.parametrize("name", BENCHMARK)
def test_joints_and_contacts_are_the_benchmarks(name: str) -> None:
    model, expected = robot_spec(name).compile(), DYNAMICS[name]
    assert model.opt.integrator == expected["integrator"]
    for key, values in (
        ("armature", model.dof_armature),
        ("damping", model.dof_damping),
        ("stiffness", model.jnt_stiffness),
        ("axis", model.jnt_axis),
        ("limit_solref", model.jnt_solref),
        ("limit_solimp", model.jnt_solimp),
    ):
        numbers = [expected["joints"][model.joint(i).name][key] for i in range(model.njnt)]
        np.testing.assert_allclose(values, numbers, rtol=0, atol=1e-9, err_msg=key)
    assert [model.body(i).name for i in model.geom_bodyid] == [geom["body"] for geom in expected["geoms"]]
    contacts = np.stack([model.geom_contype, model.geom_conaffinity, model.geom_condim], axis=1)
    for key, values in (
        ("size_m", model.geom_size),
        ("pos_m", model.geom_pos),
        ("quat", model.geom_quat),
        ("friction", model.geom_friction),
        ("solref", model.geom_solref),
        ("solimp", model.geom_solimp),
        ("margin_m", model.geom_margin),
        ("contype_conaffinity_condim", contacts),
    ):
        numbers = [geom[key] for geom in expected["geoms"]]
        np.testing.assert_allclose(values, numbers, rtol=0, atol=1e-9, err_msg=key)


def test_recipes_are_the_32_bodies() -> None:
    recipes = {name: robot for robot in BENCHMARK for name in robot_toml(robot)["recipes"]}
    assert recipes == {name: body["robot"] for name, body in BODIES.items()}
    assert len(recipes) == 32


@pytest.mark.parametrize("name", BODIES)
def test_recipe_gives_the_benchmarks_body(name: str) -> None:
    expected = BODIES[name]
    description = registry.load(name)
    model = mujoco.MjModel.from_xml_string(description.source.decode())
    assert [model.body(i).name for i in range(1, model.nbody)] == expected["limbs"]
    assert math.isclose(model.body_mass.sum(), expected["total_mass_kg"], rel_tol=0, abs_tol=1e-9)
    assert description.info.expert_return == expected["expert_return"]
    low_high = expected["healthy_height_m"]
    bounds = low_high and tuple(math.inf if bound is None else bound for bound in low_high)
    assert description.info.healthy_height == bounds
    if expected["root_height_m"] is not None:
        assert model.body("torso").pos[2] == expected["root_height_m"]
        assert model.qpos0[1] == expected["root_height_m"]


@pytest.mark.parametrize("name", ALL)
def test_robot_rests_without_torque(name: str) -> None:
    """Dropped from its start pose, a robot settles: no warning, no energy out of nowhere."""
    model = grounded(name)
    data = mujoco.MjData(model)
    limited = model.jnt_limited.astype(bool) & (model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE)
    start = model.qpos0[model.jnt_qposadr]
    if name != "humanoid_2d":  # the benchmark's knees start 2 degrees outside their range
        assert (model.jnt_range[limited, 0] <= start[limited]).all()
        assert (start[limited] <= model.jnt_range[limited, 1]).all()
    mujoco.mj_forward(model, data)
    assert all(contact.dist > -0.01 for contact in data.contact)
    mujoco.mj_step(model, data, nstep=round(6 / model.opt.timestep))
    assert np.isfinite(data.qpos).all()
    assert not any(warning.number for warning in data.warning)
    assert np.abs(data.qvel).max() < 1


@pytest.mark.parametrize("name", URDFS)
def test_urdf_inertials_are_physical(name: str) -> None:
    tree = urdf_tree(name)
    for link in tree.iterfind("link"):
        inertia = link.find("inertial/inertia")
        assert inertia is not None, link.get("name")
        moments = sorted(float(inertia.get(key)) for key in ("ixx", "iyy", "izz"))
        assert moments[0] > 0
        assert moments[0] + moments[1] >= moments[2], link.get("name")


@pytest.mark.parametrize(
    ("name", "count", "low_kg", "high_kg"), [("quadruped", 12, 12, 15), ("planar_cheetah", 6, 18, 22)]
)
def test_urdf_joints_have_limits_and_transmissions(name: str, count: int, low_kg: float, high_kg: float) -> None:
    tree = urdf_tree(name)
    moving = [joint for joint in tree.iterfind("joint") if joint.get("type") == "revolute"]
    assert len(moving) == count
    for joint in moving:
        limit = joint.find("limit")
        assert float(limit.get("lower")) < 0 < float(limit.get("upper"))
        assert float(limit.get("effort")) > 0
        assert float(limit.get("velocity")) > 0
    driven = [joint.get("name") for joint in tree.iterfind("transmission/joint")]
    assert driven == [joint.get("name") for joint in moving]
    assert low_kg < robot_spec(name).compile().body_mass.sum() < high_kg


def test_quadruped_stands_on_its_feet() -> None:
    model = robot_spec("quadruped").compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for leg in ("FL", "FR", "RL", "RR"):
        foot, hip = data.body(f"{leg}_foot").xpos, data.body(f"{leg}_thigh").xpos
        np.testing.assert_allclose(foot[:2], hip[:2], atol=1e-6)
        assert math.isclose(hip[2] - foot[2], 0.4 * math.cos(0.7), abs_tol=1e-6)
        assert model.body(f"{leg}_foot").jntnum == 0


def test_arm_breaks_the_one_joint_one_actuator_rule() -> None:
    model = robot_spec("arm").compile()
    assert model.body("shoulder").jntnum == 2
    kinds = list(model.actuator_trntype)
    assert kinds.count(mujoco.mjtTrn.mjTRN_TENDON) == 1
    driven = {model.joint(i).name for i, kind in zip(model.actuator_trnid[:, 0], kinds, strict=True) if kind == 0}
    assert {"yaw", "lift"} <= driven
    assert "swing" not in driven
    assert model.actuator_ctrllimited.all()
    assert (model.ntendon, model.nkey, model.nsensor) == (1, 1, 3)
    assert model.nexclude == 2


def test_arm_can_lift_itself() -> None:
    """The shoulder's motor holds the stretched arm with a control well inside its range."""
    model = robot_spec("arm").compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    lift = model.joint("lift").dofadr[0]
    assert abs(data.qfrc_bias[lift]) < 0.6 * model.actuator("lift").gear[0]
