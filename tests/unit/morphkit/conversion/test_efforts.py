"""Time step and damping of a converted robot suit what its motors can do."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from morphkit.conversion.convert import convert
from morphkit.description import Description
from morphkit.simulation.build import build_simulation
from morphkit.simulation.completion import settle_urdf
from morphkit.simulation.timestep import holds


def finger(effort: str) -> Description:
    """Three light links on hinges, whose motors can do what `effort` says."""
    inertia = '<inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/>'
    link = f'<link name="{{}}"><inertial><origin xyz="0 0 -0.1"/><mass value="0.1"/>{inertia}</inertial></link>'
    joint = (
        '<joint name="j{0}" type="revolute"><origin xyz="0 0 -0.2"/><parent link="l{0}"/><child link="l{1}"/>'
        f'<axis xyz="0 {{2}} 0.3"/><limit lower="-1" upper="1" effort="{effort}" velocity="1000"/></joint>'
    )
    links = "".join(link.format(f"l{number}") for number in range(4))
    joints = "".join(joint.format(number, number + 1, (-1) ** number) for number in range(3))
    return Description("f", "f.urdf", "urdf", f'<robot name="f">{links}{joints}</robot>'.encode())


@pytest.mark.parametrize(("effort", "slower"), [("3", False), ("1000", True)])
def test_the_time_step_suits_the_efforts(
    effort: str, slower: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    conversion = convert(finger(effort))
    model = conversion.spec.compile()
    assert (model.opt.timestep < 0.004) == slower
    assert any("the time step is" in note for note in conversion.notes) == slower
    assert model.actuator_ctrlrange[:, 1].tolist() == [float(effort)] * 3
    assert all(holds(model, model.qpos0, hold) for hold in (0.02, 0.1))
    model.opt.timestep = 0.004
    assert all(holds(model, model.qpos0, hold) for hold in (0.02, 0.1)) != slower
    simulation = build_simulation(finger(effort), base="fixed")
    assert (simulation.model.opt.timestep < 0.004) == slower
    assert any("the time step is" in note for note in simulation.notes) == slower
    assert not list(tmp_path.iterdir())  # MuJoCo writes a log of its warnings where it works
    assert capfd.readouterr() == ("", "")


def test_efforts_that_no_time_step_resolves_are_named() -> None:
    conversion = convert(finger("1e9"))
    assert any("far too large for its masses" in note for note in conversion.notes)
    assert conversion.spec.option.timestep == 0.004


@pytest.mark.parametrize(("effort", "velocity"), [(87.0, 2.2), (24.0, 30.0), (5.0, 100.0), (300.0, 10.0)])
@pytest.mark.parametrize("name", ['name="j"', ""])
def test_full_effort_leads_to_the_velocity_limit(effort: float, velocity: float, name: str) -> None:
    inertia = '<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>'
    link = f'<link name="{{}}"><inertial><mass value="1"/>{inertia}</inertial></link>'
    limit = f'<limit lower="-1e4" upper="1e4" effort="{effort}" velocity="{velocity}"/>'
    joint = f'<joint {name} type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>{limit}</joint>'
    text = f'<robot name="r">{link.format("a")}{link.format("b")}{joint}</robot>'
    model = convert(Description("r", "r.urdf", "urdf", text.encode())).spec.compile()
    data = mujoco.MjData(model)
    data.ctrl[0] = effort
    mujoco.mj_step(model, data, nstep=2000)
    reached = min(velocity, effort / 0.1)  # the linear part alone holds a weak motor back
    assert data.qvel[0] == pytest.approx(reached, rel=0.02)


@pytest.mark.parametrize(("effort", "velocity"), [("1e300", "1e-300"), ("inf", "1"), ("1", "inf"), ("nan", "1")])
def test_odd_limits_give_finite_damping(effort: str, velocity: str) -> None:
    robot = finger(effort)
    source = robot.source.replace(b'velocity="1000"', f'velocity="{velocity}"'.encode())
    body = "<body><joint name='j0'/><geom size='1'/></body>"
    spec = mujoco.MjSpec.from_string(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    settle_urdf(spec, replace(robot, source=source))
    assert np.isfinite(spec.joint("j0").damping).all()
    spec.compile()
