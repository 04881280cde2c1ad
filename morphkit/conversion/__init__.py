"""URDF into a simulatable MJCF."""

from __future__ import annotations

from morphkit.conversion.converting import Conversion, convert
from morphkit.conversion.counterparts import Missing
from morphkit.conversion.writing import write_conversion

__all__ = ["Conversion", "Missing", "convert", "write_conversion"]
