"""morphkit: robot description files into named tokens and sub-morphologies.

    import morphkit

    robot = morphkit.load("cheetah")
    spec = morphkit.token_spec(morphkit.read(robot))
    variant = morphkit.ablate(robot, remove=["foot"])
    family = list(morphkit.sub_morphologies(robot))

Everything is imported on first use, so that `import morphkit` costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from morphkit import families
    from morphkit.ablation.ablate import Variant, ablate
    from morphkit.ablation.limb_scale import LimbScale
    from morphkit.ablation.loss import Loss
    from morphkit.comparison.compare import Comparison, compare
    from morphkit.conversion.convert import Conversion, convert
    from morphkit.conversion.write import write_conversion
    from morphkit.description import Description, RobotInfo
    from morphkit.errors import MorphkitError
    from morphkit.families.enumeration import sub_morphologies
    from morphkit.families.manifest import read_manifest
    from morphkit.families.scaled import scaled_variants
    from morphkit.families.write import write_family
    from morphkit.morphology import Actuator, Joint, Limb, Morphology, Sensor
    from morphkit.readers import read
    from morphkit.registry import load, load_all, recipes, shipped
    from morphkit.scaling.draw import ScaleRanges
    from morphkit.scaling.scale import scale_limbs
    from morphkit.tokens.spec import ActuatorToken, SensorToken, TokenSpec, token_spec
    from morphkit.validation.check import check
    from morphkit.validation.findings import Finding, Report

_MODULES = {
    "morphkit.ablation.ablate": ("Variant", "ablate"),
    "morphkit.ablation.limb_scale": ("LimbScale",),
    "morphkit.ablation.loss": ("Loss",),
    "morphkit.comparison.compare": ("Comparison", "compare"),
    "morphkit.conversion.convert": ("Conversion", "convert"),
    "morphkit.conversion.write": ("write_conversion",),
    "morphkit.description": ("Description", "RobotInfo"),
    "morphkit.errors": ("MorphkitError",),
    "morphkit.families.enumeration": ("sub_morphologies",),
    "morphkit.families.manifest": ("read_manifest",),
    "morphkit.families.scaled": ("scaled_variants",),
    "morphkit.families.write": ("write_family",),
    "morphkit.morphology": ("Actuator", "Joint", "Limb", "Morphology", "Sensor"),
    "morphkit.readers": ("read",),
    "morphkit.registry": ("load", "load_all", "recipes", "shipped"),
    "morphkit.scaling.draw": ("ScaleRanges",),
    "morphkit.scaling.scale": ("scale_limbs",),
    "morphkit.tokens.spec": ("ActuatorToken", "SensorToken", "TokenSpec", "token_spec"),
    "morphkit.validation.check": ("check",),
    "morphkit.validation.findings": ("Finding", "Report"),
}
_HOME = {name: module for module, names in _MODULES.items() for name in names}

__all__ = [
    "Actuator",
    "ActuatorToken",
    "Comparison",
    "Conversion",
    "Description",
    "Finding",
    "Joint",
    "Limb",
    "LimbScale",
    "Loss",
    "MorphkitError",
    "Morphology",
    "Report",
    "RobotInfo",
    "ScaleRanges",
    "Sensor",
    "SensorToken",
    "TokenSpec",
    "Variant",
    "__version__",
    "ablate",
    "check",
    "compare",
    "convert",
    "families",
    "load",
    "load_all",
    "read",
    "read_manifest",
    "recipes",
    "scale_limbs",
    "scaled_variants",
    "shipped",
    "sub_morphologies",
    "token_spec",
    "write_conversion",
    "write_family",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("morphkit")
    if name == "families":
        return importlib.import_module("morphkit.families")
    if name not in _HOME:
        raise AttributeError(f"module 'morphkit' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return __all__
