"""Names in plain words: where a limb is, then what it is."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from morphkit.naming import glued, sides, vocabulary
from morphkit.naming.sides import Context, Names

_NO_NAMES = Names()


def plain_words(words: Sequence[str], names: Names = _NO_NAMES, said: Collection[str] = (), start: int = 0) -> str:
    """Say a name in plain words: end, side, then what is left in its order: `rl calf` gives `back left shin`.

    Args:
        words: The words of the name, as `vocabulary.split` gives them.
        names: All names of the robot: a code such as `r` counts as a side where one of them is the counterpart.
        said: Plain words that are known of it besides; a code that says the same counts too.
        start: Number of words in front to leave out.
    """
    name = _Name(Context(words, names, said, start=start))
    return " ".join(filter(None, (name.end, name.side, vocabulary.without_fillers(name.rest))))


def is_known(word: str) -> bool:
    """Whether a word says a side, an end or a part of a body, alone or glued together, or is a filler: `link`."""
    if word in vocabulary.FILLERS or word in vocabulary.ENDS or word in vocabulary.SIDES:
        return True
    return vocabulary.segment(word) is not None or glued.unglue(Context([word], _NO_NAMES), 0) is not None


class _Name:
    """The words of a name sorted out; a side that is written out goes before any code."""

    def __init__(self, context: Context) -> None:
        self.end = self.side = ""
        self.rest: list[str] = []
        self._taken: set[int] = set()
        self._context = context
        places = range(context.start, len(context.words))
        self._written(places)
        held = (glued.glued_side(self._context, place) for place in places)
        self._context = self._context._replace(side=self.side or next((each.side for each in held if each), ""))
        for place in places:
            if place not in self._taken:
                self._word(place)

    def _written(self, places: range) -> None:
        for place in places:
            word = self._context.words[place]
            if word in vocabulary.SIDES and not self.side:
                self.side = word
                self._taken.add(place)
            if word in vocabulary.ENDS and not self.end and not self._in_hand(place):
                self.end = vocabulary.ENDS[word]
                self._taken.add(place)

    def _in_hand(self, place: int) -> bool:
        return sides.names_finger(self._context, place) or sides.is_phalanx(self._context.words, place)

    def _word(self, place: int) -> None:
        context, word = self._context, self._context.words[place]
        if sides.names_finger(context, place):
            self._finger(place)
        elif (text := sides.finger(context, place)) is not None:
            self.rest.append(text)
        elif (found := sides.code(context, place)) is not None:
            self._put(found)
        elif (text := vocabulary.segment(word)) is not None:
            self.rest.append(text)
        elif (found := glued.unglue(context, place)) is not None:
            self._put(found)
        else:
            self.rest.append(sides.hip(context, place) or word)

    def _finger(self, place: int) -> None:
        words = self._context.words
        if words[place - 1 : place] == ["finger"] and self.rest[-1:] == ["finger"]:
            self.rest[-1:] = [f"{words[place]} finger"]
        else:
            self.rest.append(words[place] if words[place + 1 : place + 2] == ["finger"] else f"{words[place]} finger")

    def _put(self, found: sides.Meaning) -> None:
        """The first end and the first side stand in front, others where they are."""
        if found.end and not self.end:
            self.end = found.end
        elif found.end:
            self.rest.append(found.end)
        if found.side and not self.side:
            self.side = found.side
            self._context = self._context._replace(side=self.side)
        elif found.side and not (found.end and found.side == self.side):
            self.rest.append(found.side)
        if found.text:
            self.rest.append(found.text)
