"""What is changed in a URDF before it is read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Repair:
    """A change to a URDF.

    Attributes:
        rule: Id of the finding that tells of it.
        element: The lxml element at which it was made.
        name: Name of the link or joint that it belongs to.
        text: What was changed, a sentence for people.
    """

    rule: str
    element: Any
    name: str
    text: str
