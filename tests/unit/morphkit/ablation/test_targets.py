from __future__ import annotations

import time

import pytest

from morphkit.ablation.ablate import ablate
from morphkit.description import Description
from morphkit.errors import AblationError, UnknownNameError
from morphkit.readers import read
from morphkit.registry import load


def test_keep_leaves_limbs_and_what_connects_them_to_the_root():
    variant = ablate(load("cheetah"), keep=["fshin"])
    assert variant.limbs == ("torso", "fthigh", "fshin")
    assert variant.removed == ("bthigh", "bshin", "bfoot", "ffoot")
    assert variant.description.name == "cheetah-only-fshin"
    assert [limb.name for limb in read(variant.description).limbs] == list(variant.limbs)


def test_keep_combines_with_the_others():
    cheetah = load("cheetah")
    variant = ablate(cheetah, keep=["foot"], splice=["fshin"])
    assert variant.spliced == ("fshin",)
    assert variant.removed == ()
    assert variant.description.name == "cheetah-only-foot-no-fshin"
    variant = ablate(cheetah, keep=["bshin", "fthigh"], remove=["ffoot"])
    assert variant.limbs == ("torso", "bthigh", "bshin", "fthigh")
    quadruped = ablate(load("quadruped"), keep=["FL_foot"])
    assert quadruped.limbs == ("trunk", "FL_hip", "FL_thigh", "FL_calf")
    assert b'<link name="FL_foot">' in quadruped.description.source


def test_the_root_can_be_kept():
    assert ablate(load("cheetah"), keep=["torso"]).limbs == ("torso",)
    everything = ablate(load("cheetah"), keep=["*"])
    assert everything.removed == ()
    assert everything.description.source == load("cheetah").source


def test_repeated_and_combined_cuts_are_one_variant():
    variant = ablate(load("cheetah"), remove=["bfoot", "ffoot", "bshin"], splice=["fshin", "fthigh"])
    assert variant.removed == ("bshin", "bfoot", "ffoot")
    assert variant.spliced == ("fthigh", "fshin")
    assert variant.limbs == ("torso", "bthigh")


@pytest.mark.parametrize(
    ("wish", "message"),
    [
        ({"keep": ["bfoot"], "remove": ["bfoot"]}, "bfoot cannot be both kept and removed"),
        ({"keep": ["bfoot"], "splice": ["bfoot"]}, "bfoot cannot be both kept and spliced"),
        ({"keep": ["bfoot"], "remove": ["bthigh"]}, "bthigh cannot be removed, because limbs to keep hang on it"),
    ],
)
def test_wishes_that_contradict_each_other(wish, message):
    with pytest.raises(AblationError, match=message):
        ablate(load("cheetah"), **wish)


def test_a_limb_on_a_removed_fixed_body_cannot_be_kept():
    source = b"""<mujoco><worldbody><body name="base"><geom size=".1"/><body name="mount"><geom size=".1"/>
    <body name="arm"><joint/><geom size=".1"/></body></body></body></worldbody></mujoco>"""
    with pytest.raises(AblationError, match="arm cannot be kept, because what it hangs on is removed"):
        ablate(Description("r", "r.xml", "mjcf", source), keep=["arm"], remove=["mount"])


def test_keep_of_what_does_not_exist():
    with pytest.raises(UnknownNameError, match="did you mean 'bfoot'"):
        ablate(load("cheetah"), keep=["bfot"])


MESHES = b"""<mujoco><asset>
    <texture name="wood" type="2d" builtin="flat" width="4" height="4"/>
    <texture name="sky" type="skybox" builtin="flat" width="4" height="4"/>
    <texture name="paint" type="2d" builtin="flat" width="4" height="4"/>
    <material name="oak" texture="wood"/>
    <material name="red"/>
    <material name="spare"/>
    <material name="layered"><layer texture="paint" role="rgb"/></material>
    <mesh file="meshes/hand.obj" material="red"/>
    <mesh name="box" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/>
    <hfield name="hill" nrow="2" ncol="2" size="1 1 1 1"/>
  </asset><worldbody><body name="base"><geom type="mesh" mesh="box"/>
    <body name="arm"><joint/><geom type="mesh" mesh="box"/>
      <body name="hand"><joint/><geom type="mesh" mesh="hand" material="oak"/><site material="layered"/></body>
    </body></body></worldbody></mujoco>"""


def test_assets_that_only_removed_limbs_used_stay_unless_asked_to_go():
    robot = Description("r", "r.xml", "mjcf", MESHES)
    assert ablate(robot, remove=["hand"]).description.source.count(b"<m") == MESHES.count(b"<m")
    variant = ablate(robot, remove=["hand"], drop_assets=True)
    dropped = [(loss.kind, loss.name) for loss in variant.lost if loss.reason == "only removed limbs used it"]
    assert sorted(dropped) == [
        ("material", "layered"), ("material", "oak"), ("material", "red"), ("mesh", "hand"), ("texture", "paint"),
        ("texture", "wood"),
    ]  # fmt: skip
    for left in (b'name="sky"', b'name="spare"', b'name="box"', b'name="hill"'):
        assert left in variant.description.source


def test_materials_of_a_urdf_go_when_asked():
    source = b"""<robot name="r"><material name="red"><color rgba="1 0 0 1"/></material>
  <material name="blue"><color rgba="0 0 1 1"/></material>
  <link name="base"><visual><geometry><sphere radius="1"/></geometry><material name="blue"/></visual></link>
  <link name="arm"><visual><geometry><sphere radius="1"/></geometry><material name="red"/></visual></link>
  <joint name="j" type="continuous"><parent link="base"/><child link="arm"/></joint></robot>"""
    variant = ablate(Description("r", "r.urdf", "urdf", source), remove=["arm"], drop_assets=True)
    assert b'name="red"' not in variant.description.source
    assert variant.description.source.count(b'name="blue"') == 2


def test_a_glob_on_a_chain_of_thousands_of_links_takes_no_quadratic_time():
    parts = ['<link name="base"/>']
    for i in range(4000):
        parent = f"c{i - 1}" if i else "base"
        parts.append(
            f'<link name="c{i}"/><joint name="j{i}" type="continuous">'
            f'<parent link="{parent}"/><child link="c{i}"/></joint>'
        )
    robot = Description("chain", "chain.urdf", "urdf", f'<robot name="chain">{"".join(parts)}</robot>'.encode())
    start = time.process_time()
    variant = ablate(robot, remove=["c*"])
    assert time.process_time() - start < 15
    assert variant.description.name == "chain-no-c0"
    assert variant.limbs == ("base",)
