"""A URDF ready to be cut."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from morphkit.ablation import urdf
from morphkit.ablation.loss import Loss
from morphkit.ablation.plan import Plan
from morphkit.ablation.rest_pose import Positions, urdf_positions
from morphkit.description import Description
from morphkit.errors import AblationError
from morphkit.formats.document import document_of
from morphkit.formats.source import Source
from morphkit.formats.urdf_names import Given, name_elements


@dataclass(frozen=True)
class UrdfFile:
    """An editable URDF.

    Attributes:
        source: The file, its links and joints named as the reader names them.
        given: Those names, which a cut takes back.
        findings: What had to be done to the file before it could be cut: nothing.
    """

    source: Source
    given: Given
    findings: tuple[Loss, ...] = ()

    def parents(self) -> dict[str, str | None]:
        """Parent of every link in depth-first file order; None at the top."""
        return urdf.link_parents(self.source.root)

    def cut(self, plan: Plan) -> list[Loss]:
        """Edit the file; return what went besides the links themselves."""
        return urdf.cut(self.source.root, plan, self.given)


class UrdfOpener:
    """Opens a URDF for cutting, any number of times; what all times share is done once."""

    def __init__(self, description: Description) -> None:
        self._description = description

    def open(self, wanted: Sequence[str]) -> UrdfFile:
        """Open the file for cutting at the links `wanted`."""
        source = self._source.again()
        return UrdfFile(source, name_elements(source.root, file=self._description.file))

    def positions(self, base: str) -> Positions:
        """Where the joints of the robot are in its rest pose, seen from the link `base`."""
        return urdf_positions(self.open([]).source.root, base)

    def set_height(self, root: str, height_m: float) -> bytes:
        """Refuse: a URDF has no word for it.

        Raises:
            AblationError: Always.
        """
        raise AblationError(
            f"{self._description.file}: a URDF does not say where its root link is, so its height cannot be set; the"
            " simulation places it on the floor"
        )

    @cached_property
    def _source(self) -> Source:
        return Source(document_of(self._description))
