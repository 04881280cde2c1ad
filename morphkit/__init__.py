"""morphkit: robot description files into named tokens and sub-morphologies.

    import morphkit

    robot = morphkit.load("cheetah")
    spec = morphkit.token_spec(morphkit.read(robot))
    family = list(morphkit.sub_morphologies(robot))

Everything is imported on first use, so that `import morphkit` costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from morphkit.ablation.ablate import Loss, Variant, ablate
    from morphkit.description import Description, RobotInfo
    from morphkit.errors import MorphkitError
    from morphkit.families.enumeration import sub_morphologies
    from morphkit.families.manifest import read_manifest
    from morphkit.families.write import write_family
    from morphkit.morphology import Actuator, Joint, Limb, Morphology, Sensor
    from morphkit.readers import read
    from morphkit.registry import load, load_all, recipes, shipped
    from morphkit.tokens.spec import ActuatorToken, SensorToken, TokenSpec
    from morphkit.tokens.spec import token_spec as token_spec

_MODULES = {
    "morphkit.ablation.ablate": ("Loss", "Variant", "ablate"),
    "morphkit.description": ("Description", "RobotInfo"),
    "morphkit.errors": ("MorphkitError",),
    "morphkit.families.enumeration": ("sub_morphologies",),
    "morphkit.io": ("read",),
    "morphkit.families.manifest": ("read_manifest",),
    "morphkit.morphology": ("Actuator", "Joint", "Limb", "Morphology", "Sensor"),
    "morphkit.registry": ("load", "load_all", "recipes", "shipped"),
    "morphkit.families.write": ("write_family",),
    "morphkit.tokens.spec": ("ActuatorToken", "SensorToken", "TokenSpec"),
}
_HOME = {name: module for module, names in _MODULES.items() for name in names}

__all__ = [
    "Actuator",
    "ActuatorToken",
    "Description",
    "Joint",
    "Limb",
    "Loss",
    "MorphkitError",
    "Morphology",
    "RobotInfo",
    "Sensor",
    "SensorToken",
    "TokenSpec",
    "Variant",
    "__version__",
    "ablate",
    "load",
    "load_all",
    "read",
    "read_manifest",
    "recipes",
    "shipped",
    "sub_morphologies",
    "token_spec",
    "write_family",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("morphkit")
    if name == "token_spec":
        return importlib.import_module("morphkit.tokens.spec").tokens
    if name not in _HOME:
        raise AttributeError(f"module 'morphkit' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return __all__
