"""A robot description: the bytes of a URDF or MJCF file and what is known about it."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

from morphkit.morphology import Base, Format, Morphology

Actuation = Literal["torque", "position", "as-file"]
"""How motors are driven: by torques, by target positions around the start pose, or as the file says."""


@dataclass(frozen=True, slots=True)
class RobotInfo:
    """What learning needs to know of a robot besides its file; from `robot.toml` or a manifest.

    Attributes:
        description: One line for people.
        license: SPDX identifier of the file's license.
        source: Where the robot's numbers come from.
        family: Name of the family; robots of a family share type words.
        type_words: One group of words a limb type, in the order of the `type_*` tokens.
        type_matched_in: Whether the words are looked for in the limb's body name or in the name of its joint.
        canonical: Raw limb name -> its name in plain words, where the rules of `naming` would not find it.
        labels: Limb name -> what tokens call it, of limbs whose names read like those of others that were cut off.
        task: Name of the task that the robot is meant for.
        base: How the root is attached to the world, where the file leaves it open.
        start: Start pose: the coordinates of joints by name, rad or m; or `zero`: the file's zero pose, whatever the
            limits; or `middle`: joints whose zero lies outside of their limits start in the middle of these; or the
            name of a keyframe. Empty: as `simulation.start_pose` has it.
        healthy_height: Overrides the task's healthy height of the root, m.
        expert_return: Return of a single-robot expert, to normalize scores with.
        actuation: How its motors are driven; see `simulation.actuation`.
        gains: Joint name, or a pattern such as `*_hip_joint` -> stiffness, N*m/rad (N/m), and damping, N*m*s/rad
            (N*s/m), of its servo; the first pattern that matches counts.
        action_scale: How far targets go from the start pose, as a share of 0.5 rad or of a quarter of a slide's travel.
        control_frequency: Control steps per second, Hz; None takes the task's.
    """

    description: str = ""
    license: str = ""
    source: str = ""
    family: str | None = None
    type_words: tuple[tuple[str, ...], ...] = ()
    type_matched_in: Literal["body", "joint"] = "body"
    canonical: dict[str, str] = field(default_factory=dict)
    labels: dict[str, str] = field(default_factory=dict)
    task: str | None = None
    base: Base | None = None
    start: str | dict[str, float] = ""
    healthy_height: tuple[float, float] | None = None
    expert_return: float | None = None
    actuation: Actuation | None = None
    gains: dict[str, tuple[float, float]] = field(default_factory=dict)
    action_scale: float | None = None
    control_frequency: float | None = None


@dataclass(frozen=True, slots=True)
class Description:
    """A robot description file in memory.

    Attributes:
        name: Name of the robot or variant.
        file: Basename of the file.
        format: `urdf` or `mjcf`, from the root element.
        source: The bytes of the file.
        folder: Where relative paths of meshes and includes start; None for a description without assets.
        info: What is in `robot.toml` or in the manifest.
        root: Name of the top-level body or link to take, where the file has several.
        packages: Folder of each ROS package or Gazebo model that the user named, by name.
        document: What `source` was parsed to, once somebody has asked; see `formats.document.document_of`.
        morphology: What was read of the description, once somebody has asked; see `readers.read`.
    """

    name: str
    file: str
    format: Format
    source: bytes
    folder: Path | None = None
    info: RobotInfo = field(default_factory=RobotInfo)
    root: str | None = None
    packages: Mapping[str, Path] = field(default_factory=dict)
    document: Any = field(default=None, compare=False, repr=False)
    morphology: Morphology | None = field(default=None, init=False, compare=False, repr=False)

    def keep(self, document: Any = None, morphology: Morphology | None = None) -> None:
        """Remember what the source was parsed to, or what was read of it, for all who ask again."""
        if document is not None:
            object.__setattr__(self, "document", document)
        if morphology is not None:
            object.__setattr__(self, "morphology", morphology)

    def __reduce__(self) -> tuple[Any, ...]:
        values = (getattr(self, each.name) for each in fields(self) if each.name not in ("document", "morphology"))
        return type(self), tuple(values)

    @property
    def sha256(self) -> str:
        """SHA-256 of the source, hexadecimal."""
        return hashlib.sha256(self.source).hexdigest()
