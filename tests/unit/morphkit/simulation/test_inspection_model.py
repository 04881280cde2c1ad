"""Models of robots with parts missing: their shapes, masses, floor, colors and base joints."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import pytest

from morphkit.description import Description
from morphkit.registry import load
from morphkit.simulation.inspection_model import base_joints, load_mechanics
from morphkit.simulation.limb_inertia import limb_masses
from morphkit.simulation.visual_geoms import geom_color, visible_geoms
from tests.support.small_robots import BOX, JOINT, LINK, MESH, arm, mjcf, urdf


def shapes(description: Description, body: str) -> list[str]:
    """Kinds of a body's visible shapes."""
    model = load_mechanics(description).model
    own = [geom for geom in visible_geoms(model) if model.body(model.geom_bodyid[geom]).name == body]
    return [mujoco.mjtGeom(model.geom_type[geom]).name.removeprefix("mjGEOM_").lower() for geom in own]


def test_limbs_without_shapes_are_sticks_to_their_children() -> None:
    assert shapes(arm(), "b") == ["sphere", "capsule"]
    assert shapes(arm(), "a") == ["box"]
    masses = limb_masses(load_mechanics(arm()))
    assert [mass.mass for mass in masses.values() if mass] == [1.0, 1.0, 1.0]


def test_collision_shapes_stand_in_for_missing_meshes() -> None:
    both = BOX.format("collision") + MESH.format("visual", "gone.stl")
    assert shapes(arm(both), "b") == ["box"]
    mechanics = load_mechanics(arm(both))
    assert ["gone.stl" in note for note in mechanics.notes] == [True]
    seen = BOX.format("visual") + MESH.format("collision", "gone.stl")
    assert shapes(arm(seen), "b") == ["box"]


def test_broken_meshes_and_impossible_inertias_are_left_out_and_noted(tmp_path: Path) -> None:
    (tmp_path / "broken.stl").write_bytes(b"\0" * 84)
    robot = replace(arm(MESH.format("visual", "broken.stl")), folder=tmp_path)
    mechanics = load_mechanics(robot)
    assert len(mechanics.notes) == 1
    assert "broken" in mechanics.notes[0]
    bad = replace(arm(), source=arm().source.replace(b'ixx=".1"', b'ixx="-1"', 1))
    mechanics = load_mechanics(bad)
    assert "inertia of 'a'" in mechanics.notes[0]
    assert limb_masses(mechanics)["a"] is None
    assert limb_masses(mechanics)["b"] is not None


def test_masses_of_fixed_links_belong_to_the_limb() -> None:
    robot = urdf(LINK.format("a", ""), LINK.format("b", ""), JOINT.format("ab", "fixed", "a", "b", ""))
    mass = limb_masses(load_mechanics(robot))["a"]
    assert mass is not None
    assert mass.mass == 2.0
    assert mass.center == pytest.approx((0, 0, 0.25))
    assert mass.moments == pytest.approx((0.2, 0.2 + 2 * 0.25**2, 0.2 + 2 * 0.25**2))


@pytest.mark.parametrize("name", ["cheetah", "arm"])
def test_masses_agree_with_the_simulator(name: str) -> None:
    from morphkit.simulation.build import build_simulation

    model = build_simulation(load(name)).model
    masses = limb_masses(load_mechanics(load(name), shapes=False))
    assert sum(mass.mass for mass in masses.values() if mass) == pytest.approx(model.body_mass.sum(), rel=1e-12)


def test_the_floor_is_right_below_the_robot() -> None:
    mechanics = load_mechanics(arm(BOX.format("visual"), BOX.format("visual")))
    assert mechanics.model.geom("morphkit_floor").pos[2] == pytest.approx(-0.2)
    data = mujoco.MjData(mechanics.model)
    mujoco.mj_kinematics(mechanics.model, data)
    assert data.geom("morphkit_floor").xpos[2] == pytest.approx(-0.2)


def test_colors_of_the_file_are_kept_and_others_tell_limbs_apart() -> None:
    model = load_mechanics(mjcf("<body name='x'><joint/><geom name='g' size='.1' rgba='1 0.5 0.25 1'/></body>")).model
    assert geom_color(model, model.geom("g").id) == pytest.approx([1, 0.5, 0.25, 1])
    plain = load_mechanics(arm(BOX.format("visual"), BOX.format("visual"))).model
    colors = {tuple(geom_color(plain, geom)) for geom in visible_geoms(plain) if plain.geom_bodyid[geom] > 0}
    assert len(colors) == 3


def test_base_joints() -> None:
    assert [joint.name for joint in base_joints(load_mechanics(load("cheetah")))] == ["rootx", "rootz", "rooty"]
    assert base_joints(load_mechanics(arm())) == ()


def test_what_the_compiler_would_leave_out_is_looked_at_all_the_same() -> None:
    shown = '<geom size=".05" contype="0" conaffinity="0"/>'
    body = f'<body name="arm"><joint/><geom size=".1"/>{shown}<body name="tip"><geom size=".02"/></body></body>'
    plain = load_mechanics(mjcf(body)).model
    fused = load_mechanics(mjcf(body, '<compiler fusestatic="true" discardvisual="true"/>')).model
    assert (fused.nbody, fused.ngeom) == (plain.nbody, plain.ngeom)
