"""Words that hold a side and a part in one: `bthigh`, `flhip`, `ltorso`, `uleg` and `leftfinger`."""

from __future__ import annotations

from morphkit.naming import vocabulary
from morphkit.naming.sides import END_FIRST, END_OF, OTHER_LETTERS, SIDE_FIRST, SIDE_OF, STANDING, Context, Meaning
from morphkit.naming.vocabulary import CENTRAL, LEG_PARTS, PAIRED


def unglue(context: Context, place: int) -> Meaning | None:
    """Take apart `bthigh`, `flhip`, `uleg` or `leftfinger`; None where the word is none of these."""
    word = context.words[place]
    for found in (glued_side(context, place), _glued_quarter(context, place), _glued_letter(context, place)):
        if found is not None:
            return found
    for adjective in ("upper", "lower"):
        text = vocabulary.segment(word.removeprefix(adjective))
        if text is not None and word.startswith(adjective):
            return Meaning("", "", f"{adjective} {text}")
    return None


def glued_side(context: Context, place: int) -> Meaning | None:
    """Side and rest of a word such as `leftfinger`, `finright` or `hingeleftdoor`; None where it is none."""
    word = context.words[place]
    for side, other in (("left", "right"), ("right", "left")):
        front, _, back = word.partition(side)
        if front and back and context.have(place, [front + other + back]):
            return Meaning("", side, f"{front} {back}")
        for rest in (word.removeprefix(side), word.removesuffix(side)):
            text = vocabulary.segment(rest)
            if len(rest) > 2 and rest != word and (text or context.have(place, [word.replace(side, other)])):
                return Meaning("", side, text or rest)
    return None


def _glued_quarter(context: Context, place: int) -> Meaning | None:
    word = context.words[place]
    text = vocabulary.segment(word[2:])
    if text is None or context.side:
        return None
    for codes in (END_FIRST, SIDE_FIRST):
        ends = {other + word[2:] for other in codes if word[:2] in codes and codes[other][0] != codes[word[:2]][0]}
        if word[:2] in codes and word[:2] != "lr" and (text in STANDING or context.have(place, ends)):
            return Meaning(*codes[word[:2]], text)
    return None


def _glued_letter(context: Context, place: int) -> Meaning | None:
    """`lfemur`, `bthigh`, `ltorso`, `uarm` and `legl`."""
    word = context.words[place]
    if not word:
        return None
    head, rest, tail = word[0], word[1:], word[-1]
    text = vocabulary.segment(rest)
    others = [other + rest for other in OTHER_LETTERS.get(head, ())]
    if text is None:
        front = vocabulary.segment(word[:-1])
        if tail in SIDE_OF and front and not context.side:
            paired = context.have(place, [word[:-1] + OTHER_LETTERS[tail][0]])
            return Meaning("", SIDE_OF[tail], front) if paired else None
        known = head in SIDE_OF and len(rest) > 2 and not context.side and context.have(place, others)
        return Meaning("", SIDE_OF[head], rest) if known else None
    if head == "u":
        return Meaning("", "", f"upper {text}")
    if head == "m" and text in CENTRAL:
        return Meaning("middle", "", text)
    paired = context.have(place, others)
    upper = context.have(place, ["u" + rest])
    if head == "l" and (context.side or (not paired and (upper or text in CENTRAL))):
        short = text == "lower arm" and not upper
        return Meaning("", "", text if short else f"lower {text}")
    nouns = set(text.split())
    if head in SIDE_OF and not context.side and (paired or nouns & PAIRED):
        return Meaning("", SIDE_OF[head], text)
    if head in "fb" and (paired or nouns & LEG_PARTS):
        return Meaning(END_OF[head], "", text)
    return None
