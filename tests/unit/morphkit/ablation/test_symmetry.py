from __future__ import annotations

import numpy as np
import pytest

from morphkit.ablation.ablate import Cutter, ablate
from morphkit.ablation.symmetry import counterparts, swapped
from morphkit.description import Description
from morphkit.errors import AblationError
from morphkit.families.enumeration import plan_family, sub_morphologies
from morphkit.morphology import Joint, Limb, Morphology
from morphkit.registry import load


def robot(**limbs: tuple[str | None, tuple[float, float, float]]) -> tuple[Morphology, dict[str, np.ndarray]]:
    """A robot of hinged limbs, each with its parent and its place in the root's frame."""
    hinge = (Joint("joint", "hinge", False, 0.0, 0.0),)
    made = tuple(Limb(name, parent, hinge if parent else (), (name,)) for name, (parent, _) in limbs.items())
    morphology = Morphology("robot", "robot.xml", "mjcf", "", "fixed", None, None, (), made, ())
    return morphology, {name: np.array(place) for name, (_, place) in limbs.items()}


@pytest.mark.parametrize(
    ("name", "other"),
    [
        ("left_foot", "right_foot"),
        ("LeftFoot", "RightFoot"),
        ("arm_LEFT_1", "arm_RIGHT_1"),
        ("FL_hip", "FR_hip"),
        ("lf_leg", "rf_leg"),
        ("RRleg", "RLleg"),
        ("lfemur", "rfemur"),
        ("LHipYaw", "RHipYaw"),
        ("upper_leg_L", "upper_leg_R"),
        ("hand_l", "hand_r"),
        ("l_toe_l", "r_toe_l"),
        ("thigh_left", "thigh"),
        ("right_back_leg", "back_leg"),
        ("gripper_left_left_finger", "gripper_right_right_finger"),
        ("gripper_left_left_finger", "gripper_left_right_finger"),
        ("l_gripper_l_finger", "r_gripper_r_finger"),
        ("motor_front_rightR", "motor_front_leftR"),
    ],
)
def test_names_of_the_other_side(name, other):
    assert other in list(swapped(name))


@pytest.mark.parametrize("name", ["torso", "hip_yaw"])
def test_names_without_a_side(name):
    morphology, _ = robot(base=(None, (0, 0, 0)), **{name: ("base", (0, 0, 0))})
    assert counterparts(morphology, {}) == {"base": "base", name: name}


def test_shipped_robots():
    image = Cutter(load("quadruped")).counterparts(strict=True)
    assert image["FL_calf"] == "FR_calf"
    assert image["RR_foot"] == "RL_foot"
    assert image["trunk"] == "trunk"
    cheetah = Cutter(load("cheetah")).counterparts(strict=True)
    assert all(name == other for name, other in cheetah.items())
    assert Cutter(load("walker")).counterparts(strict=True)["left2"] == "right2"


def test_the_place_decides_where_names_agree():
    legs = {"base": (None, (0, 0, 0)), "left_leg": ("base", (0.3, 0.2, 0)), "left_foot": ("left_leg", (0.3, 0.2, -1))}
    morphology, places = robot(**legs, right_leg=("base", (0.3, -0.2, 0)), right_foot=("right_leg", (0.3, -0.2, -1)))
    assert counterparts(morphology, places)["left_foot"] == "right_foot"
    places["right_foot"] = np.array([0.3, -0.2, -0.5])
    assert "left_foot" not in counterparts(morphology, places)
    places["right_foot"] = np.array([0.3, -1.2, 0])  # a like leg, mounted turned
    assert "left_foot" not in counterparts(morphology, places)
    assert counterparts(morphology, places, strict=False)["left_foot"] == "right_foot"


def test_a_sibling_by_name_goes_before_distance():
    morphology, places = robot(
        base=(None, (0, 0, 0)),
        lift=("base", (0.3, 0.1, 0.2)),
        arm=("lift", (0.6, 0.1, 0.2)),
        gripper_finger_left=("arm", (0.7, 0.1, 0.23)),
        gripper_finger_right=("arm", (0.7, 0.1, 0.16)),
        left_tip=("gripper_finger_left", (0.9, 0.1, 0.23)),
        right_tip=("gripper_finger_right", (0.8, 0.1, 0.16)),
        **{f"{side}_wheel_{i}": ("base", (i, y, 0)) for i in range(3) for side, y in (("left", 0.2), ("right", -0.2))},
        left_eye=("base", (0, 0.1, 0.9)),
        right_eye=("base", (0, -0.1, 0.2)),
        post=("base", (0, -0.1, 0.9)),
    )
    image = counterparts(morphology, places, strict=False)
    assert image["gripper_finger_left"] == "gripper_finger_right"
    assert image["left_tip"] == "right_tip"
    assert image["left_eye"] == "right_eye"
    assert not {"lift", "arm", "post"} & set(image)
    strict = counterparts(morphology, places)
    assert not {"gripper_finger_left", "left_tip"} & set(strict)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("left_ring_proximal", "left_index_proximal"),
        ("l_ring_distal", "l_index_distal"),
        ("ring_distal", "index_distal"),
        ("thumb_tip", "pinky_tip"),
        ("FL_wheel", "RL_wheel"),
        ("front_mast", "rear_mast"),
        ("left_hook", "left_lamp"),
    ],
)
def test_limbs_that_say_the_same_side_or_other_fingers_are_no_images_of_each_other(one, other):
    morphology, places = robot(base=(None, (0, 0, 0)), **{one: ("base", (0, 0.1, 0)), other: ("base", (0, -0.1, 0))})
    for strict in (True, False):
        assert counterparts(morphology, places, strict=strict) == {"base": "base"}


def test_a_finger_of_a_left_hand_has_no_counterpart_on_it():
    part = '<body name="left_{0}_proximal" pos="0 {1} 0"><joint/><geom size=".01"/></body>'
    fingers = "".join(part.format(*each) for each in (("index", 0.03), ("middle", 0.01), ("ring", -0.03)))
    source = f'<mujoco><worldbody><body name="palm"><geom size=".1"/>{fingers}</body></worldbody></mujoco>'
    with pytest.raises(AblationError, match="'left_index_proximal' has no counterpart"):
        ablate(Description("hand", "hand.xml", "mjcf", source.encode()), remove=["left_index_proximal"], mirror=True)


def test_a_roll_axis_is_no_right_side():
    part = '<body name="{0}" pos="0 {1} 0"><joint/><geom size=".01"/></body>'
    limbs = "".join(part.format(*each) for each in (("waist_r", 0.3), ("tail", -0.01)))
    source = f'<mujoco><worldbody><body name="base"><geom size=".1"/>{limbs}</body></worldbody></mujoco>'
    variant = ablate(Description("r", "r.xml", "mjcf", source.encode()), remove=["waist_r"], mirror=True)
    assert variant.removed == ("waist_r",)


def test_the_place_proposes_where_names_say_nothing():
    morphology, places = robot(
        base=(None, (0, 0, 0)),
        rotor_0=("base", (0.2, 0.2, 0)),
        rotor_1=("base", (0.2, -0.2, 0)),
        rotor_2=("base", (-0.2, 0.2, 0)),
        mast=("base", (0, 0.01, 0.3)),
        hook=("base", (0, 0.4, -0.1)),
    )
    assert counterparts(morphology, places) == {
        "base": "base", "rotor_0": "rotor_1", "rotor_1": "rotor_0", "mast": "mast",
    }  # fmt: skip


def test_the_parent_decides_too():
    morphology, places = robot(
        base=(None, (0, 0, 0)),
        left_arm=("base", (0, 0.2, 0)),
        right_arm=("base", (0, -0.2, 0)),
        left_hand=("left_arm", (0, 0.4, 0)),
        right_hand=("base", (0, -0.4, 0)),
    )
    assert "left_hand" not in counterparts(morphology, places)


def test_the_other_side_goes_too():
    variant = ablate(load("quadruped"), remove=["FL_calf"], splice=["RL_hip"], mirror=True)
    assert variant.removed == ("FL_calf", "FR_calf")
    assert variant.spliced == ("RL_hip", "RR_hip")
    assert variant.description.name == "quadruped-no-FL_calf-FR_calf-RL_hip-RR_hip"
    kept = ablate(load("quadruped"), keep=["RR_thigh"], mirror=True)
    assert kept.limbs == ("trunk", "RL_hip", "RL_thigh", "RR_hip", "RR_thigh")
    centered = ablate(load("cheetah"), remove=["bfoot"], mirror=True)
    assert centered.removed == ("bfoot",)


def test_a_limb_without_the_counterpart_that_its_name_promises_is_an_error():
    source = b"""<mujoco><worldbody><body name="base"><geom size=".1"/><body name="left_arm" pos="0 .2 0"><joint/>
    <geom size=".1"/></body></body></worldbody></mujoco>"""
    with pytest.raises(AblationError, match="'left_arm' has no counterpart on the other side: looked for right_arm"):
        ablate(Description("robot", "robot.xml", "mjcf", source), remove=["left_arm"], mirror=True)


def test_mirrored_variants_are_left_out_once():
    quadruped = load("quadruped")
    cutter = Cutter(quadruped)
    image = cutter.counterparts(strict=True)
    everything = {each.name: each for each in plan_family(cutter, min_limbs=9)}
    distinct = list(plan_family(cutter, min_limbs=9, skip_mirrored=True))
    assert [each.name for each in distinct] == list(everything)

    def left(remove: tuple[str, ...]) -> frozenset[str]:
        gone = {limb.name for name in remove for limb in cutter.morphology.subtree(name)}
        return frozenset(limb.name for limb in cutter.morphology.limbs if limb.name not in gone)

    kept = [each for each in distinct if each.mirrors is None]
    shapes = {left(each.remove) for each in kept}
    classes = {
        min(left(r.remove), frozenset(image[n] for n in left(r.remove)), key=sorted) for r in everything.values()
    }
    assert len(kept) == len(shapes) == len(classes) < len(everything)
    for each in distinct:
        if each.mirrors is not None:
            assert frozenset(image[name] for name in left(each.remove)) == left(everything[each.mirrors].remove)
            assert left(everything[each.mirrors].remove) in shapes
    few = [variant.description.name for variant in sub_morphologies(quadruped, limit=3, skip_mirrored=True)]
    assert few == [each.name for each in kept[:3]]


def test_what_has_no_image_keeps_both_variants():
    # The tail on one side makes the two robots without a leg different; without the tail they are alike.
    part = '<body name="{0}" pos="{1}"><joint/><geom size=".1"/></body>'
    limbs = "".join(
        part.format(*each) for each in (("left_leg", "0 .2 0"), ("right_leg", "0 -.2 0"), ("tail", "-1 .5 0"))
    )
    source = f'<mujoco><worldbody><body name="base"><geom size=".1"/>{limbs}</body></worldbody></mujoco>'
    plan = list(plan_family(Cutter(Description("r", "r.xml", "mjcf", source.encode())), skip_mirrored=True))
    assert {each.name: each.mirrors for each in plan} == {
        "r-no-left_leg": None, "r-no-right_leg": None, "r-no-tail": None, "r-no-left_leg-right_leg": None,
        "r-no-left_leg-tail": None, "r-no-right_leg-tail": "r-no-left_leg-tail",
    }  # fmt: skip
