"""The words of limb names: how robot files abbreviate sides and segments, and what they mean in plain words."""

from __future__ import annotations

import re
from collections.abc import Sequence

_ENDS = {"front": "front", "fore": "front", "back": "back", "rear": "back", "hind": "back", "middle": "middle"}
_ENDS["mid"] = "middle"
_SIDES = ("left", "right")
DIRECTIONS = frozenset([*_ENDS.values(), *_SIDES])

# One and two letters count at either edge of a name only: the `r` in `hip_r_2` may well be a roll axis.
_LETTERS = {"f": "front", "b": "back", "l": "left", "r": "right"}
_PAIRS = {
    pair: (_LETTERS.get(end, {"h": "back", "m": "middle"}.get(end, "")), _LETTERS[side])
    for end in "fbhm"
    for side in "lr"
    for pair in (end + side, side + end)
} | {"rl": ("back", "left"), "rr": ("back", "right")}

_SEGMENTS = {
    word: word
    for word in (
        *("torso", "base", "pelvis", "waist", "spine", "chest", "neck", "head", "tail", "wheel", "leg", "arm"),
        *("hip", "thigh", "knee", "shin", "ankle", "foot", "toe", "heel"),
        *("shoulder", "clavicle", "elbow", "wrist", "hand", "palm", "finger", "thumb", "gripper"),
        *("upper", "lower", "inner", "outer"),
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
_FILLERS = frozenset({"link", "body", "joint", "motor", "actuator"})
_PHRASES = (("upper leg", "thigh"), ("lower leg", "shin"))


def split(name: str) -> list[str]:
    """The lower-case words of a name, cut at signs, at camelCase humps and between letters and digits."""
    humps = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", name)
    return [word.lower() for word in re.findall(r"[^\W\d_]+|\d+", humps)] or [name.lower()]


def is_known(word: str) -> bool:
    """Whether a word says a side, an end or a segment, alone or glued together, or is a filler such as `link`."""
    if word in _LETTERS or word in _PAIRS or word in _FILLERS or word in _ENDS or word in _SIDES:
        return True
    return _segment(word) is not None or _unglue(word, sided=False) is not None


def plain_words(words: Sequence[str]) -> str:
    """Say a name in plain words: end, side, then what is left in its order: `rl calf` gives `back left shin`."""
    end, side, rest = "", "", []
    words = " ".join(words).replace("fore arm", "forearm").split(" ")
    for i, word in enumerate(words):
        at_edge = len(words) > 1 and i in (0, len(words) - 1)
        if word in _ENDS:
            end = end or _ENDS[word]
        elif word in _SIDES:
            side = side or word
        elif at_edge and word in _PAIRS:
            end, side = _PAIRS[word]
        elif at_edge and word in _LETTERS and not (end if word in "fb" else side):
            end, side = (_LETTERS[word], side) if word in "fb" else (end, _LETTERS[word])
        elif (segment := _segment(word)) is None and (unglued := _unglue(word, sided=bool(side))):
            end, side, segment = unglued[0] or end, unglued[1] or side, unglued[2]
            rest.append(segment)
        else:
            rest.append(segment or word)
    return " ".join(filter(None, (end, side, _without_fillers(rest))))


def _segment(word: str) -> str | None:
    if code := _JOINT_CODE.fullmatch(word):
        return f"{_JOINT_CODES[code[1]]} {code[2]}"
    return _SEGMENTS.get(word)


def _unglue(word: str, *, sided: bool) -> tuple[str, str, str] | None:
    """Take apart `bthigh`, `flhip` or `uleg` into (end, side, segment); None where the word is none of these."""
    for length in (2, 1):
        head, segment = word[:length], _segment(word[length:])
        if segment is None:
            continue
        if head in _PAIRS:
            return (*_PAIRS[head], segment)
        if head == "u" or (head == "l" and sided):
            return "", "", f"{'upper' if head == 'u' else 'lower'} {segment}"
        if head in _LETTERS:
            return (_LETTERS[head], "", segment) if head in "fb" else ("", _LETTERS[head], segment)
    return None


def _without_fillers(words: Sequence[str]) -> str:
    kept = [word for word in words if word not in _FILLERS]
    text = " ".join(kept if any(not word.isdigit() for word in kept) else words)
    for phrase, meaning in _PHRASES:
        text = re.sub(rf"\b{phrase}\b", meaning, text)
    return text
