from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from morphkit.description import Description, RobotInfo
from morphkit.errors import ConfigError, DescriptionError
from morphkit.families.enumeration import sub_morphologies
from morphkit.families.manifest import read_manifest
from morphkit.families.write import write_family
from morphkit.registry import load, load_all
from morphkit.robot_toml import read_robot_toml
from morphkit.simulation.build import Simulation, build_simulation

ARM = """<mujoco><option timestep=".002"/><worldbody><body name="box"><geom size=".1"/>
  <body name="arm"><joint name="j" axis="0 1 0" armature=".5" ref="20"/><geom size=".01" mass="1e-6"/></body>
  <body name="rail"><joint name="s" type="slide" axis="0 1 0" range="0 .4" armature="2"/><geom size=".01" mass="1e-6"/>
  </body></body></worldbody><actuator>{}</actuator></mujoco>"""


def robot(actuators: str, kind: str | None = "position", **info) -> Simulation:
    description = Description("arm", "arm.xml", "mjcf", ARM.format(actuators).encode(), info=RobotInfo(**info))
    return build_simulation(description, base="fixed", actuation=kind)  # type: ignore[arg-type]


def force(simulation: Simulation, control: float, qpos: float, qvel: float) -> float:
    """Force at joint j with another control than the start's, at a place and speed of its own."""
    data = mujoco.MjData(simulation.model)
    data.ctrl[:], data.qpos[0], data.qvel[0] = control, qpos, qvel
    mujoco.mj_forward(simulation.model, data)
    return float(data.qfrc_actuator[0])


def test_a_motor_becomes_a_servo_around_the_start_within_its_effort() -> None:
    simulation = robot('<motor joint="j" gear="3" ctrlrange="-2 2"/>')
    effort, start = 6.0, math.radians(20)
    stiffness, damping = effort / 0.5, 2 * math.sqrt(effort / 0.5 * 0.5)
    np.testing.assert_allclose(simulation.gains["j"], (stiffness, damping), rtol=1e-4)
    token = simulation.tokens.actuators[0]
    assert (token.unit, token.name) == ("rad", "arm_ctrl")
    np.testing.assert_allclose([token.low, token.high], [start - 0.5, start + 0.5])
    np.testing.assert_allclose(simulation.model.actuator_ctrlrange[0], [start - 0.5, start + 0.5])
    assert force(simulation, start + 0.1, start, 0.2) == pytest.approx(stiffness * 0.1 - damping * 0.2, rel=1e-4)
    assert force(simulation, start + 0.5, start - 1, 0.0) == pytest.approx(effort)
    data = mujoco.MjData(simulation.model)
    data.ctrl[:] = start + 0.3
    simulation.model.opt.gravity[:] = 0
    for _ in range(4000):
        mujoco.mj_step(simulation.model, data)
    assert data.qpos[0] == pytest.approx(start + 0.3, abs=1e-3)


def test_stiffness_without_an_effort_limit_follows_from_inertia() -> None:
    simulation = robot('<motor joint="j"/><motor joint="s" ctrlrange="-8 8"/>')
    assert simulation.gains["j"].stiffness == pytest.approx(0.5 * (20 * math.pi) ** 2, rel=1e-4)
    assert not simulation.model.actuator_forcelimited[0]
    assert simulation.gains["s"].stiffness == pytest.approx(8 / 0.1)  # a quarter of its travel
    assert simulation.tokens.actuators[1].unit == "m"


def test_an_effort_limit_counts_as_far_as_a_robot_of_that_weight_can_need() -> None:
    weight, extent = 9.81 * (1000 * 4 / 3 * math.pi * 0.1**3 + 2e-6), 0.1
    simulation = robot('<motor joint="j" ctrlrange="-1000 1000"/><motor joint="s" ctrlrange="-9000 9000"/>')
    assert simulation.gains["j"].stiffness == pytest.approx(2 * weight * extent / 0.5, rel=1e-4)
    assert simulation.gains["s"].stiffness == pytest.approx(2 * weight / 0.1, rel=1e-4)
    assert simulation.model.actuator_forcerange[:, 1].tolist() == [1000, 9000]


def test_gains_of_the_file_and_of_robot_toml_go_before_the_rule() -> None:
    servo = '<position joint="j" kp="30" kv="4" gear="2" forcerange="-5 5"/>'
    simulation = robot(servo)
    assert simulation.gains["j"] == (120, 16)
    assert simulation.model.actuator_forcerange[0].tolist() == [-10, 10]
    given = robot(servo, gains={"x*": (1.0, 1.0), "j*": (7.0, 0.5), "j": (9.0, 9.0)}, action_scale=0.2)
    assert given.gains["j"] == (7.0, 0.5)
    assert np.ptp(given.model.actuator_ctrlrange[0]) == pytest.approx(0.2)


def test_torques_replace_servos_with_a_limit() -> None:
    limited = robot('<position joint="j" kp="30" gear="2" forcerange="-5 5"/>', "torque")
    assert (limited.tokens.actuators[0].low, limited.tokens.actuators[0].unit) == (-10, "N*m")
    assert force(limited, 7.0, 0.3, 0.4) == pytest.approx(7.0)
    with pytest.raises(ConfigError, match="no limit of its force"):
        robot('<position joint="j" kp="30"/>', "torque")


def test_tendons_muscles_and_filters_stay_as_they_are() -> None:
    arm = load("arm")
    ours, theirs = (build_simulation(arm, actuation=kind) for kind in ("position", "as-file"))
    tendon = [i for i, token in enumerate(ours.tokens.actuators) if token.joint is None]
    assert tendon
    for i, token in enumerate(ours.tokens.actuators):
        assert (token == theirs.tokens.actuators[i]) == (i in tendon)
    np.testing.assert_array_equal(ours.model.actuator_gainprm[tendon], theirs.model.actuator_gainprm[tendon])


@pytest.mark.parametrize(("base", "kind"), [("free", "position"), ("planar", "as-file"), ("fixed", "as-file")])
def test_what_is_not_asked_for_follows_from_the_base(base: str, kind: str) -> None:
    quadruped = load("quadruped")
    assert build_simulation(quadruped, base=base).actuation == kind  # type: ignore[arg-type]
    told = replace(quadruped, info=replace(quadruped.info, actuation="torque"))
    assert build_simulation(told, base=base).actuation == "torque"  # type: ignore[arg-type]
    assert robot('<motor joint="j"/>', None).actuation == "as-file"


def test_the_quadruped_holds_its_start_pose() -> None:
    simulation = build_simulation(load("quadruped"))
    data = mujoco.MjData(simulation.model)
    for _ in range(500):
        mujoco.mj_step(simulation.model, data)
    assert data.qpos[2] > 0.3
    assert np.abs(data.qpos[7:]).max() < 0.15


def test_a_cut_body_keeps_its_gains(tmp_path: Path) -> None:
    quadruped = load("quadruped")
    whole = build_simulation(quadruped).gains
    variant = next(v for v in sub_morphologies(quadruped) if "FL_calf" in v.removed and "FL_thigh" not in v.removed)
    alone = build_simulation(variant.description).gains
    assert alone["FL_thigh_joint"].damping < 0.8 * whole["FL_thigh_joint"].damping
    (loaded,) = load_all(write_family(quadruped, [variant], tmp_path / "out"))
    kept = build_simulation(loaded).gains
    assert kept == {joint: gains for joint, gains in whole.items() if joint in kept}
    assert len(kept) == 11


def test_robot_toml_says_how_motors_are_driven(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(
        'file = "a.xml"\nactuation = "position"\naction_scale = 0.5\ncontrol_frequency = 100\n'
        '[gains]\n"*_hip" = [40, 1.5]\n'
    )
    info = read_robot_toml(path).info
    assert (info.actuation, info.action_scale, info.control_frequency) == ("position", 0.5, 100.0)
    assert info.gains == {"*_hip": (40.0, 1.5)}
    for line in ('actuation = "pd"', "action_scale = 0", "control_frequency = -1", "gains = {j = [0, 1]}",
                 "gains = {j = [1, -1]}", "gains = {j = 3}"):  # fmt: skip
        path.write_text(f'file = "a.xml"\n{line}\n')
        with pytest.raises(DescriptionError, match=line.split()[0]):
            read_robot_toml(path)


def test_manifests_refuse_gains_that_make_no_sense(tmp_path: Path) -> None:
    quadruped = load("quadruped")
    path = write_family(quadruped, [next(sub_morphologies(quadruped))], tmp_path / "out")
    text = path.read_text()
    for good, bad in (('"gains": {', '"actuation": "pd", "gains": {'), ('"gains": {', '"action_scale": 0, "gains": {')):
        path.write_text(text.replace(good, bad))
        with pytest.raises(DescriptionError, match="makes no sense"):
            read_manifest(path)
