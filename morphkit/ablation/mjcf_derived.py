"""What MuJoCo works out from a whole MJCF robot, and so differs in what is left of it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from morphkit.ablation.loss import Loss
from morphkit.formats.mjcf_defaults import Defaults


def changed(root: Any) -> Iterator[Loss]:
    """Say what MuJoCo scales or works out anew once limbs are gone from the tree below the `<mujoco>` element.

    These are all masses under `settotalmass`, and what is given by a damping ratio or for muscles by an acceleration:
    it follows from the inertia that a joint moves.
    """
    total = next((c.get("settotalmass") for c in reversed(root.findall("compiler")) if c.get("settotalmass")), "-1")
    if _number(total) > 0:
        reason = f"masses and inertias of all that is left are scaled, so that it weighs {total} kg as before"
        yield Loss("compiler", "settotalmass", "", reason)
    defaults = Defaults(root)
    inertia = "worked out anew from the inertia that is left"
    for joint in root.iter("joint"):
        ratio = defaults.get(joint, "springdamper", "").split()
        if _within(joint, "worldbody") and any(_number(word) > 0 for word in ratio):
            yield Loss("joint", joint.get("name", ""), "", f"springdamper: stiffness and damping are {inertia}")
    for drive in root.iterfind("actuator/*"):
        name = drive.get("name") or drive.get("joint") or drive.get("tendon") or ""
        if drive.tag in ("position", "intvelocity") and _number(defaults.get(drive, "dampratio", "0")) > 0:
            yield Loss("actuator", name, "", f"dampratio: its damping is {inertia}")
        if drive.tag == "muscle" and _number(defaults.get(drive, "force", "-1")) < 0:
            yield Loss("actuator", name, "", f"muscle: its peak force is {inertia}")


def _within(element: Any, tag: str) -> bool:
    return any(above.tag == tag for above in element.iterancestors())


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return 0.0
