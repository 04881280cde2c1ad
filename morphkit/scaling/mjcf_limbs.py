"""Scale what belongs to the bodies of an MJCF: shapes, masses, joints, sites, cameras, and where limbs meet."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np

from morphkit.ablation.limb_scale import SAME, LimbScale
from morphkit.ablation.mjcf import first_anchor, read_angles
from morphkit.errors import AblationError
from morphkit.formats.mjcf_defaults import Defaults
from morphkit.formats.poses import Angles, text
from morphkit.scaling.attributes import multiply

_LENGTHS = {
    "frame": ("pos",),
    "geom": ("pos", "size", "fromto"),
    "site": ("pos", "size", "fromto"),
    "camera": ("pos",),
    "light": ("pos",),
    "inertial": ("pos",),
    "joint": ("pos",),
}
_SLIDE_LENGTHS = ("range", "ref", "springref", "springyield")
_KINDS = ("geom", "site", "joint")


@dataclass
class Limbs:
    """The bodies of an MJCF that are being scaled, and which limb its other elements name.

    Attributes:
        root: The `<mujoco>` element, includes flattened.
        bodies: Element of each body, by name, in file order.
        scales: Factors of each body of the robot.
        base: Name of the robot's root; its joints attach it to the world.
        parsed: What MuJoCo makes of the file before it is edited, for what default classes of several tags say.
        angles: How the file writes angles.
        defaults: The file's default classes.
        named: Factors of the limb of each named body, geom, site and joint, by kind and name.
        travel: Factor of the coordinate of each named joint.
    """

    root: Any
    bodies: Mapping[str, Any]
    scales: Mapping[str, LimbScale]
    base: str
    parsed: mujoco.MjSpec
    angles: Angles = field(init=False)
    defaults: Defaults = field(init=False)
    named: dict[tuple[str, str], LimbScale] = field(init=False)
    travel: dict[str, float] = field(init=False)
    _names: dict[int, str] = field(init=False)

    def __post_init__(self) -> None:
        self.angles, self.defaults = read_angles(self.root), Defaults(self.root)
        self.named, self.travel = {}, {}
        self._names = {id(element): name for name, element in self.bodies.items()}
        for name, scale in self.scales.items():
            self.named["body", name] = scale
            for element in own_elements(self.bodies[name]):
                if element.tag in _KINDS and element.get("name"):
                    self.named[element.tag, element.get("name")] = scale
                if element.tag == "joint" and element.get("name"):
                    self.travel[element.get("name")] = self._travel(element, name)

    def get(self, element: Any, attribute: str, fallback: str = "") -> str:
        """The value of an attribute that counts, default classes included."""
        return self.defaults.get(element, attribute, fallback)

    def multiply(self, element: Any, attribute: str, factor: float, fallback: str = "") -> None:
        """Write what counts for an attribute times `factor`."""
        multiply(element, attribute, factor, self.get(element, attribute, fallback))

    def scale(self) -> None:
        """Scale all bodies, but not the meshes that their geoms share."""
        places = {name: self._place(name) for name in self.scales if name != self.base}
        for name, scale in self.scales.items():
            for element in own_elements(self.bodies[name]):
                self._scale_element(element, name, scale)
        for name, place in places.items():
            if place is not None:
                self.bodies[name].set("pos", text(place))

    def _place(self, name: str) -> np.ndarray | None:
        """Where a body lies now, (3,): the joint that joins two limbs is at the same place of both; None for as before.

        Of the parent it is scaled with the parent, of the body itself with the body.
        """
        body = self.bodies[name]
        above = next(body.iterancestors("body"), None)
        outer = self.scales.get(self._names.get(id(above), ""), SAME)
        pose = self.angles.pose(body)
        anchor = pose.rotate(first_anchor(body, self.angles, self.defaults))
        place = outer.length * (pose.position + anchor) - self.scales[name].length * anchor
        return None if np.array_equal(place, pose.position) else place

    def _scale_element(self, element: Any, body: str, scale: LimbScale) -> None:
        tag = element.tag
        if tag == "geom":
            self._refuse_plugin(element, scale)
            self._scale_mass(element, scale)
        elif tag == "inertial":
            multiply(element, "mass", scale.total_mass)
            multiply(element, "diaginertia", scale.inertia)
            multiply(element, "fullinertia", scale.inertia)
        elif tag == "joint":
            self.multiply(element, "actuatorfrcrange", scale.gain)
            travel = self._travel(element, body)
            for attribute in _SLIDE_LENGTHS:
                self.multiply(element, attribute, travel)
            if body == self.base and self.get(element, "type") == "slide":
                return  # it stays where it is in the world
        for attribute in _LENGTHS.get(tag, ()):
            self.multiply(element, attribute, scale.length)

    def _scale_mass(self, geom: Any, scale: LimbScale) -> None:
        if self.get(geom, "mass"):
            self.multiply(geom, "mass", scale.total_mass)
        elif self._weighs(geom):
            # The walls of a hollow shape grow with it.
            self.multiply(geom, "density", scale.mass * (scale.length if self._is_shell(geom) else 1.0), "1000")

    def _weighs(self, geom: Any) -> bool:
        """Whether the mass of the geom's body follows from its geoms."""
        found = [each.get("inertiafromgeom") for each in self.root.iterfind("compiler") if each.get("inertiafromgeom")]
        from_geoms = found[-1] if found else "auto"
        stated = next(geom.iterancestors("body")).find("inertial") is not None
        return from_geoms == "true" or (from_geoms == "auto" and not stated)

    def _is_shell(self, geom: Any) -> bool:
        name = self.get(geom, "mesh")
        meshes = [each for each in self.root.iterfind("asset/mesh") if each.get("name") == name] if name else []
        return self.get(geom, "shellinertia") == "true" or any(self.get(mesh, "inertia") == "shell" for mesh in meshes)

    def _refuse_plugin(self, geom: Any, scale: LimbScale) -> None:
        if scale.length != 1 and geom.find("plugin") is not None:
            raise AblationError(
                f"line {geom.sourceline}: the shape of this <geom> is made by a plugin, which cannot be scaled; leave"
                " its limb's length as it is"
            )

    def _travel(self, joint: Any, body: str) -> float:
        slides = body != self.base and self.get(joint, "type", "hinge") == "slide"
        return self.scales[body].length if slides else 1.0


def own_elements(body: Any) -> Iterator[Any]:
    """What is in a body and its frames, bodies below it aside; in file order."""
    for child in body.iterchildren("*"):
        if child.tag != "body":
            yield child
        if child.tag == "frame":
            yield from own_elements(child)
