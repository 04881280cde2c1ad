from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from morphkit.ablation.ablate import Loss, ablate
from morphkit.description import Description
from morphkit.errors import AblationError, AssetError, UnknownNameError
from morphkit.families.enumeration import sub_morphologies
from morphkit.readers import read
from morphkit.registry import load, shipped

DATA = Path(__file__).parents[3] / "data"

WALKER = b"""<mujoco model="everything">
  <compiler autolimits="true"/>
  <worldbody>
    <camera name="watch" mode="targetbody" target="calf" pos="3 0 1"/>
    <light name="spot" mode="targetbodycom" target="hip" pos="0 0 4"/>
    <body name="marker" mocap="true" pos="0 0 3"><geom size=".1"/></body>
    <body name="root" pos="0 0 1">
      <freejoint name="free"/>
      <geom name="trunk" size=".1"/>
      <site name="navel"/>
      <body name="hip" pos="0 0 .1">
        <joint name="hip" axis="0 1 0"/>
        <geom name="hip" size=".1"/>
        <site name="thigh_site" pos=".1 0 0"/>
        <camera name="knee_cam"/>
        <body name="calf" pos=".1 0 0">
          <joint name="ankle" type="ball"/>
          <geom name="calf" size=".1"/>
          <site name="calf_site"/>
        </body>
      </body>
      <body name="arm" pos="0 .1 .1">
        <joint name="arm" axis="0 1 0"/>
        <geom name="arm" size=".1"/>
        <site name="arm_site" pos=".1 0 0"/>
      </body>
    </body>
  </worldbody>
  <contact>
    <pair name="clap" geom1="arm" geom2="calf"/>
    <pair name="clap2" geom1="arm" geom2="hip"/>
    <exclude name="never" body1="root" body2="calf"/>
  </contact>
  <equality>
    <weld name="glue" body1="arm" body2="calf" active="false"/>
    <connect name="pin" site1="arm_site" site2="thigh_site" active="false"/>
    <tendon name="taut" tendon1="long" tendon2="short" active="false"/>
  </equality>
  <tendon>
    <spatial name="long"><site site="thigh_site"/><site site="calf_site"/><site site="arm_site"/></spatial>
    <fixed name="mixed"><joint joint="hip" coef="1"/><joint joint="arm" coef="1"/></fixed>
    <spatial name="short"><site site="navel"/><site site="arm_site"/></spatial>
  </tendon>
  <actuator>
    <motor name="hip_motor" joint="hip"/>
    <motor name="long_motor" tendon="long"/>
    <general name="arm_motor" joint="arm" dyntype="integrator"/>
    <general name="slow_hip" joint="hip" dyntype="filter" dynprm="1"/>
    <pid name="arm_pid" joint="arm" kp="1" kv="1" ki="1" input="pos vel"/>
  </actuator>
  <sensor>
    <jointpos name="hip_angle" joint="hip"/>
    <actuatorfrc name="pull" actuator="long_motor"/>
    <framepos name="reach" objtype="site" objname="arm_site" reftype="xbody" refname="calf"/>
    <subtreecom name="com" body="root"/>
    <user name="note" dim="1" objtype="body" objname="hip"/>
    <camprojection name="seen" site="navel" camera="knee_cam"/>
  </sensor>
  <custom>
    <tuple name="both"><element objtype="body" objname="calf" prm="0"/><element objtype="body" objname="arm"/></tuple>
    <tuple name="one"><element objtype="body" objname="arm" prm="0"/></tuple>
    <numeric name="joint" data="1"/>
  </custom>
  <keyframe>
    <key name="stand" qpos="0 0 1 1 0 0 0 .1 1 0 0 0 .2" qvel="0 0 0 0 0 0 .1 .2 .3 .4 .5"/>
    <key name="go" time="1" mpos="1 2 3"/>
  </keyframe>
</mujoco>
"""


def mjcf(source: bytes, **options: object) -> Description:
    return Description("robot", "robot.xml", "mjcf", source, **options)


def kinds(lost: tuple[Loss, ...]) -> set[tuple[str, str]]:
    return {(loss.kind, loss.name) for loss in lost}


def delete(spec: mujoco.MjSpec, names: list[str]) -> mujoco.MjModel:
    """What MuJoCo makes of the source without the bodies `names`; none of them may lie below another."""
    for name in names:
        spec.delete(spec.body(name))
    return spec.compile()


@pytest.mark.parametrize("name", [robot.name for robot in shipped()])
def test_every_sub_morphology_compiles_to_what_mujoco_makes_by_deleting_bodies(name, plain_spec, differences):
    robot = load(name)
    morphology = read(robot)
    count = 0
    for variant in sub_morphologies(robot):
        tops = [limb for limb in variant.removed if morphology.limb(limb).parent not in variant.removed]
        expected = delete(plain_spec(robot), tops)
        assert differences(plain_spec(variant.description).compile(), expected) == [], variant.description.name
        count += 1
    assert count >= 3


@pytest.mark.parametrize("name", ["calf", "hip", "arm"])
def test_whatever_refers_to_a_limb_goes_as_with_mjspec_delete(name, plain_spec, differences):
    robot = mjcf(
        WALKER.replace(b'mode="targetbody" target="calf"', b"").replace(b'mode="targetbodycom" target="hip"', b"")
    )
    robot = Description("robot", "robot.xml", "mjcf", robot.source, root="root")
    assert (
        differences(plain_spec(ablate(robot, remove=[name]).description).compile(), delete(plain_spec(robot), [name]))
        == []
    )


def test_every_loss_is_recorded_with_its_limb_and_reason():
    lost = ablate(mjcf(WALKER, root="root"), remove=["hip"]).lost
    assert kinds(lost) == {
        ("joint", "hip"), ("site", "thigh_site"), ("camera", "knee_cam"), ("joint", "ankle"), ("site", "calf_site"),
        ("pair", "clap"), ("pair", "clap2"), ("exclude", "never"), ("equality", "glue"), ("equality", "pin"),
        ("equality", "taut"), ("tendon", "long"), ("tendon", "mixed"), ("actuator", "hip_motor"),
        ("actuator", "long_motor"), ("actuator", "slow_hip"), ("sensor", "hip_angle"), ("sensor", "pull"),
        ("sensor", "reach"), ("sensor", "note"), ("sensor", "seen"), ("tuple", "both"), ("camera", "watch"),
        ("light", "spot"), ("keyframe", "stand"),
    }  # fmt: skip
    by_name = {(loss.kind, loss.name): loss for loss in lost}
    assert by_name["exclude", "never"] == Loss("exclude", "never", "calf", "refers to body calf")
    assert by_name["sensor", "pull"].reason == "refers to actuator long_motor"
    assert by_name["equality", "taut"].reason == "refers to tendon long"
    assert by_name["keyframe", "stand"].reason == "resized: qpos lost 5 of 13 values, qvel lost 4 of 11 values"


def test_cameras_and_lights_stay_without_their_target(plain_spec):
    variant = ablate(mjcf(WALKER, root="root"), remove=["hip"])
    model = plain_spec(variant.description).compile()
    assert model.camera("watch").mode == mujoco.mjtCamLight.mjCAMLIGHT_FIXED
    assert model.camera("watch").targetbodyid == -1
    assert model.light("spot").mode == mujoco.mjtCamLight.mjCAMLIGHT_FIXED


def test_keyframes_lose_activations_and_controls_too(plain_spec, differences):
    whole = plain_spec(mjcf(WALKER.replace(b'mode="targetbody" target="calf"', b""))).compile()
    ctrl, act = " ".join(map(str, range(whole.nu))), " ".join(map(str, range(10, 10 + whole.na)))
    source = WALKER.replace(b'<key name="go"', f'<key name="go" ctrl="{ctrl}" act="{act}"'.encode())
    model = plain_spec(ablate(mjcf(source, root="root"), remove=["hip"]).description).compile()
    kept = [control for control in range(whole.nu) if not is_hip(whole, control)]
    assert kept
    assert list(model.key("go").ctrl) == kept
    assert model.na < whole.na
    assert list(model.key("go").act) == [10 + index for index in range(whole.na) if index not in {1}]


def is_hip(model: mujoco.MjModel, control: int) -> bool:
    owner = int(np.searchsorted(model.actuator_ctrladr, control, side="right")) - 1
    return model.actuator(owner).name in {"hip_motor", "long_motor", "slow_hip"}


def test_skins_and_flexes_go_whole(plain_spec):
    skin = (
        b'<deformable><skin name="suit" vertex="0 0 0 1 0 0 0 1 0" face="0 1 2"><bone body="hip" bindpos="0 0 0" '
        b'bindquat="1 0 0 0" vertid="0 1" vertweight="1 1"/><bone body="arm" bindpos="0 0 0" bindquat="1 0 0 0" '
        b'vertid="1 2" vertweight="1 1"/></skin><flex name="cloth" dim="2" body="hip arm root" radius=".01" '
        b'vertex="0 0 0 1 0 0 0 1 0" element="0 1 2"/></deformable><contact>'
    )
    variant = ablate(mjcf(WALKER.replace(b"<contact>", skin), root="root"), remove=["hip"])
    assert {("skin", "suit"), ("flex", "cloth")} <= kinds(variant.lost)
    assert plain_spec(variant.description).compile().nflex == 0


def test_what_a_cut_does_not_touch_survives_byte_for_byte():
    source = b"""<?xml version='1.0'?>\r\n<!-- before -->\r\n<mujoco   model = 'odd'>\r
  <unknown_extension about="nothing"/>\r
  <!-- a > b & <tags> -->\r
  <worldbody>\r
    <body name='root'\r
          pos = "0  0 1">   <!-- same line -->\r
      <geom size='.1'/>\r
      <body name="leg"><joint name="leg"/><geom size=".1"/></body> <!-- the leg -->\r
      <body\tname="arm"><joint name="arm"/><geom size=".1"/><user text="a&gt;b"/></body>\r
    </body>\r
  </worldbody>\r
  <actuator>\r
    <motor name="leg"\r
           joint="leg"/>\r
    <!-- drives the arm -->\r
    <motor name="arm"\r
           joint="arm"/>\r
  </actuator>\r
</mujoco>\r\n<!-- after -->\r\n"""
    source = source.replace(b'  <unknown_extension about="nothing"/>\r\n', b"").replace(b'<user text="a&gt;b"/>', b"")
    variant = ablate(mjcf(source), remove=["leg"])
    expected = source.replace(b'<body name="leg"><joint name="leg"/><geom size=".1"/></body> ', b"")
    expected = expected.replace(b'    <motor name="leg"\r\n           joint="leg"/>\r\n', b"")
    assert variant.description.source == expected


def test_a_cut_removes_lines_and_changes_none():
    for robot in shipped():
        for variant in sub_morphologies(robot, limit=5):
            rest = iter(robot.source.splitlines())
            left = [line for line in variant.description.source.splitlines() if b"<key " not in line]
            assert all(line in rest for line in left), variant.description.name


def test_patterns_are_names_globs_and_types():
    cheetah = load("cheetah")
    by_type, by_glob = ablate(cheetah, remove=["foot"]), ablate(cheetah, remove=["?foot"])
    assert by_type.removed == by_glob.removed == ("bfoot", "ffoot")
    assert by_type.description.source == by_glob.description.source
    assert by_type.description.name == "cheetah-no-foot"
    assert by_glob.description.name == "cheetah-no-bfoot-ffoot"
    assert ablate(cheetah, remove=["ffoot", "bfoot"]).description.name == "cheetah-no-ffoot-bfoot"
    assert ablate(cheetah, remove=["b*"]).description.name == "cheetah-no-bthigh"


def test_names_of_files_are_safe():
    variant = ablate(load("cheetah"), remove=["foot"], name="../x y" + "z" * 400)
    assert variant.description.name.startswith("../x y")
    assert "/" not in variant.description.file
    assert " " not in variant.description.file
    assert len(variant.description.file) < 200


def test_the_root_cannot_go():
    with pytest.raises(AblationError, match="the root of 'cheetah', which cannot be removed"):
        ablate(load("cheetah"), remove=["torso"])
    with pytest.raises(AblationError, match="root"):
        ablate(load("cheetah"), splice=["*"])


def test_an_unknown_limb_names_the_nearest():
    with pytest.raises(UnknownNameError, match="did you mean 'bfoot'"):
        ablate(load("cheetah"), remove=["bfot"])


def test_a_limb_cannot_be_removed_and_spliced():
    with pytest.raises(AblationError, match="cannot be both removed and spliced"):
        ablate(load("cheetah"), remove=["bshin"], splice=["bshin"])


def test_the_info_carries_the_sources_canonical_names():
    cheetah = load("cheetah")
    variant = ablate(cheetah, remove=["bthigh"])
    assert variant.description.info.canonical["bfoot"] == "back foot"
    assert variant.description.info.type_words == cheetah.info.type_words
    assert variant.description.info.expert_return is None


REPLICATED = b"""<mujoco><worldbody><body name="hub"><geom size=".1"/><replicate count="3" euler="0 0 90" sep="-">
<body name="leg" pos="1 0 0.123456789"><joint name="hip"/><geom size=".1"/><body name="toe"><joint name="toe"/>
<geom size=".1"/></body></body></replicate></body></worldbody>
<actuator><motor joint="hip-0"/><motor joint="hip-1"/><motor joint="toe-1"/></actuator></mujoco>"""


def test_replicated_limbs_are_cut_in_mujocos_output(plain_spec, differences):
    robot = mjcf(REPLICATED)
    variant = ablate(robot, remove=["leg-1"])
    assert variant.limbs == ("hub", "leg-0", "toe-0", "leg-2", "toe-2")
    assert [loss.kind for loss in variant.lost if loss.kind == "format"] == ["format"]
    expected = delete(plain_spec(robot), ["leg-1"])
    left = [name for name in differences(plain_spec(variant.description).compile(), expected) if "name" not in name]
    assert left == []


def test_included_files_are_written_into_the_variant(tmp_path, plain_spec):
    (tmp_path / "legs.xml").write_text(
        '<mujocoinclude><body name="a"><joint name="a"/><geom size=".1"/></body><!-- kept -->'
        '<body name="b"><joint name="b"/><geom size=".1"/></body></mujocoinclude>'
    )
    main = b'<mujoco><worldbody><body name="r"><geom size=".1"/><include file="legs.xml"/></body></worldbody></mujoco>'
    for remove in (["a"], []):
        variant = ablate(mjcf(main, folder=tmp_path), remove=remove)
        assert b"include file" not in variant.description.source
        assert b"<!-- kept -->" in variant.description.source
        assert variant.lost[0].kind == "format"
        assert plain_spec(variant.description).compile().nbody == 4 - len(remove)


def test_unnamed_bodies_keep_the_names_that_their_tokens_have():
    source = b"""<mujoco><worldbody><body name="r"><geom size=".1"/><body><joint/><geom size=".1"/></body>
    <body><joint/><geom size=".1"/></body></body></worldbody></mujoco>"""
    limbs = [limb.name for limb in read(mjcf(source)).limbs]
    variant = ablate(mjcf(source), remove=[limbs[1]])
    assert [limb.name for limb in read(variant.description).limbs] == ["r", limbs[2]] == list(variant.limbs)
    assert ("name", limbs[2]) in kinds(variant.lost)


def test_a_missing_mesh_does_not_matter_to_a_cut():
    source = WALKER.replace(b"<contact>", b'<asset><mesh name="m" file="gone.stl"/></asset><contact>', 1)
    source = source.replace(b'<geom name="arm" size=".1"/>', b'<geom name="arm" type="mesh" mesh="m"/>')
    variant = ablate(mjcf(source, root="root"), remove=["hip"])
    assert ("keyframe", "stand") in kinds(variant.lost)
    assert b"gone.stl" in variant.description.source
    with pytest.raises(AssetError, match=r"gone\.stl"):
        ablate(
            mjcf(REPLICATED.replace(b"<actuator>", b'<asset><mesh file="gone.stl"/></asset><actuator>')),
            remove=["leg-1"],
        )
