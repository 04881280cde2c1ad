"""What a robot is made of: a frozen value without a handle on XML or MuJoCo."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal

Format = Literal["urdf", "mjcf"]
Base = Literal["free", "planar", "fixed"]
JointKind = Literal["hinge", "slide", "ball", "free"]


@dataclass(frozen=True, slots=True)
class Joint:
    """A moving joint of a limb.

    Attributes:
        name: Name in the description file.
        kind: `hinge` (URDF: revolute, continuous), `slide` (prismatic), `ball` or `free`.
        limited: Whether `low` and `high` bound the joint.
        low: Lower limit in rad (hinge, ball) or m (slide); 0 where unlimited.
        high: Upper limit in rad or m; 0 where unlimited.
    """

    name: str
    kind: JointKind
    limited: bool
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Limb:
    """A body (URDF: link) with its moving joints.

    Attributes:
        name: Name of the body or link.
        parent: Name of the parent limb; None for the root.
        joints: Moving joints in file order. The root has none: its base joints are no part of the robot's tokens.
        members: Names of the bodies that move as this limb, its own first, then those fixed to it, in file order.
        type: The family's type word that the limb matches, such as `thigh`; None where none does.
    """

    name: str
    parent: str | None
    joints: tuple[Joint, ...]
    members: tuple[str, ...]
    type: str | None = None


@dataclass(frozen=True, slots=True)
class Actuator:
    """One control input.

    Attributes:
        name: Name in the file; where it has none, that of what it drives.
        limb: The limb that it drives; None where it drives no single limb, such as a tendon.
        joint: The joint that it drives; None where it drives no single joint.
        low: Lower bound of the control, -inf where unbounded.
        high: Upper bound of the control, inf where unbounded.
        unit: Unit of the control: `1` for a normalized motor (gear other than 1), else `N*m`, `N`, `rad`, `m`, ...
    """

    name: str
    limb: str | None
    joint: str | None
    low: float
    high: float
    unit: str


@dataclass(frozen=True, slots=True)
class Reading:
    """One scalar of a declared sensor.

    Attributes:
        quantity: What is read, such as `gyro` or `linear_acceleration`.
        component: `x`, `w`, `from_x`, a number, ...; None where the sensor reads one scalar only.
        unit: Unit, `1` for a share, a flag or part of a unit vector.
        frame: `world`, `contact`, or the name of the site, body or link whose frame it is; None without a frame.
        low: What the reading is bounded by from below; None where it is not.
        high: What the reading is bounded by from above; None where it is not.
    """

    quantity: str
    component: str | None
    unit: str
    frame: str | None = None
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True, slots=True)
class Sensor:
    """A sensor that the file itself declares.

    Attributes:
        name: Name in the file; where it has none, its kind and what it is attached to.
        kind: Kind of sensor: MuJoCo's (`framepos`, `touch`) or that of URDF and Gazebo (`imu`, `camera`).
        limb: The limb that it belongs to; None where it belongs to no single limb.
        readings: Its scalars in their order; none for cameras, lidars and sensors of a size that the file does not say.
    """

    name: str
    kind: str
    limb: str | None
    readings: tuple[Reading, ...] = ()


@dataclass(frozen=True, slots=True)
class Origin:
    """Where the element comes from that a name was given to.

    Attributes:
        given: The name: unique among elements of its kind.
        kind: `body`, `link`, `joint`, `actuator` or `sensor`.
        original: Name that the file has for it; None where it has none. Copies that `replicate` and `attach` make have
            that of the element copied.
        where: `file:line`; None where that is not known, as for bodies that `flexcomp` makes.
        id: Its id in the model that MuJoCo compiles of an MJCF file as it is; of an actuator with several inputs, that
            of the actuator. None for a URDF.
    """

    given: str
    kind: str
    original: str | None
    where: str | None
    id: int | None = None


@dataclass(frozen=True, slots=True)
class Morphology:
    """A robot: limbs in depth-first file order (root first), actuators and declared sensors in file order.

    Attributes:
        name: Name of the robot or variant.
        file: Basename of the description file.
        format: `urdf` or `mjcf`.
        sha256: SHA-256 of the source bytes, hexadecimal.
        base: How the root is attached to the world.
        family: Name of the family, such as `cheetah`; None for a robot without one.
        task: Name of the task that it is meant for; None where nothing says.
        type_words: One group of words a limb type; the order is that of the one-hot `type_*` tokens.
        labels: What tokens call limbs whose own names read like others', by limb name; see `naming.numbered_labels`.
        origins: Where the names of bodies (links), joints, actuators and sensors come from, kind by kind in file order.
            Where a robot is in its file does not make it another: they do not count in comparisons.
    """

    name: str
    file: str
    format: Format
    sha256: str
    base: Base
    family: str | None
    task: str | None
    type_words: tuple[tuple[str, ...], ...]
    limbs: tuple[Limb, ...]
    actuators: tuple[Actuator, ...]
    sensors: tuple[Sensor, ...] = ()
    labels: Mapping[str, str] = field(default_factory=dict, hash=False)
    origins: tuple[Origin, ...] = field(default=(), compare=False)

    @property
    def root(self) -> Limb:
        """The limb without a parent."""
        return self.limbs[0]

    @property
    def joints(self) -> tuple[Joint, ...]:
        """All moving joints, limb by limb."""
        return tuple(joint for limb in self.limbs for joint in limb.joints)

    def limb(self, name: str) -> Limb:
        """Return the limb called `name`; KeyError where there is none."""
        for limb in self.limbs:
            if limb.name == name:
                return limb
        raise KeyError(name)

    def children(self, name: str) -> tuple[Limb, ...]:
        """The limbs that hang on limb `name`, in file order."""
        return tuple(limb for limb in self.limbs if limb.parent == name)

    def subtree(self, name: str) -> Iterator[Limb]:
        """Yield limb `name` and all limbs below it, depth first."""
        below: dict[str | None, list[Limb]] = {}
        for limb in self.limbs:
            below.setdefault(limb.parent, []).append(limb)
        pending = [self.limb(name)]
        while pending:  # no recursion: a chain may be longer than Python's stack
            limb = pending.pop()
            yield limb
            pending.extend(reversed(below.get(limb.name, [])))
