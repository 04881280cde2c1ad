"""Readers: a robot description file becomes a `Morphology`."""

from __future__ import annotations

from morphkit.description import Description
from morphkit.formats.isolation import expanding, isolated
from morphkit.morphology import Morphology


def read(description: Description) -> Morphology:
    """Read a description, whichever format it has; what was read before is given again.

    Raises:
        DescriptionError: The file is not a URDF or MJCF description that makes sense; the message says where.
        AssetError: A file that it includes is missing. Missing meshes do not matter.
        UnknownNameError: `description.root` is no top-level body or link.
    """
    if description.morphology is None:
        if description.format == "urdf":
            from morphkit.readers.urdf import read_urdf as read_format
        else:
            from morphkit.readers.mjcf import read_mjcf as read_format
        description.keep(morphology=isolated(read_format, description, expanding(description)))
    assert description.morphology is not None
    return description.morphology
