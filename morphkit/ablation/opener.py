"""Files ready to be cut, whichever format they have."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from morphkit.ablation.loss import Loss
from morphkit.ablation.plan import Plan
from morphkit.ablation.rest_pose import Positions
from morphkit.description import Description
from morphkit.formats.source import Source


class EditableFile(Protocol):
    """A file that is open for one cut."""

    @property
    def source(self) -> Source:
        """The file."""

    @property
    def findings(self) -> tuple[Loss, ...]:
        """What had to be done to the file before it could be cut."""

    def parents(self) -> dict[str, str | None]:
        """Parent of every body or link in file order; None at the top."""

    def cut(self, plan: Plan) -> list[Loss]:
        """Edit the file; return what went besides the limbs themselves."""


class Opener(Protocol):
    """Opens a description for cutting, any number of times; what all times share is done once."""

    def open(self, wanted: Sequence[str]) -> EditableFile:
        """Open the file for cutting at the bodies or links `wanted`."""

    def positions(self, base: str) -> Positions:
        """Where what hangs below `base` is in the robot's rest pose."""

    def set_height(self, root: str, height_m: float) -> bytes:
        """The file with its root at another height above the world's origin, m."""


def opener_of(description: Description) -> Opener:
    """The opener for the description's format."""
    if description.format == "urdf":
        from morphkit.ablation.urdf_document import UrdfOpener

        return UrdfOpener(description)
    from morphkit.ablation.mjcf_document import MjcfOpener

    return MjcfOpener(description)
