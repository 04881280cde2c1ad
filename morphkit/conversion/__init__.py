"""URDF into a simulatable MJCF."""

from __future__ import annotations

from morphkit.conversion.convert import Conversion, convert
from morphkit.conversion.unsupported import Missing
from morphkit.conversion.write import write_conversion

__all__ = ["Conversion", "Missing", "convert", "write_conversion"]
