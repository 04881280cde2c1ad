"""The words of limb names: how robot files abbreviate parts of a body, and what they mean in plain words."""

from __future__ import annotations

import re

ENDS = {"front": "front", "fore": "front", "back": "back", "rear": "back", "hind": "back", "middle": "middle"}
ENDS["mid"] = "middle"
SIDES = ("left", "right")
DIRECTIONS = frozenset([*ENDS.values(), *SIDES])

CENTRAL = frozenset({"torso", "base", "pelvis", "waist", "spine", "chest", "neck", "head", "tail"})
LEG_PARTS = frozenset({"leg", "hip", "thigh", "knee", "shin", "ankle", "foot", "toe", "heel"})
ARM_PARTS = frozenset({"arm", "shoulder", "clavicle", "elbow", "wrist", "hand", "palm", "finger", "thumb", "gripper"})
PAIRED = LEG_PARTS | ARM_PARTS
"""Parts that a body has on either side."""
SOLID = frozenset({"leg", "thigh", "shin", "foot", "toe", "heel", "arm", "hand", "palm"})
"""Paired parts that are no joint, so that an `r` behind them is no roll axis."""
_ADJECTIVES = ("upper", "lower", "inner", "outer")

FINGERS = frozenset({"index", "middle", "ring", "pinky", "little"})
FINGER_CODES = {"ff": "index finger", "if": "index finger", "mf": "middle finger", "rf": "ring finger"}
FINGER_CODES |= {"lf": "little finger", "th": "thumb"}
PHALANGES = frozenset(
    {
        *("metacarpal", "knuckle", "proximal", "prox", "intermediate", "medial", "distal", "phalanx", "nail"),
        *("mcp", "pip", "dip", "tip", "fingertip"),
    }
)
GLUED_PHALANGES = PHALANGES | {"middle", "base", "hub"}

_SEGMENTS = {
    word: word
    for word in (
        *(*CENTRAL, *PAIRED, *_ADJECTIVES, "wheel"),
        *("index", "ring", "pinky", "little"),
    )
} | {
    "trunk": "torso",
    "calf": "shin",
    "shank": "shin",
    "tibia": "shin",
    "femur": "thigh",
    "coxa": "hip",
    "forearm": "lower arm",
    "farm": "lower arm",
    "clav": "clavicle",
    "glut": "hip",
    "hipassembly": "hip",
    "haa": "hip abduction",
    "hfe": "hip flexion",
    "kfe": "knee flexion",
    "hx": "hip x",
    "hy": "hip y",
    "kn": "knee",
}
_JOINT_CODE = re.compile(r"(sh|el|wr|hp|kn|ak|bk)([xyz])")
_JOINT_CODES = {
    **{"sh": "shoulder", "el": "elbow", "wr": "wrist"},
    **{"hp": "hip", "kn": "knee", "ak": "ankle", "bk": "spine"},
}
_GLUED_END = re.compile("({0})({1})|({1})({0})".format("|".join(ENDS), "|".join(SIDES)))
FILLERS = frozenset({"link", "body", "joint", "motor", "actuator"})
_PHRASES = (
    ("upper leg", "thigh"),
    ("lower leg", "shin"),
    ("upper lower arm", "upper forearm"),
    ("lower lower arm", "lower forearm"),
)


def split(name: str) -> list[str]:
    """The lower-case words of a name, cut at signs, at camelCase humps and between letters and digits."""
    humps = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", name)
    words = [part for word in re.findall(r"[^\W\d_]+|\d+", humps) for part in _unglue_end(word.lower())]
    words = words or [name.lower()]
    return " ".join(words).replace("fore arm", "forearm").split(" ")


def _unglue_end(word: str) -> list[str]:
    """Take apart an end and a side that are written as one, such as `frontleft`, also with a part: `hindrightfoot`."""
    match = _GLUED_END.match(word)
    if match is None:
        return [word]
    rest = word[match.end() :]
    if rest and segment(rest) is None:
        return [word]
    return list(filter(None, (*match.groups(), rest)))


def segment(word: str) -> str | None:
    """The part of a body that a word says, in plain words; None where it says none."""
    if code := _JOINT_CODE.fullmatch(word):
        return f"{_JOINT_CODES[code[1]]} {code[2]}"
    return _SEGMENTS.get(word)


def parts(word: str) -> frozenset[str]:
    """The plain words of the part that a word says, also with a letter or two in front of it, as in `uleg`."""
    for start in range(3 if len(word) > 3 else 1):
        if (found := segment(word[start:])) is not None:
            return frozenset(found.split())
    return frozenset()


def is_adjective(text: str) -> bool:
    """Whether a segment in plain words, such as `outer`, only says which of several it is."""
    return text in _ADJECTIVES


def without_fillers(words: list[str]) -> str:
    """Join words, without `link` and its like where others say more, and with one word for what takes two."""
    kept = [word for word in words if word not in FILLERS]
    text = " ".join(kept if any(len(word) > 1 and not word.isdigit() for word in kept) else words)
    for phrase, meaning in _PHRASES:
        text = re.sub(rf"\b{phrase}\b", meaning, text)
    return text
