"""Scale the limbs of a URDF."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from morphkit.ablation.limb_scale import SAME, LimbScale
from morphkit.ablation.loss import Loss
from morphkit.ablation.urdf import ends
from morphkit.ablation.urdf_document import UrdfOpener
from morphkit.description import Description
from morphkit.formats.urdf_names import take_back
from morphkit.scaling.attributes import multiply

_SIZES = {"box": ("size",), "cylinder": ("radius", "length"), "capsule": ("radius", "length"), "sphere": ("radius",)}
_MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def scale_urdf(description: Description, scales: Mapping[str, LimbScale]) -> tuple[Description, list[Loss]]:
    """A URDF with other limbs, and what could not be scaled; `scales` are by link, fixed links included."""
    file = UrdfOpener(description).open([])
    root = file.source.root
    lost = [loss for link in root.iterfind("link") for loss in _scale_link(link, _of(link, scales))]
    joints = {str(joint.get("name")): joint for joint in root.iterfind("joint")}
    for joint in joints.values():
        parent, child = ends(joint)
        _scale_joint(joint, scales.get(parent, SAME), scales.get(child, SAME))
    for joint in joints.values():
        leader = next((joints.get(each.get("joint", "")) for each in joint.iterfind("mimic")), None)
        if leader is not None:
            _scale_mimic(joint.find("mimic"), _travel(joint, scales), _travel(leader, scales))
    for block in root.iterfind("gazebo"):
        for pose in block.iter("pose"):
            _scale_pose(pose, scales.get(block.get("reference", ""), SAME))
    take_back(file.given, root)
    return replace(description, source=file.source.render()), lost


def _of(link: Any, scales: Mapping[str, LimbScale]) -> LimbScale:
    return scales.get(link.get("name", ""), SAME)


def _scale_link(link: Any, scale: LimbScale) -> Iterator[Loss]:
    inertial = link.find("inertial")
    for part in link.iterchildren("inertial", "visual", "collision"):
        for origin in part.iterfind("origin"):
            multiply(origin, "xyz", scale.length)
        for shape in part.iterfind("geometry/*"):
            for attribute in _SIZES.get(shape.tag, ()):
                multiply(shape, attribute, scale.length)
            if shape.tag == "mesh":
                multiply(shape, "scale", scale.length, shape.get("scale") or "1 1 1")
    if inertial is None:
        if scale.total_mass != 1:
            yield Loss("mass", link.get("name", ""), "", "the link has no <inertial>, so it has no mass to scale")
        return
    for mass in inertial.iterfind("mass"):
        multiply(mass, "value", scale.total_mass)
    for inertia in inertial.iterfind("inertia"):
        for moment in _MOMENTS:
            multiply(inertia, moment, scale.inertia)


def _scale_joint(joint: Any, parent: LimbScale, child: LimbScale) -> None:
    for origin in joint.iterfind("origin"):
        multiply(origin, "xyz", parent.length)
    travel = child.length if joint.get("type") == "prismatic" else 1.0
    for limit in joint.iterfind("limit"):
        multiply(limit, "effort", child.gain)
        for attribute in ("lower", "upper"):
            multiply(limit, attribute, travel)
    for controller in joint.iterfind("safety_controller"):
        for attribute in ("soft_lower_limit", "soft_upper_limit"):
            multiply(controller, attribute, travel)


def _travel(joint: Any, scales: Mapping[str, LimbScale]) -> float:
    """Factor of a joint's coordinate."""
    return scales.get(ends(joint)[1], SAME).length if joint.get("type") == "prismatic" else 1.0


def _scale_mimic(mimic: Any, follower: float, leader: float) -> None:
    multiply(mimic, "multiplier", follower / leader, mimic.get("multiplier") or "1")
    multiply(mimic, "offset", follower)


def _scale_pose(pose: Any, scale: LimbScale) -> None:
    """Scale the place in a Gazebo `<pose>x y z roll pitch yaw</pose>`."""
    if pose.get("relative_to") or not (pose.text or "").strip() or scale.length == 1:
        return
    held = pose.makeelement("pose", {"text": pose.text})
    multiply(held, "text", (scale.length,) * 3)
    pose.text = held.get("text")
