"""Cut limbs off a robot: prune takes a limb with all below it, splice takes one limb and moves its children up.

The XML source is edited, not rewritten: what a cut does not touch stays byte for byte.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import PurePath

from morphkit.ablation.limb_scale import LimbScale
from morphkit.ablation.loss import Loss
from morphkit.ablation.opener import Opener, opener_of
from morphkit.ablation.plan import make_plan
from morphkit.ablation.symmetry import counterparts
from morphkit.ablation.targets import UNSAFE, Wish, choose, wish_name
from morphkit.ablation.unused_assets import Uses
from morphkit.description import Description, RobotInfo
from morphkit.errors import AblationError
from morphkit.naming.limbs import canonical_limb_names
from morphkit.readers import read

__all__ = ["Cutter", "Loss", "Variant", "ablate", "set_root_height"]

_LONGEST = 160


@dataclass(frozen=True)
class Variant:
    """A robot that was cut out of another.

    Attributes:
        description: The new robot; its info carries the source's canonical names and labels.
        removed: Every limb that went with a prune, in file order; also a fixed body whose limb stays.
        spliced: Every limb that went while its children moved up, in file order.
        limbs: The limbs that are left, in file order.
        lost: What else went or changed.
        scaled: Factors of the limbs that were scaled afterwards; see `scaling`.
    """

    description: Description
    removed: tuple[str, ...]
    spliced: tuple[str, ...]
    limbs: tuple[str, ...]
    lost: tuple[Loss, ...]
    scaled: Mapping[str, LimbScale] = field(default_factory=dict)


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
        wish, own_name = self.wish(remove=remove, splice=splice, keep=keep, mirror=mirror)
        variant = self.cut(remove=wish.remove, splice=wish.splice, drop_assets=drop_assets, name=name or own_name)
        limb_of = {member: limb.name for limb in self.morphology.limbs for member in limb.members}
        gone = [name for name in wish.keep if limb_of[name] not in variant.limbs]
        if gone:
            raise AblationError(
                f"{self.description.file}: {', '.join(gone)} cannot be kept, because what it hangs on is removed"
            )
        return variant

    def wish(
        self,
        *,
        remove: Sequence[str] = (),
        splice: Sequence[str] = (),
        keep: Sequence[str] = (),
        mirror: bool = False,
    ) -> tuple[Wish, str]:
        """What `ablate` is asked for, in exact names, and the name of the variant."""
        image = self.counterparts() if mirror else None
        asked = {"remove": remove, "splice": splice, "keep": keep}
        wish = choose(self.morphology, **asked, image=image)
        return wish, wish_name(self.morphology, **asked, image=image)

    def cut(
        self, *, remove: Sequence[str], splice: Sequence[str] = (), drop_assets: bool = False, name: str
    ) -> Variant:
        """`ablate` with exact names of limbs and fixed bodies, none of them the root, and none below another."""
        description, morphology = self.description, self.morphology
        file = self._opener.open([*remove, *splice])
        plan = make_plan(morphology, file.parents(), remove, splice)
        used = Uses(file.source.root) if drop_assets else None
        lost = [*file.findings, *file.cut(plan)]
        if used is not None:
            lost += used.drop(file.source.root)
        gone = plan.gone
        reported = [label for body, label in gone.items() if body == label]
        spliced = tuple(label for label in reported if label in plan.splice)
        return Variant(
            description=replace(
                description,
                name=name,
                file=file_name(name, PurePath(description.file).suffix),
                source=file.source.render(),
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
            positions = self._opener.positions(self.morphology.root.name)
            self._images[strict] = counterparts(self.morphology, positions, strict=strict)
        return self._images[strict]

    @cached_property
    def _opener(self) -> Opener:
        return opener_of(self.description)

    def _info(self, cut: bool) -> RobotInfo:
        info = self.description.info
        return replace(
            info,
            canonical=self._canonical,
            labels={**info.labels, **self.morphology.labels},
            expert_return=None if cut else info.expert_return,
        )

    @cached_property
    def _canonical(self) -> dict[str, str]:
        return canonical_limb_names(self.morphology, self.description.info.canonical)


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
    return replace(description, source=opener_of(description).set_height(read(description).root.name, height_m))


def file_name(name: str, suffix: str) -> str:
    """A file name that every file system takes; long ones are cut and end in a hash of the whole."""
    safe = UNSAFE.sub("_", name).lstrip(".") or "robot"
    if len(safe) > _LONGEST:
        safe = f"{safe[: _LONGEST - 9]}-{hashlib.sha256(name.encode()).hexdigest()[:8]}"
    return safe + suffix
