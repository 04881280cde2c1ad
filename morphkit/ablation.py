"""Cut limbs off a robot: prune takes a limb with all below it, splice takes one limb and moves its children up.

The XML source is edited, not rewritten: what a cut does not touch stays byte for byte.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import PurePath

from morphkit.cutting import mjcf, urdf
from morphkit.cutting.expand import MjcfFile, MjcfOpener, open_mjcf
from morphkit.cutting.loss import Loss
from morphkit.cutting.plan import Plan, make_plan
from morphkit.cutting.rest import Positions, mjcf_positions, urdf_positions
from morphkit.cutting.source import Source
from morphkit.cutting.unused import Uses
from morphkit.description import Description, RobotInfo
from morphkit.errors import AblationError
from morphkit.io import read
from morphkit.mirror import counterparts, with_counterparts
from morphkit.morphology import Morphology
from morphkit.naming import canonical_limb_names, match_limbs

__all__ = ["Cutter", "Loss", "Variant", "Wish", "ablate", "select", "set_root_height"]

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


@dataclass(frozen=True, slots=True)
class Wish:
    """What a cut was asked for: exact names of limbs and fixed bodies."""

    remove: tuple[str, ...]
    splice: tuple[str, ...]
    keep: tuple[str, ...]


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
    description: Description,
    *,
    remove: Sequence[str] = (),
    splice: Sequence[str] = (),
    keep: Sequence[str] = (),
    mirror: bool = False,
    drop_assets: bool = False,
    name: str | None = None,
) -> Variant:
    """Cut limbs off a robot.

    Args:
        description: The robot; a URDF stays a URDF, an MJCF stays an MJCF.
        remove: Limbs that go with everything below them: names, globs or limb types, fixed bodies included.
        splice: Limbs that go while their children move up. Each child keeps its orientation in the world and is
            shifted so that its joint's anchor lies where that of the removed limb was. Bodies fixed to the limb go too.
        keep: Limbs that stay, with what connects them to the root; all others go. Combines with the other two.
        mirror: Whether everything that is asked for holds for its counterpart on the other side too; see
            `mirror.counterparts`.
        drop_assets: Whether meshes, height fields, materials and textures go that only removed limbs used.
        name: Name of the new robot; by default that of the source, `-no-`, and what was asked for.

    Raises:
        UnknownNameError: A pattern matches nothing.
        AblationError: A pattern matches the root, wishes contradict each other, or a limb has no counterpart.
        DescriptionError: The description cannot be read.
        AssetError: Limbs have to be written out by MuJoCo, which needs a mesh that is missing.
    """
    return Cutter(description).ablate(
        remove=remove, splice=splice, keep=keep, mirror=mirror, drop_assets=drop_assets, name=name
    )


class Cutter:
    """A robot opened for cutting, any number of times; what all its variants share is worked out once.

    Attributes:
        description: The robot.
        morphology: The same, read.
    """

    def __init__(self, description: Description) -> None:
        self.description = description
        self.morphology = read(description)
        self._images: dict[bool, dict[str, str]] = {}

    def ablate(
        self,
        *,
        remove: Sequence[str] = (),
        splice: Sequence[str] = (),
        keep: Sequence[str] = (),
        mirror: bool = False,
        drop_assets: bool = False,
        name: str | None = None,
    ) -> Variant:
        """See `ablate`."""
        wish = self.choose(remove=remove, splice=splice, keep=keep, mirror=mirror)
        if name is None:
            source = self.description.name
            if keep:
                source = "-".join([source, "only", *self._words(keep, mirror)])
            name = variant_name(source, [*self._words(remove, mirror), *self._words(splice, mirror)])
        variant = self.cut(remove=wish.remove, splice=wish.splice, drop_assets=drop_assets, name=name)
        limb_of = {member: limb.name for limb in self.morphology.limbs for member in limb.members}
        gone = [name for name in wish.keep if limb_of[name] not in variant.limbs]
        if gone:
            raise AblationError(
                f"{self.description.file}: {', '.join(gone)} cannot be kept, because what it hangs on is removed"
            )
        return variant

    def choose(
        self, *, remove: Sequence[str] = (), splice: Sequence[str] = (), keep: Sequence[str] = (), mirror: bool = False
    ) -> Wish:
        """The limbs and fixed bodies that patterns mean; see `ablate`."""
        image = self.counterparts() if mirror else {}
        chosen = {
            verb: with_counterparts(select(self.morphology, patterns), image, self.description.file)
            if mirror
            else select(self.morphology, patterns)
            for verb, patterns in (("removed", remove), ("spliced", splice), ("kept", keep))
        }
        for one, other in (("removed", "spliced"), ("kept", "removed"), ("kept", "spliced")):
            both = sorted(set(chosen[one]) & set(chosen[other]))
            if both:
                raise AblationError(f"{self.description.file}: {', '.join(both)} cannot be both {one} and {other}")
        removed, needed = chosen["removed"], self._needed(chosen["kept"])
        blocking = [limb for limb in removed if limb in needed]
        if blocking:
            raise AblationError(
                f"{self.description.file}: {', '.join(blocking)} cannot be removed, because limbs to keep hang on it;"
                " --splice takes it out from between"
            )
        if keep:
            others = [
                limb.name
                for limb in self.morphology.limbs
                if limb.name not in needed and (limb.parent is None or limb.parent in needed)
            ]
            removed = tuple(dict.fromkeys([*removed, *others]))
        return Wish(removed, chosen["spliced"], chosen["kept"])

    def cut(
        self, *, remove: Sequence[str], splice: Sequence[str] = (), drop_assets: bool = False, name: str
    ) -> Variant:
        """`ablate` with exact names of limbs and fixed bodies, none of them the root, and none below another."""
        description, morphology = self.description, self.morphology
        lost: list[Loss] = []
        if description.format == "urdf":
            source = self._urdf.again()
            plan = make_plan(morphology, urdf.link_parents(source.root), remove, splice)
            used = Uses(source.root) if drop_assets else None
            lost += urdf.cut(source.root, plan)
        else:
            file = self._mjcf.open([*remove, *splice])
            source = file.source
            plan = make_plan(morphology, mjcf.body_parents(file.bodies), remove, splice)
            lost += file.findings
            if plan.gone:
                lost += _name_left(file, plan)
            used = Uses(source.root) if drop_assets else None
            lost += mjcf.cut(source.root, file.bodies, plan, file.layout, file.bones)
        if used is not None:
            lost += used.drop(source.root)
        gone = plan.gone
        reported = [label for body, label in gone.items() if body == label]
        spliced = tuple(label for label in reported if label in plan.splice)
        return Variant(
            description=replace(
                description,
                name=name,
                file=_file_name(name, PurePath(description.file).suffix),
                source=source.render(),
                info=self._info(bool(gone)),
            ),
            removed=tuple(label for label in reported if label not in spliced),
            spliced=spliced,
            limbs=tuple(limb.name for limb in morphology.limbs if limb.name not in gone),
            lost=tuple(lost),
        )

    def adopt(self, variant: Variant) -> Variant:
        """Give a variant that a `Cutter` of the same robot made in another process what it shares with the source."""
        made = variant.description
        info = self._info(bool(variant.removed or variant.spliced))
        return replace(
            variant,
            description=replace(self.description, name=made.name, file=made.file, source=made.source, info=info),
        )

    def counterparts(self, *, strict: bool = False) -> dict[str, str]:
        """The mirror image of every limb and fixed body that has one; see `mirror.counterparts`."""
        if strict not in self._images:
            self._images[strict] = counterparts(self.morphology, self._positions, strict=strict)
        return self._images[strict]

    @cached_property
    def _positions(self) -> Positions:
        base = self.morphology.root.name
        if self.description.format == "urdf":
            return urdf_positions(self._urdf.root, base)
        file = self._mjcf.open([])
        return mjcf_positions(file.source.root, file.bodies, base) if base in file.bodies else {}

    @cached_property
    def _urdf(self) -> Source:
        return Source(self.description.source, file=self.description.file)

    @cached_property
    def _mjcf(self) -> MjcfOpener:
        return MjcfOpener(self.description)

    def _info(self, cut: bool) -> RobotInfo:
        info = self.description.info
        return replace(info, canonical=self._canonical, expert_return=None if cut else info.expert_return)

    @cached_property
    def _canonical(self) -> dict[str, str]:
        return canonical_limb_names(self.morphology, self.description.info.canonical)

    def _needed(self, kept: Sequence[str]) -> set[str]:
        """Kept limbs and all limbs above them; fixed bodies stay with their limbs."""
        limb_of = {member: limb.name for limb in self.morphology.limbs for member in limb.members}
        parents = {limb.name: limb.parent for limb in self.morphology.limbs}
        needed: set[str] = set()
        for name in kept:
            current: str | None = limb_of[name]
            while current is not None and current not in needed:
                needed.add(current)
                current = parents[current]
        return needed

    def _words(self, patterns: Sequence[str], mirror: bool) -> list[str]:
        words = _asked(patterns, self.morphology)
        if not mirror:
            return words
        return list(dict.fromkeys(part for word in words for part in (word, self.counterparts().get(word, word))))


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
