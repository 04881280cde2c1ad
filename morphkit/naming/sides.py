"""Codes of one to three letters that say a side, an end or a finger, and what tells them from an axis or a number.

The `r` of `r_hand` is right, that of `waist_r` a roll axis and that of `r2/hand` a robot. A code counts where the robot
has the same name with the counterpart's code, or where it stands at the edge of a name that says a part which bodies
have on either side.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from itertools import product
from typing import NamedTuple

from morphkit.naming import vocabulary
from morphkit.naming.vocabulary import ARM_PARTS, FINGER_CODES, LEG_PARTS, PAIRED, PHALANGES, SOLID, split

END_OF = {"f": "front", "m": "middle", "b": "back", "h": "back", "r": "back"}
SIDE_OF = {"l": "left", "r": "right"}
END_FIRST = {end + side: (END_OF[end], SIDE_OF[side]) for end, side in product(END_OF, SIDE_OF)}
SIDE_FIRST = {side + end: (END_OF[end], SIDE_OF[side]) for end, side in product(END_OF, SIDE_OF)}
SIDE_FIRST["rr"] = ("back", "right")
_LIMB_CODES = {
    **{"ll": ("left", "leg", ("lr", "rl")), "lr": ("right", "leg", ("ll",)), "rl": ("right", "leg", ("ll",))},
    **{"al": ("left", "arm", ("ar",)), "ar": ("right", "arm", ("al",))},
    **{"la": ("left", "arm", ("ra",)), "ra": ("right", "arm", ("la",))},
}
_HANDS = {"lh": "left", "rh": "right"}
OTHER_LETTERS = {"l": ("r",), "r": ("l",), "f": ("b", "r", "h"), "b": ("f",), "h": ("f",)}
_LETTERING = tuple("adegijknoqstuvw")
"""Letters that number limbs: beside `hand_s`, `hand_l` is no left hand."""
_AXES = ("p", "y", "x", "z", "pitch", "yaw")
STANDING = LEG_PARTS | {"wheel", "shoulder"}
"""What front and back limbs are made of."""
_SURE_FINGERS = ("ff", "if", "mf", "th")
"""Codes of fingers that are none of legs."""
_CODES = {*OTHER_LETTERS, *END_FIRST, *SIDE_FIRST, *_LIMB_CODES, *FINGER_CODES}
_SAY_HAND = ARM_PARTS - {"palm", "gripper"}


class Names:
    """The names of a robot, as words, asked for counterparts.

    Args:
        names: All names of one kind, such as those of all limbs.
    """

    def __init__(self, names: Iterable[str] = ()) -> None:
        self._known = {tuple(split(name)) for name in names}
        self._codes: set[tuple[int, str]] = set()
        self._fingers: set[tuple[int, str]] = set()
        for words in self._known:
            for place, word in enumerate(words[:-1]):
                if word in _CODES and not words[place + 1].isdigit():
                    self._prove(words, place)

    def have(self, words: Sequence[str], place: int, others: Iterable[str]) -> bool:
        """Whether one of the names is `words` with one of `others` at `place`."""
        before, after = tuple(words[:place]), tuple(words[place + 1 :])
        return any(other != words[place] and (*before, other, *after) in self._known for other in others)

    def prove(self, place: int, word: str) -> bool:
        """Whether `word` is a code at that place of another name, whatever follows."""
        return (place, word) in self._codes

    def prove_finger(self, place: int, word: str) -> bool:
        """Whether `word` is a finger's code at that place of another name, whatever follows."""
        return (place, word) in self._fingers

    def _prove(self, words: Sequence[str], place: int) -> None:
        word, context = words[place], Context(words, self, start=place)
        if finger(context, place) is not None:
            self._fingers.add((place, word))
        elif code(context, place) is not None and word not in ("f", "b", "h"):
            self._codes.add((place, word))


class Meaning(NamedTuple):
    """What a word says: an end, a side, and what is left of it in plain words."""

    end: str = ""
    side: str = ""
    text: str = ""


class Context(NamedTuple):
    """What a word stands in.

    Attributes:
        words: All words of the name.
        names: The names of the robot.
        said: Plain words that are known of it: those of the limb that a joint belongs to.
        side: The side that the name says already.
        start: Number of words in front that are no part of the name, such as the robot's.
    """

    words: Sequence[str]
    names: Names
    said: Collection[str] = ()
    side: str = ""
    start: int = 0

    def have(self, place: int, others: Iterable[str]) -> bool:
        """Whether the robot has this name with one of `others` at `place`."""
        return self.names.have(self.words, place, others)

    def says(self, place: int, some: Collection[str]) -> bool:
        """Whether a word other than that at `place` says one of the parts `some`."""
        return any(
            not vocabulary.parts(word).isdisjoint(some)
            for i, word in enumerate(self.words)
            if i >= self.start and i != place
        )

    def at_edge(self, place: int) -> bool:
        """Whether the word opens or closes the name, and has no digit at its side."""
        last = len(self.words) - 1
        if self.start == last or place not in (self.start, last):
            return False
        return not self.words[place + 1 if place == self.start else place - 1].isdigit()

    def leads(self, place: int) -> bool:
        """Whether the word opens the name and is a code there in other names too."""
        return place == self.start and self.at_edge(place) and self.names.prove(place, self.words[place])


def finger(context: Context, place: int) -> str | None:
    """The finger that a code such as `rf` says, alone or glued to a phalanx as in `rfknuckle`; None for other words."""
    word = context.words[place]
    code, rest = word[:2], word[2:]
    if code not in FINGER_CODES:
        return None
    if rest:
        return f"{FINGER_CODES[code]} {rest}" if rest in vocabulary.GLUED_PHALANGES else None
    proved = context.have(place, _SURE_FINGERS) or context.names.prove_finger(place, code)
    if proved or _before_phalanx(context.words, place):
        return FINGER_CODES[code]
    return None


def names_finger(context: Context, place: int) -> bool:
    """Whether a word such as `middle` says which finger it is, and not which end or how large."""
    words = context.words
    beside = {words[i] for i in (place - 1, place + 1) if 0 <= i < len(words)}
    if words[place] not in vocabulary.FINGERS or is_phalanx(words, place):
        return False
    others = vocabulary.FINGERS | {"thumb"}
    return "finger" in beside or _before_phalanx(words, place, "middle") or context.have(place, others)


def is_phalanx(words: Sequence[str], place: int) -> bool:
    """Whether the word `middle` comes behind a finger, and so is its middle phalanx."""
    fingers = vocabulary.FINGERS | {"thumb"}
    return words[place] == "middle" and any(word in fingers for word in words[:place])


def code(context: Context, place: int) -> Meaning | None:
    """What a code of one or two letters says about where a limb is; None where it is no such code."""
    word = context.words[place]
    if word in OTHER_LETTERS:
        return _letter(context, place)
    if word in _LIMB_CODES and _is_limb(context, place):
        return Meaning("", *_LIMB_CODES[word][:2])
    if word in _HANDS and _is_hand(context, place):
        return Meaning(
            "",
            "" if context.side else _HANDS[word],
            "" if context.says(place, _SAY_HAND) or _fingers_in(context) else "hand",
        )
    for codes in (END_FIRST, SIDE_FIRST):
        if word in codes and _is_quarter(context, place, codes):
            return Meaning(*codes[word])
    return None


def hip(context: Context, place: int) -> str | None:
    """What `hr` says of a leg: its hip, and which axis where another of its codes stands beside it."""
    axes = {"hr": "roll", "hp": "pitch", "hy": "yaw"}
    word = context.words[place]
    if not place or not context.side or word not in axes:
        return None
    if context.have(place, axes):
        return f"hip {axes[word]}"
    return "hip" if word == "hr" else None


def _letter(context: Context, place: int) -> Meaning | None:
    word = context.words[place]
    others = OTHER_LETTERS[word]
    if context.have(place, _LETTERING):
        return None
    paired = context.have(place, others)
    if word in SIDE_OF:
        if word == "r" and not paired and context.have(place, "f") and not context.side:
            return Meaning(end="back")
        if not paired and SIDE_OF[word] not in context.said:
            if context.side or not context.at_edge(place):
                return None
            if not (_leads_part(context, place) if place == context.start else _ends_part(context, place)):
                return None
        return Meaning(side=SIDE_OF[word])
    counts = paired or END_OF[word] in context.said or all(context.have(place, side) for side in SIDE_OF)
    leads = word in "fb" and place == context.start and context.at_edge(place)
    return Meaning(end=END_OF[word]) if counts or (leads and context.says(place, LEG_PARTS)) else None


def _leads_part(context: Context, place: int) -> bool:
    return context.leads(place) or context.says(place, PAIRED) or _fingers_in(context)


def _ends_part(context: Context, place: int) -> bool:
    return context.says(place, SOLID) and not context.have(place, _AXES)


def _is_quarter(context: Context, place: int, codes: dict[str, tuple[str, str]]) -> bool:
    """Whether `fl` or its like says one of four or six limbs."""
    word = context.words[place]
    if context.side not in ("", codes[word][1]):
        return False
    if context.have(place, codes) or set(codes[word]) <= set(context.said):
        return True
    if word == "lr":
        return False
    in_place = context.at_edge(place) and (word not in _HANDS or place == context.start)
    return context.leads(place) or (in_place and context.says(place, STANDING))


def _is_limb(context: Context, place: int) -> bool:
    """Whether `ll` or its like says one of two legs or arms."""
    others = _LIMB_CODES[context.words[place]][2]
    proved = context.leads(place) and any(context.names.prove(place, other) for other in others)
    return proved or context.have(place, others)


def _is_hand(context: Context, place: int) -> bool:
    word = context.words[place]
    if context.side not in ("", _HANDS[word]) or context.have(place, set(SIDE_FIRST) - set(_HANDS)):
        return False
    if context.says(place, STANDING - {"shoulder"}):
        return False
    known = context.have(place, _HANDS) or context.leads(place)
    return known or (context.at_edge(place) and (context.says(place, ARM_PARTS) or _fingers_in(context)))


def _fingers_in(context: Context) -> bool:
    return any(
        word in PHALANGES or names_finger(context, i) or finger(context, i) is not None
        for i, word in enumerate(context.words)
        if i >= context.start
    )


def _before_phalanx(words: Sequence[str], place: int, *more: str) -> bool:
    return any(word in PHALANGES or word in more for word in words[place + 1 :])
