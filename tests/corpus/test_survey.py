"""The corpus program itself, on one small robot."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.corpus.survey import Plan, survey
from tests.support.small_urdfs import AXIS, INERTIAL, LIMIT, joint, link, robot

MESH = '<collision><geometry><mesh filename="{0}.stl"/></geometry></collision>'
NAMES = ("base", "thigh", "shin", "foot")


@pytest.mark.parametrize(("cuts", "cut"), [(9, 3), (2, 2)])
def test_a_robot_without_its_meshes_is_read_refused_and_compared_mesh_free(cuts: int, cut: int, tmp_path: Path) -> None:
    links = (link(name, INERTIAL + MESH.format(name)) for name in NAMES)
    joints = (joint(f"j{n}", NAMES[n - 1], NAMES[n], AXIS + LIMIT) for n in range(1, 4))
    (tmp_path / "r.urdf").write_text(robot(*links, *joints))
    (outcome,) = survey(str(tmp_path / "r.urdf"), Plan(tmp_path, ("convert", "cut"), cuts))
    assert (outcome.result, outcome.limbs, outcome.cut) == ("tokens", 4, cut)
    assert "base.stl' not found" in outcome.refused
    assert "base.stl' not found" in outcome.forms["meshes"]
    assert outcome.compared == {"mesh-free": cut}
    assert not outcome.different
    assert not outcome.uncompared
    assert not outcome.contradiction
