"""Cut limbs off a robot: prune takes a limb with all below it, splice takes one limb and moves its children up.

The XML source is edited, not rewritten: what a cut does not touch stays byte for byte.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePath

from morphkit.cutting import mjcf, urdf
from morphkit.cutting.expand import MjcfFile, open_mjcf
from morphkit.cutting.loss import Loss
from morphkit.cutting.plan import Plan, make_plan
from morphkit.cutting.source import Source
from morphkit.description import Description
from morphkit.errors import AblationError
from morphkit.io import read
from morphkit.morphology import Morphology
from morphkit.naming import canonical_limb_names, match_limbs

__all__ = ["Loss", "Variant", "ablate", "select", "set_root_height"]

_LONGEST = 160
_SAFE = re.compile(r"[^A-Za-z0-9_.+-]+")


@dataclass(frozen=True)
class Variant:
    """A robot that was cut out of another.

    Attributes:
        description: The new robot; its info carries the source's canonical names.
        removed: Every limb that went with a prune, in file order; also a fixed body whose limb stays.
        spliced: Every limb that went while its children moved up, in file order.
        limbs: The limbs that are left, in file order.
        lost: What else went or changed.
    """

    description: Description
    removed: tuple[str, ...]
    spliced: tuple[str, ...]
    limbs: tuple[str, ...]
    lost: tuple[Loss, ...]


def select(morphology: Morphology, patterns: Iterable[str]) -> tuple[str, ...]:
    """The limbs and fixed bodies that any of `patterns` matches, in the order asked for, each once.

    Raises:
        UnknownNameError: A pattern matches nothing; the message lists the limbs and the nearest name.
        AblationError: A pattern matches the root.
    """
    names: dict[str, None] = {}
    for pattern in patterns:
        for name in match_limbs(morphology, pattern):
            if name == morphology.root.name:
                cuttable = ", ".join(limb.name for limb in morphology.limbs[1:]) or "none"
                raise AblationError(
                    f"{morphology.file}: {pattern!r} matches {name!r}, the root of {morphology.name!r}, which cannot be"
                    f" removed; limbs that can: {cuttable}"
                )
            names[name] = None
    return tuple(names)


def ablate(
    description: Description, *, remove: Sequence[str] = (), splice: Sequence[str] = (), name: str | None = None
) -> Variant:
    """Cut limbs off a robot.

    Args:
        description: The robot; a URDF stays a URDF, an MJCF stays an MJCF.
        remove: Limbs that go with everything below them: names, globs or limb types, fixed bodies included.
        splice: Limbs that go while their children move up. Each child keeps its orientation in the world and is
            shifted so that its joint's anchor lies where that of the removed limb was. Bodies fixed to the limb go too.
        name: Name of the new robot; by default that of the source, `-no-`, and what was asked for.

    Raises:
        UnknownNameError: A pattern matches nothing.
        AblationError: A pattern matches the root, or a limb is to be both removed and spliced.
        DescriptionError: The description cannot be read.
        AssetError: Limbs have to be written out by MuJoCo, which needs a mesh that is missing.
    """
    morphology = read(description)
    asked_remove, asked_splice = select(morphology, remove), select(morphology, splice)
    both = set(asked_remove) & set(asked_splice)
    if both:
        raise AblationError(f"{description.file}: {', '.join(sorted(both))} cannot be both removed and spliced")
    if name is None:
        name = variant_name(description.name, [*_asked(remove, morphology), *_asked(splice, morphology)])
    return cut(description, morphology, remove=asked_remove, splice=asked_splice, name=name)


def cut(
    description: Description, morphology: Morphology, *, remove: Sequence[str], splice: Sequence[str] = (), name: str
) -> Variant:
    """`ablate` with the robot already read and exact names of limbs and fixed bodies, none of them the root."""
    lost: list[Loss] = []
    if description.format == "urdf":
        urdf_file = Source(description.source, file=description.file)
        plan = make_plan(morphology, urdf.link_parents(urdf_file.root), remove, splice)
        lost += urdf.cut(urdf_file.root, plan)
        source = urdf_file.render()
    else:
        file = open_mjcf(description, [*remove, *splice])
        plan = make_plan(morphology, mjcf.body_parents(file.bodies), remove, splice)
        lost += file.findings
        if plan.gone:
            lost += _name_left(file, plan)
        lost += mjcf.cut(file.source.root, file.bodies, plan)
        source = file.source.render()
    gone = plan.gone
    limbs = tuple(limb.name for limb in morphology.limbs if limb.name not in gone)
    reported = [label for body, label in gone.items() if body == label]
    spliced = tuple(label for label in reported if label in plan.splice)
    info = replace(
        description.info,
        canonical=canonical_limb_names(morphology, description.info.canonical),
        expert_return=None if gone else description.info.expert_return,
    )
    return Variant(
        description=replace(
            description,
            name=name,
            file=_file_name(name, PurePath(description.file).suffix),
            source=source,
            info=info,
        ),
        removed=tuple(label for label in reported if label not in spliced),
        spliced=spliced,
        limbs=limbs,
        lost=tuple(lost),
    )


def variant_name(source: str, asked: Sequence[str]) -> str:
    """Name of a variant: `cheetah-no-ffoot-bfoot`; the source's own where nothing is asked for."""
    return source if not asked else "-".join([source, "no", *(_SAFE.sub("_", word) for word in asked)])


def set_root_height(description: Description, height_m: float) -> Description:
    """Put the root of an MJCF robot at another height.

    The root body's z position becomes `height_m`, and so does the `ref` of a vertical slide that reads the height. The
    `pos` of the root's slides keeps its place in the world; hinges move with the body.

    Args:
        description: The robot.
        height_m: Height of the root body's origin above that of the world, m.

    Raises:
        AblationError: The description is a URDF, which says nothing about where its root is.
    """
    if description.format == "urdf":
        raise AblationError(
            f"{description.file}: a URDF does not say where its root link is, so its height cannot be set; the"
            " simulation places it on the floor"
        )
    root = read(description).root.name
    file = open_mjcf(description, [root])
    mjcf.set_height(file.source.root, file.bodies[root], height_m)
    return replace(description, source=file.source.render())


def _asked(patterns: Sequence[str], morphology: Morphology) -> list[str]:
    """What a variant is named after: the words asked for; for globs the topmost limbs that they matched."""
    words: dict[str, None] = {}
    for pattern in patterns:
        if _SAFE.search(pattern) is None:
            words[pattern] = None
            continue
        matched = select(morphology, [pattern])
        below = {
            name
            for limb in morphology.limbs
            if limb.name in matched
            for lower in morphology.subtree(limb.name)
            for name in lower.members
            if name != limb.name
        }
        words |= dict.fromkeys(name for name in matched if name not in below)
    return list(words)


def _file_name(name: str, suffix: str) -> str:
    """A file name that every file system takes; long ones are cut and end in a hash of the whole."""
    safe = _SAFE.sub("_", name).lstrip(".") or "robot"
    if len(safe) > _LONGEST:
        safe = f"{safe[: _LONGEST - 9]}-{hashlib.sha256(name.encode()).hexdigest()[:8]}"
    return safe + suffix


def _name_left(file: MjcfFile, plan: Plan) -> list[Loss]:
    """Write the names of bodies without one into the file: those that it is given count bodies, and would change."""
    lost = []
    for name, element in file.bodies.items():
        if element.get("name") is None and name not in plan.gone:
            element.set("name", name)
            lost.append(Loss("name", name, "", "the body had no name; it got the one that the source's tokens have"))
    return lost
