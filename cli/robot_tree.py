"""A robot as a tree in the terminal: limbs, joints and actuators."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from rich.tree import Tree

from morphkit.morphology import Actuator, Joint, Limb, Morphology

from .terminal import assembled, line

if TYPE_CHECKING:
    from rich.text import Text

    from morphkit.simulation.limb_inertia import LimbMass

_NAME, _TYPE, _JOINT, _ACTUATOR, _QUIET = "bold cyan", "magenta", "green", "yellow", "dim"


def tree(
    morphology: Morphology, *, masses: Mapping[str, LimbMass | None] | None = None, base_joints: Sequence[Joint] = ()
) -> Tree:
    """The limbs of a robot as a tree for rich: types, masses, joints with their ranges, actuators with theirs.

    Angles are in degrees, lengths in meters. Actuators that drive no single limb are at the end.

    Args:
        morphology: The robot.
        masses: Mass of every limb, as `masses.limb_masses` finds them; None leaves them out.
        base_joints: Joints of the root, which the morphology does not hold.
    """
    root = Tree(_title(morphology, masses), guide_style=_QUIET)
    branches: dict[str | None, Tree] = {None: root}
    for limb in morphology.limbs:
        joints = limb.joints if limb.parent is not None else tuple(base_joints)
        branches[limb.name] = branches[limb.parent].add(_limb_text(limb, joints, morphology, masses))
    loose = [actuator for actuator in morphology.actuators if actuator.limb is None]
    if loose:
        branch = root.add(line("actuators that drive no single limb", _QUIET))
        for actuator in loose:
            branch.add(_actuator_text(actuator))
    return root


def _title(morphology: Morphology, masses: Mapping[str, LimbMass | None] | None) -> Text:
    facts = [
        morphology.format.upper(),
        f"{morphology.base} base",
        _count(len(morphology.limbs), "limb"),
        _count(len(morphology.joints), "joint"),
        _count(len(morphology.actuators), "actuator"),
    ]
    if masses is not None:
        known = [mass.mass for mass in masses.values() if mass is not None]
        facts.append(f"{'' if len(known) == len(masses) else 'at least '}{sum(known):.4g} kg")
    return assembled((morphology.name, "bold"), ("  " + " · ".join(facts), _QUIET))


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def _limb_text(
    limb: Limb, joints: Sequence[Joint], morphology: Morphology, masses: Mapping[str, LimbMass | None] | None
) -> Text:
    text = assembled((limb.name, _NAME))
    if limb.type is not None:
        text.append_text(line(f"  {limb.type}", _TYPE))
    if masses is not None:
        mass = masses[limb.name]
        text.append("  mass unknown" if mass is None else f"  {mass.mass:.4g} kg", style=_QUIET)
    own = [actuator for actuator in morphology.actuators if actuator.limb == limb.name]
    for joint in joints:
        text.append("\n")
        text.append_text(_joint_text(joint))
        for actuator in own:
            if actuator.joint == joint.name:
                text.append("  ")
                text.append_text(_actuator_text(actuator))
    for actuator in own:
        if actuator.joint not in {joint.name for joint in joints}:
            text.append("\n")
            text.append_text(_actuator_text(actuator))
    fixed = [member for member in limb.members if member != limb.name]
    if fixed:
        text.append("\n").append_text(line(f"fixed to it: {', '.join(fixed)}", _QUIET))
    return text


def _joint_text(joint: Joint) -> Text:
    if not joint.limited:
        extent = "unlimited"
    elif joint.kind == "slide":
        extent = f"{joint.low:.4g} to {joint.high:.4g} m"
    else:
        extent = f"{math.degrees(joint.low):.1f} to {math.degrees(joint.high):.1f}°"
    return assembled((f"{joint.kind} ", _QUIET), (joint.name, _JOINT), f" {extent}")


def _actuator_text(actuator: Actuator) -> Text:
    unit = "" if actuator.unit == "1" else f" {actuator.unit}"
    bounded = math.isfinite(actuator.low) and math.isfinite(actuator.high)
    extent = f"{actuator.low:.4g} to {actuator.high:.4g}{unit}" if bounded else f"unbounded{unit}"
    return assembled(("actuator ", _QUIET), (actuator.name, _ACTUATOR), f" {extent}")
