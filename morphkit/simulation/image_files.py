"""Image files of textures and height fields, of which the size is looked at before any pixel."""

from __future__ import annotations

from pathlib import Path

from morphkit.errors import AssetError
from morphkit.formats.budgets import HEAD_BYTES, NUMBERS, image_size
from morphkit.formats.limits import MESH_BYTES

ALL_PIXELS = 2 * NUMBERS
"""Pixels of all images of a robot."""


class ImageReader:
    """Reads the images of one robot as long as they have no more pixels than it may have."""

    def __init__(self) -> None:
        self._left = ALL_PIXELS

    def read(self, path: Path) -> bytes:
        """The bytes of an image file.

        Raises:
            AssetError: It has more than 2^26 pixels, those read up to now have more than 2^27 with it, or it is larger
                than 512 MiB.
            OSError: It cannot be read.
        """
        size = path.stat().st_size
        if size > MESH_BYTES:
            raise AssetError(
                f"{path}: {size / 2**20:.0f} MiB of image, more than the limit of {MESH_BYTES // 2**20} MiB"
            )
        with path.open("rb") as file:
            width, height = image_size(file.read(HEAD_BYTES)) or (1, size)
        if width * height > NUMBERS:
            raise AssetError(f"{path}: {width:,} x {height:,} pixels, more than the limit of {NUMBERS:,}")
        self._left -= width * height
        if self._left < 0:
            raise AssetError(f"{path}: the images up to this one have more than {ALL_PIXELS:,} pixels in all")
        return path.read_bytes()
