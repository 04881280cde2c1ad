"""Readers: a robot description file becomes a `Morphology`."""

from __future__ import annotations

from morphkit.description import Description
from morphkit.morphology import Morphology


def read(description: Description) -> Morphology:
    """Read a description, whichever format it has.

    Raises:
        DescriptionError: The file is not a URDF or MJCF description that makes sense; the message says where.
        AssetError: A file that it includes is missing. Missing meshes do not matter.
        UnknownNameError: `description.root` is no top-level body or link.
    """
    if description.format == "urdf":
        from morphkit.readers.urdf import read_urdf

        return read_urdf(description)
    from morphkit.readers.mjcf import read_mjcf

    return read_mjcf(description)
