"""Triangles of MuJoCo's shapes enclose as much as the shapes do."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from morphkit.viewer.geom_meshes import surface


@pytest.mark.parametrize(
    ("geom", "volume"),
    [
        ("type='sphere' size='.5'", 4 / 3 * np.pi * 0.125),
        ("type='ellipsoid' size='.5 .25 1'", 4 / 3 * np.pi * 0.125),
        ("type='box' size='.5 .25 1'", 1.0),
        ("type='cylinder' size='.5 1'", 2 * np.pi * 0.25),
        ("type='capsule' size='.5 1'", 2 * np.pi * 0.25 + 4 / 3 * np.pi * 0.125),
    ],
)
def test_surfaces_enclose_the_shape(geom: str, volume: float) -> None:
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody><geom {geom}/></worldbody></mujoco>")
    mesh = surface(model, 0)
    assert mesh.volume == pytest.approx(volume, rel=0.03)
    assert mesh.bounds.mean(axis=0) == pytest.approx([0, 0, 0], abs=1e-6)


def test_meshes_keep_their_triangles_and_planes_have_none() -> None:
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><asset><mesh name='m' vertex='0 0 0 1 0 0 0 1 0 0 0 1'/></asset><worldbody>"
        "<geom type='mesh' mesh='m'/><geom type='plane' size='1 1 1'/></worldbody></mujoco>"
    )
    assert surface(model, 0).volume == pytest.approx(1 / 6)
    assert surface(model, 1) is None
