"""Names in plain words, and the patterns that pick limbs."""

from __future__ import annotations

import time

import pytest

from morphkit.errors import UnknownNameError
from morphkit.morphology import Joint, Limb, Morphology
from morphkit.naming.limbs import canonical_joint_names, canonical_limb_names
from morphkit.naming.patterns import limb_type, match_limbs
from morphkit.naming.unique import unique
from morphkit.naming.vocabulary import DIRECTIONS


def robot(*limbs: Limb | str, type_words: tuple[tuple[str, ...], ...] = ()) -> Morphology:
    made: list[Limb] = []
    for i, limb in enumerate(limbs):
        if isinstance(limb, str):
            parent = made[0].name if made else None
            joints = (Joint(f"{limb}_j", "hinge", True, -1.0, 1.0),) if i else ()
            limb = Limb(limb, parent, joints, (limb,), limb_type(type_words, limb))
        made.append(limb)
    return Morphology("robot", "robot.xml", "mjcf", "0" * 64, "free", None, None, type_words, tuple(made), ())


@pytest.mark.parametrize(
    ("raw", "plain"),
    [
        ("torso", "torso"),
        ("bthigh", "back thigh"),
        ("bshin", "back shin"),
        ("ffoot", "front foot"),
        ("foot", "foot"),
        ("right_upper_arm", "right upper arm"),
        ("left_lower_arm", "left lower arm"),
        ("FL_hip", "front left hip"),
        ("FR_thigh", "front right thigh"),
        ("RL_calf", "back left shin"),
        ("LF_HFE", "front left hip flexion"),
        ("RH_SHANK", "back right shin"),
        ("left_hip_yaw_link", "left hip yaw"),
        ("l_arm_elx", "left arm elbow x"),
        ("l_uleg", "left thigh"),
        ("r_larm", "right lower arm"),
        ("wrist_1_link", "wrist 1"),
        ("forearm_link", "lower arm"),
        ("left_fore_arm", "left lower arm"),
        ("fore_leg", "front leg"),
        ("base_link", "base"),
        ("thigh_l", "left thigh"),
        ("FrontLeftUpperLeg", "front left thigh"),
        ("rear_wheel", "back wheel"),
        ("frontrightthigh", "front right thigh"),
        ("rearleft_wheel", "back left wheel"),
        ("leg_lefthind", "back left leg"),
        ("rightforearm", "right lower arm"),
        ("leftbackpack", "leftbackpack"),
        ("hip_r_2", "hip r 2"),
        ("link3", "link 3"),
        ("pole", "pole"),
        ("r_lfarm", "right lower arm"),
        ("ltorso", "lower torso"),
        ("utorso", "upper torso"),
        ("rh_palm", "right hand palm"),
        ("rh_forearm", "right lower arm"),
        ("rh_thproximal", "right thumb proximal"),
        ("rf_proximal", "ring finger proximal"),
        ("rf_thigh", "front right thigh"),
        ("lf_tip", "little finger tip"),
        ("left_middle_distal", "left middle finger distal"),
        ("left_index_middle", "left index finger middle"),
        ("left_middle_middle", "left middle finger middle"),
        ("finger_middle_link_1", "middle finger 1"),
        ("left_middle_leg", "middle left leg"),
        ("gripper_left_right_finger", "left gripper right finger"),
        ("left_upperleg", "left thigh"),
        ("right_upper_forearm", "right upper forearm"),
        ("leftfinger", "left finger"),
        ("bright", "bright"),
        ("fr3_link1", "link 1"),
        ("r2/left_wrist", "left wrist"),
        ("r2_left_wrist", "left wrist"),
        ("rh-l1/right_hand", "right l 1 hand"),
    ],
)
def test_plain_words(raw: str, plain: str) -> None:
    assert canonical_limb_names(robot("root_of_it", raw), {})[raw] == plain


@pytest.mark.parametrize(
    "raw",
    [
        *("link_l", "link_b", "waist_r", "torso_l", "base_f", "b_base", "head_r", "hip_r", "ankle_r", "shoulder_r"),
        *("router", "louver", "flower", "blower", "rtorso", "bhead", "fneck", "lr_mate_link1", "fr3_hand", "rr_link"),
        *("fl2_gripper", "l1_link", "arm_r1", "hr_base", "rl_arm_link", "waist_r_link", "lh_base", "ll_hip"),
    ],
)
def test_a_code_without_a_counterpart_and_without_a_paired_part_says_no_side(raw: str) -> None:
    plain = canonical_limb_names(robot("root_of_it", raw, "tail"), {})[raw]
    assert not DIRECTIONS & set(plain.split())


@pytest.mark.parametrize(
    "table",
    [
        {"link_l": "left link", "link_r": "right link"},
        {"waist_r": "right waist", "waist_l": "left waist"},
        {"ll_hr": "left leg hip", "lr_hr": "right leg hip", "ll_kfe": "left leg knee flexion"},
        {"ll_hr": "left leg hip roll", "lr_hr": "right leg hip", "ll_hp": "left leg hip pitch"},
        {"al1": "left arm 1", "ar1": "right arm 1"},
        {"lr_leg": "back left leg", "rr_leg": "back right leg", "lf_leg": "front left leg"},
        {"lh_x": "back left x", "rh_x": "back right x", "lf_x": "front left x", "rf_x": "front right x"},
        {"lh_x": "left hand x", "rh_x": "right hand x"},
        {"ff_a": "index finger a", "mf_a": "middle finger a", "rf_a": "ring finger a", "lf_a": "little finger a"},
        {"fl_x": "front left x", "fr_x": "front right x"},
        {"leg_f": "front leg", "leg_b": "back leg"},
        {"leg_f": "front leg", "leg_r": "back leg"},
        {"rotor_f": "front rotor", "rotor_b": "back rotor", "rotor_l": "left rotor", "rotor_r": "right rotor"},
        {"arm_l_1": "left arm 1", "arm_r_1": "right arm 1"},
        {"legl_hip1": "left leg hip 1", "legr_hip1": "right leg hip 1"},
        {"lradius": "left radius", "rradius": "right radius"},
        {"louter": "left outer", "router": "right outer"},
        {"ltorso": "left torso", "rtorso": "right torso"},
        {"r_uarm": "right upper arm", "r_larm": "right lower arm", "r_ufarm": "right upper forearm"},
        {"r_ufarm": "right upper forearm", "r_lfarm": "right lower forearm"},
        {"l_gripper_l_finger": "left gripper left finger", "l_gripper_r_finger": "left gripper right finger"},
        {"hand_left_middle_abd": "left hand middle finger abd", "hand_left_index_abd": "left hand index finger abd"},
        {"hand_a": "hand a", "hand_l": "hand l", "hand_r": "hand r", "hand_s": "hand s"},
        {"hip_r": "hip r", "hip_p": "hip p", "hip_y": "hip y"},
        {"L_1": "l 1", "L_2": "l 2"},
        {"b_base": "b base", "b_1": "b 1", "b_2": "b 2"},
        {"yumi_link_1_r": "right link 1", "yumi_link_1_l": "left link 1"},
        {"fr3_link1": "link 1", "fr3_link2": "link 2", "fr3_hand": "hand"},
        {"h1/left_knee": "left knee", "h1/right_knee": "right knee"},
        {"b2_FL_hip": "front left hip", "b2_RR_hip": "back right hip"},
        {"j2s6_link_1": "link 1", "j2s6_link_2": "link 2", "left_leg": "left leg"},
        {"f1_tip": "f 1 tip", "f2_tip": "f 2 tip", "left_leg": "left leg"},
        {"T1_L_coxa": "left t 1 hip", "T1_R_coxa": "right t 1 hip", "T2_L_coxa": "left t 2 hip", "T2_R_coxa":
         "right t 2 hip"},
        {"seg1_body": "seg 1", "seg2_body": "seg 2"},
        {"hingeleftdoor": "left hinge door", "hingerightdoor": "right hinge door"},
        {"hingeleftdoor": "hingeleftdoor", "slidedoor": "slidedoor"},
        {"R_wrist": "right wrist", "R_th_l0": "right thumb l 0", "R_th_l1": "right thumb l 1",
         "R_ff_l1": "right index finger l 1"},
    ],
)  # fmt: skip
def test_plain_words_among_others(table: dict[str, str]) -> None:
    names = canonical_limb_names(robot("root_of_it", *table), {})
    assert {raw: names[raw] for raw in table} == table


def test_a_word_that_every_limb_shares_is_left_out() -> None:
    names = canonical_limb_names(robot("panda_link0", "panda_link1", "panda_link2", "panda_hand"), {})
    assert list(names.values()) == ["link 0", "link 1", "link 2", "hand"]


def test_a_shared_side_or_segment_is_kept() -> None:
    assert list(canonical_limb_names(robot("base", "left_hip", "left_knee"), {}).values()) == [
        "base",
        "left hip",
        "left knee",
    ]
    assert list(canonical_limb_names(robot("base", "finger_1", "finger_2"), {}).values())[1:] == [
        "finger 1",
        "finger 2",
    ]
    assert list(canonical_limb_names(robot("base", "seg1", "seg2"), {}).values())[1:] == ["seg 1", "seg 2"]


def test_given_names_come_first_and_are_not_taken_by_others() -> None:
    names = canonical_limb_names(robot("torso", "shin", "leg"), {"leg": "shin", "left1": "left thigh"})
    assert names["leg"] == "shin"
    assert names["shin"] not in ("shin", "leg")
    assert len(set(names.values())) == 3


def test_canonical_names_are_unique() -> None:
    names = canonical_limb_names(
        robot("base", "FL_calf", "fl_shin", "FrontLeftShank", "front_left_shin", "LF_tibia"), {}
    )
    folded = [name.casefold() for name in names.values()]
    assert len(set(folded)) == len(folded)
    assert names["FL_calf"] == "front left shin"


def test_cutting_a_limb_renames_no_other_where_the_source_table_is_given() -> None:
    full = robot("base", "FL_calf", "fl_shin", "FL_shank")
    table = canonical_limb_names(full, {})
    cut = canonical_limb_names(robot("base", "fl_shin", "FL_shank"), table)
    assert cut == {raw: table[raw] for raw in ("base", "fl_shin", "FL_shank")}


def test_joint_words_leave_out_what_the_limb_says() -> None:
    joints = tuple(Joint(f"right_hip_{axis}", "hinge", True, -1.0, 1.0) for axis in "xzy")
    limb = Limb("right_thigh", "pelvis", joints, ("right_thigh",))
    assert list(canonical_joint_names(limb, "right thigh").values()) == ["hip x", "hip z", "hip y"]


def test_a_code_in_the_name_of_a_joint_counts_where_its_limb_says_the_same() -> None:
    def names(limb_name: str) -> list[str]:
        joints = tuple(Joint(name, "hinge", True, -1.0, 1.0) for name in ("j_l_1", "j_l_2"))
        return list(canonical_joint_names(Limb("limb", "base", joints, ("limb",)), limb_name).values())

    assert names("left foot") == ["j 1", "j 2"]
    assert names("tail") == ["j l 1", "j l 2"]


def test_joint_words_stay_whole_where_nothing_else_would_be_left() -> None:
    joints = (Joint("shoulder", "hinge", True, -1.0, 1.0), Joint("shoulder_lift", "hinge", True, -1.0, 1.0))
    limb = Limb("shoulder", "base", joints, ("shoulder",))
    assert list(canonical_joint_names(limb, "shoulder").values()) == ["shoulder", "shoulder lift"]


def test_unique_numbers_what_an_uncased_encoder_cannot_tell_apart() -> None:
    assert unique(["a_b", "A b", "a_b_2", "c"]) == ["a_b", "A b_2", "a_b_2_2", "c"]
    assert unique(["x"], taken=["X"]) == ["x_2"]


CHEETAH = ("torso", "bthigh", "bshin", "bfoot", "fthigh", "fshin", "ffoot")
CHEETAH_TYPES = (("torso",), ("thigh",), ("shin",), ("foot",))


@pytest.mark.parametrize(
    ("pattern", "picked"),
    [
        ("bfoot", ["bfoot"]),
        ("b*", ["bthigh", "bshin", "bfoot"]),
        ("[bf]shin", ["bshin", "fshin"]),
        ("foot", ["bfoot", "ffoot"]),
    ],
)
def test_match_by_name_glob_and_type(pattern: str, picked: list[str]) -> None:
    assert match_limbs(robot(*CHEETAH, type_words=CHEETAH_TYPES), pattern) == picked


def test_a_name_goes_before_a_type() -> None:
    hopper = robot(
        "torso", "thigh", "leg", "lower_leg", "foot", type_words=(("torso",), ("thigh",), ("leg",), ("foot",))
    )
    assert match_limbs(hopper, "leg") == ["leg"]
    assert match_limbs(hopper, "*leg") == ["leg", "lower_leg"]


def test_any_word_of_a_type_group_picks_the_group() -> None:
    quadruped = robot("trunk", "a_hip", "a_thigh", type_words=(("trunk",), ("hip", "thigh")))
    assert match_limbs(quadruped, "thigh") == ["a_hip", "a_thigh"]


def test_a_type_picks_limbs_whatever_their_case_and_no_link_fixed_to_one_of_the_type() -> None:
    joints = (Joint("j", "hinge", True, -1.0, 1.0),)
    left = Limb("LeftFoot", "trunk", joints, ("LeftFoot", "LeftFootPad"), limb_type((("foot",),), "LeftFoot"))
    biped = robot("trunk", left, "rightfoot", type_words=(("foot",),))
    assert match_limbs(biped, "foot") == ["LeftFoot", "rightfoot"]


def test_fixed_links_match_by_name_glob_and_type() -> None:
    calf = Limb("FL_calf", "trunk", (Joint("j", "hinge", True, -1.0, 1.0),), ("FL_calf", "FL_foot"), "calf")
    typed = robot("trunk", calf, type_words=(("calf",), ("foot",)))
    untyped = robot("trunk", calf)
    for quadruped in (typed, untyped):
        assert match_limbs(quadruped, "FL_foot") == ["FL_foot"]
        assert match_limbs(quadruped, "*_foot") == ["FL_foot"]
        assert match_limbs(quadruped, "foot") == ["FL_foot"]


def test_a_side_is_no_limb_type() -> None:
    with pytest.raises(UnknownNameError):
        match_limbs(robot("torso", "left_foot", "right_foot"), "left")


def test_no_match_names_the_nearest_and_lists_the_limbs() -> None:
    with pytest.raises(UnknownNameError, match=r"did you mean 'bfoot'\?(?s:.*)limbs: torso, bthigh, bshin"):
        match_limbs(robot(*CHEETAH, type_words=CHEETAH_TYPES), "bfoott")


def test_limb_type_takes_the_first_group_that_occurs() -> None:
    assert limb_type((("torso",), ("1",), ("2",)), "left2") == "2"
    assert limb_type((("calf",),), "FL_Calf") == "calf"
    assert limb_type((("hip",),), "torso") is None


def test_names_of_thousands_of_limbs_take_no_quadratic_time() -> None:
    many = robot("base", *(f"leg_{i}" for i in range(5000)), *(f"Leg {i}" for i in range(5000)))
    start = time.process_time()
    names = canonical_limb_names(many, {})
    assert time.process_time() - start < 10
    assert len(set(names.values())) == len(names) == 10_001


def test_an_empty_pattern_is_no_limb() -> None:
    with pytest.raises(UnknownNameError):
        match_limbs(robot("torso", "lfemur"), "")
