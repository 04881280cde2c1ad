"""What the corpus holds a cut to finds what it should."""

from __future__ import annotations

import mujoco
import pytest

from morphkit.ablation.ablate import ablate
from morphkit.description import Description
from tests.corpus.compare import differences, missing_names, spec_of, without_body
from tests.corpus.source import foreign_lines, unexplained

ARM = b"""<mujoco>
  <asset><material name="red"/></asset>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 1"/>
    <body name="base"><geom size="1"/><camera name="eye" mode="targetbody" target="hand"/>
      <body name="hand" pos="0 0 1"><joint name="wrist"/><geom name="palm" size="1"/></body>
      <body name="tail" pos="0 0 -1"><joint name="wag"/><geom size="1" mass="2"/></body>
    </body>
  </worldbody>
  <actuator><motor joint="wrist"/><motor joint="wag"/></actuator>
  <keyframe><key qpos="1 2"/></keyframe>
</mujoco>
"""


@pytest.fixture
def cut():
    robot = Description("arm", "arm.xml", "mjcf", ARM)
    return robot, ablate(robot, remove=["hand"])


def test_a_clean_cut_has_nothing_to_explain(cut):
    robot, variant = cut
    assert unexplained(ARM, variant.description.source, {"hand"}, variant.lost) == []
    assert foreign_lines(ARM, variant.description.source) == 0
    expected = without_body(robot, "hand", "meshes")
    assert differences(spec_of(variant.description, "meshes").compile(), expected, by_geom=False) == []


@pytest.mark.parametrize(
    ("gone", "by"),
    [
        (b'<material name="red"/>', b""),
        (b'<geom name="floor" type="plane" size="1 1 1"/>', b""),
        (b'<motor joint="wag"/>', b""),
        (b'mass="2"', b'mass="3"'),
    ],
)
def test_what_goes_without_a_word_is_found(cut, gone, by):
    variant = cut[1]
    assert gone in variant.description.source
    assert len(unexplained(ARM, variant.description.source.replace(gone, by), {"hand"}, variant.lost)) == 1


def test_what_is_new_is_found(cut):
    source = cut[1].description.source
    assert foreign_lines(ARM, source.replace(b"  <actuator>", b"  <!-- new -->\n  <actuator>")) == 1


def test_other_models_differ(cut):
    robot, variant = cut
    heavier = variant.description.source.replace(b'mass="2"', b'mass="2.00001"')
    model = mujoco.MjSpec.from_string(heavier.decode()).compile()
    assert "body_mass" in differences(model, without_body(robot, "hand", "meshes"), by_geom=False)


def test_a_robot_that_does_not_compile_is_compared_mesh_free():
    source = ARM.replace(b'name="palm" size="1"', b'name="palm" material="none"')
    source = source.replace(b'<geom size="1"/><camera', b'<geom type="capsule" size="1 0"/><camera')
    robot = Description("arm", "arm.xml", "mjcf", source)
    with pytest.raises(ValueError, match="material 'none' not found"):
        spec_of(robot, "meshes").compile()
    with pytest.raises(ValueError, match="size 1 must be positive"):
        without_body(robot, "hand", "meshes")
    for limb in ("hand", "tail"):
        variant = ablate(robot, remove=[limb])
        expected = without_body(robot, limb, "mesh-free")
        assert expected.nbody == 3
        assert (
            differences(
                spec_of(variant.description, "mesh-free", missing_names(robot)).compile(), expected, by_geom=False
            )
            == []
        )
