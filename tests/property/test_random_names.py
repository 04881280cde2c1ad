"""Canonical names of robots with random names: sides are those that are written, and both sides read alike."""

from __future__ import annotations

from itertools import product

from hypothesis import given, settings
from hypothesis import strategies as st

from morphkit.description import Description
from morphkit.naming.limbs import canonical_limb_names
from morphkit.readers import read

quick = settings(max_examples=60, deadline=None, derandomize=True)
SIDES, ENDS = ("left", "right"), ("front", "back")
PARTS = ("thigh", "shin", "foot", "hip", "arm", "hand", "wrist", "elbow", "knee", "finger", "link", "pad", "wheel")
SEPARATORS = ("_", "-", ".", "/")
NEUTRAL = ("torso", "head", "pelvis", "camera_mount", "battery", "tail_2", "neck", "gripper_base")


def names_of(*limbs: str) -> dict[str, str]:
    inner = "".join(f'<body name="{limb}"><joint/><geom size=".1"/></body>' for limb in limbs)
    text = f'<mujoco><worldbody><body name="trunk"><freejoint/><geom size=".1"/>{inner}</body></worldbody></mujoco>'
    names = canonical_limb_names(read(Description("r", "r.xml", "mjcf", text.encode())), {})
    return {raw: name for raw, name in names.items() if raw in limbs}


@st.composite
def written(draw: st.DrawFn) -> str:
    """A part's name with `{}` where the side stands, such as `{}_hind-thigh_2`."""
    words = [draw(st.sampled_from(PARTS))]
    words.insert(draw(st.integers(0, 1)), "{}")
    if draw(st.booleans()):
        words.append(draw(st.sampled_from(("1", "2", "link", "upper", "lower"))))
    return draw(st.sampled_from(SEPARATORS)).join(words)


@quick
@given(st.lists(written(), min_size=1, max_size=4, unique=True))
def test_a_written_side_stays_and_its_mirror_image_reads_alike(forms: list[str]) -> None:
    names = names_of(*(form.format(side) for form, side in product(forms, SIDES)))
    for form in forms:
        left, right = (names[form.format(side)].split() for side in SIDES)
        assert left.count("left") == right.count("right") == 1
        assert "right" not in left
        assert "left" not in right
        assert [word for word in left if word != "left"] == [word for word in right if word != "right"]


@quick
@given(written(), st.sampled_from(SIDES), st.booleans())
def test_a_written_side_goes_before_a_code(form: str, side: str, behind: bool) -> None:
    other = {"left": "r", "right": "l"}[side]
    raw = f"{form.format(side)}_{other}" if behind else f"{other}2_{form.format(side)}"
    words = names_of(raw)[raw].split()
    assert side in words
    assert {"left": "right", "right": "left"}[side] not in words


@quick
@given(
    st.lists(st.sampled_from(NEUTRAL), min_size=1, max_size=5, unique=True),
    st.sampled_from((str, str.upper, str.title)),
)
def test_names_without_sides_get_none(raw: list[str], case) -> None:
    for name in names_of(*map(case, raw)).values():
        assert not {*SIDES, *ENDS} & set(name.split())


@quick
@given(st.sampled_from(PARTS), st.sampled_from("lrfbLRFB"), st.sampled_from(SEPARATORS))
def test_a_code_alone_on_an_unpaired_part_is_no_side(part: str, code: str, separator: str) -> None:
    raw = f"link{separator}{code}"
    assert not {*SIDES, *ENDS} & set(names_of(raw, part)[raw].split())


@quick
@given(
    st.lists(st.text("abcdefghijklmnopqrstuvwxyz0123456789_-./ABCXYZ", min_size=1, max_size=14), min_size=1, max_size=8)
)
def test_any_names_give_distinct_words(raw: list[str]) -> None:
    limbs = [f"{i}{name}" for i, name in enumerate(raw)]
    names = names_of(*limbs)
    assert len(set(names.values())) == len(limbs)
    assert all(name == " ".join(name.split()) != "" for name in names.values())
