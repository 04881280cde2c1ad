"""What both readers share: the type of a limb, and the choice among several roots."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from morphkit.description import RobotInfo
from morphkit.errors import DescriptionError, UnknownNameError
from morphkit.formats.limits import abridged
from morphkit.naming.patterns import limb_type
from morphkit.utils.suggest import did_you_mean


def type_of(info: RobotInfo, body: str, joints: Iterable[str]) -> str | None:
    """The type of a limb.

    Args:
        info: Its `type_matched_in` says whether the body's name counts or those of its joints.
        body: Name of the limb's body.
        joints: Names of its moving joints; base joints do not count.
    """
    return limb_type(info.type_words, *([body] if info.type_matched_in == "body" else joints))


def choose_root(roots: Sequence[str], wanted: str | None, *, file: str, element: str, notes: Sequence[str] = ()) -> str:
    """Return the root to take.

    Args:
        roots: Names of the top-level bodies or links, in file order.
        wanted: `Description.root`.
        file: What the file is called in messages.
        element: `body` or `link`.
        notes: What else there is to say of them where one has to be chosen.

    Raises:
        UnknownNameError: `wanted` is not among them.
        DescriptionError: There are several and `wanted` is None.
    """
    listed = abridged(roots)
    if wanted is not None:
        if wanted not in roots:
            raise UnknownNameError(
                f"{file}: no top-level {element} {wanted!r}; there is {listed}{did_you_mean(wanted, roots)}"
            )
        return wanted
    if len(roots) > 1:
        raise DescriptionError(
            f"{file}: {len(roots)} top-level {element} elements, expected one: {listed}. Say which with --root NAME,"
            " or join them" + "".join(f"\n  {note}" for note in notes)
        )
    return roots[0]
