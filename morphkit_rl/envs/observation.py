"""Sensor numbers and joint coordinates of many robots -> token values, in one pass over flat buffers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import compress
from typing import Literal

import mujoco
import numpy as np

from morphkit.naming.patterns import limb_type
from morphkit.simulation.build import Simulation
from morphkit.tokens import quantities
from morphkit.tokens.spec import TokenSpec
from morphkit_rl.envs.selection import sensor_columns

Observation = Literal["fixed", "legacy"]

_TAU = 2 * np.pi


class ObservationPass:
    """Computes the observations of all environments of all robots at once.

    Every limb of every environment is a row of sensor numbers (`sensors`, float64 (rows, numbers)), environment by
    environment. A pass writes the scalars of the sensed quantities of each row, its features, then the joint angles
    into one source buffer, where values that never change are too, and what others write there; a single gather puts
    them into token order.

    Args:
        simulations: The robots.
        specs: What to observe of each: its tokens or some of them.
        state_start: Where in the flat state vector each environment of each robot starts, one int (n,) a robot; there
            are time, qpos, qvel and what else the simulator keeps.
        observation: `fixed`, or `legacy`: two defects of the published code. There, limbs other than the root report
            absolute world x, and the root's z velocity gains (world rotational velocity about y) * (world x), before
            the clip; limb types are matched against body names whatever the family says.

    Attributes:
        sensors: See above; the caller keeps them up to date.
        roots: Row of the root limb of every environment, int (environments,).
        others: For each robot float32 (n, tokens): what is observed of it besides limbs and joints, in the order of its
            tokens; the caller keeps them up to date.
    """

    def __init__(
        self,
        simulations: Sequence[Simulation],
        specs: Sequence[TokenSpec],
        state_start: Sequence[np.ndarray],
        observation: Observation,
    ) -> None:
        self._legacy = observation == "legacy"
        self._x: int = quantities.quantity_columns("position").start
        self._lift: int = quantities.quantity_columns("translational_velocity").start + 2
        self._turn: int = quantities.quantity_columns("rotational_velocity").start + 1
        num_envs = [len(start) for start in state_start]
        limbs = np.repeat([len(simulation.limb_body) for simulation in simulations], num_envs)
        self.sensors = np.zeros((int(limbs.sum()), quantities.numbers_per_limb()))
        self._features_of = _feature_columns()
        self._x_feature: int = self._features_of["position"].start
        self._width = max(columns.stop for columns in self._features_of.values())
        self.roots = np.cumsum(limbs) - limbs
        self._root_of = np.repeat(self.roots, limbs)
        joints = [_joint_table(simulation) for simulation in simulations]
        addresses = [
            (start[:, None] + 1 + table[:, 0].astype(np.intp)).ravel()
            for start, table in zip(state_start, joints, strict=True)
        ]
        self._angle_state = np.concatenate(addresses)
        angles = np.concatenate([np.tile(table, (n, 1)) for table, n in zip(joints, num_envs, strict=True)])
        self._angle_low, self._angle_scale = angles[:, 1], angles[:, 2]
        self._wrapped = np.flatnonzero(angles[:, 3] == 1)
        self._balls = np.flatnonzero(angles[:, 3] == 2)
        self._fill_source(simulations, specs, num_envs, [len(table) for table in joints])

    def _fill_source(
        self,
        simulations: Sequence[Simulation],
        specs: Sequence[TokenSpec],
        num_envs: Sequence[int],
        joints: Sequence[int],
    ) -> None:
        """Allocate the source buffer, fill in its constants, and lay down where each token comes from."""
        of_limbs = [_of_limbs(spec) for spec in specs]
        widths = [int((~mine).sum()) for mine in of_limbs]
        first_angle = len(self.sensors) * self._width
        first_other = first_angle + len(self._angle_state)
        first_constant = first_other + sum(n * width for n, width in zip(num_envs, widths, strict=True))
        next_feature, next_angle, next_other, next_constant = 0, first_angle, first_other, first_constant
        constants, gather, places = [np.zeros(0)], [], []
        robots = zip(simulations, specs, num_envs, joints, of_limbs, widths, strict=True)
        for simulation, spec, n, n_joints, mine, width in robots:
            start, section = np.zeros(len(mine), np.int64), np.full(len(mine), 2)
            start[~mine] = np.arange(width)
            own_start, own_section, values = _token_sources(simulation, self._features_of, legacy=self._legacy)
            chosen = sensor_columns(replace(spec, sensors=tuple(compress(spec.sensors, mine))), simulation.tokens)
            start[mine], section[mine] = own_start[chosen], own_section[chosen]
            n_features = len(simulation.limb_body) * self._width
            # Sections are numbered so that they index these: 0 constants, 1 features, 2 others, -1 angles.
            origin = np.array([next_constant, next_feature, next_other, next_angle])[section]
            step = np.array([0, n_features, width, n_joints])[section]
            gather.append((origin + start + np.arange(n)[:, None] * step).ravel())
            constants.append(values)
            places.append((next_other, n, width))
            next_feature, next_angle = next_feature + n * n_features, next_angle + n * n_joints
            next_other, next_constant = next_other + n * width, next_constant + len(values)
        self._source = np.zeros(next_constant, np.float32)
        self._source[first_constant:] = np.concatenate(constants)
        self.others = [self._source[at : at + n * width].reshape(n, width) for at, n, width in places]
        self._features = self._source[:first_angle].reshape(-1, self._width)
        self._sensed: list[tuple[quantities.LimbQuantity, np.ndarray, np.ndarray]] = []
        for each in quantities.sensed_quantities():
            numbers = self.sensors[:, quantities.quantity_columns(each.name)]
            self._sensed.append((each, numbers, self._features[:, self._features_of[each.name]]))
        self._angles = self._source[first_angle:first_other]
        self._gather = np.concatenate(gather)

    def __call__(self, state: np.ndarray) -> np.ndarray:
        """Token values of all environments, float32, flat, a new array; `sensors` must hold those of `state`."""
        for quantity, numbers, out in self._sensed:
            if quantity.rotation:
                exponential_map(numbers, out=out)
            elif quantity.limit is not None:
                np.clip(numbers, -quantity.limit, quantity.limit, out=out, casting="same_kind")
            else:
                out[:] = numbers
        x = self.sensors[:, self._x]
        if self._legacy:
            self._add_published_defects(x)
        else:
            np.subtract(x, x[self._root_of], out=self._features[:, self._x_feature], casting="same_kind")
        angles = state.take(self._angle_state)
        if len(self._balls):
            angles[self._balls] = 2 * np.arccos(np.minimum(np.abs(angles[self._balls]), 1.0))
        angles -= self._angle_low
        if len(self._wrapped):
            angles[self._wrapped] = (angles[self._wrapped] + np.pi) % _TAU - np.pi
        np.multiply(angles, self._angle_scale, out=self._angles, casting="same_kind")
        return self._source.take(self._gather)

    def _add_published_defects(self, x: np.ndarray) -> None:
        """Subtracting the root's x overwrote the simulator's own array: see `docs/benchmark.md`."""
        roots, lift, turn = self.roots, self._lift, self._turn
        self._features[roots, self._x_feature] = 0.0
        lifted = self.sensors[roots, lift] + self.sensors[roots, turn] * x[roots]
        limit = quantities.VELOCITY_LIMIT
        self._features[roots, self._features_of["translational_velocity"].start + 2] = np.clip(lifted, -limit, limit)


def _of_limbs(spec: TokenSpec) -> np.ndarray:
    """Which sensor tokens are those of limbs and joints, bool (tokens,)."""
    known = quantities.quantity_names()
    return np.array([sensor.quantity in known for sensor in spec.sensors], bool)


def _feature_columns() -> dict[str, slice]:
    """Which features of a limb belong to a sensed quantity."""
    start, found = 0, {}
    for quantity in quantities.sensed_quantities():
        found[quantity.name] = slice(start, start + len(quantity.components))
        start += len(quantity.components)
    return found


def exponential_map(quaternion: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
    """Axis * angle of unit quaternions, the angle in [0, pi].

    Args:
        quaternion: (..., 4), real part first.
        out: (..., 3), where to write.

    Returns:
        (..., 3), rad.
    """
    real, imaginary = quaternion[..., 0], quaternion[..., 1:]
    length = np.sqrt(np.einsum("...i,...i->...", imaginary, imaginary))
    angle = 2 * np.arctan2(length, np.abs(real))
    # For tiny rotations angle / length is 2, with a relative error below length^2.
    ratio = np.divide(angle, length, out=np.full_like(length, 2.0), where=length > 1e-8)
    return np.multiply(imaginary, np.copysign(ratio, real)[..., None], out=out, casting="same_kind")


def _joint_table(simulation: Simulation) -> np.ndarray:
    """One row an angle token: qpos index, what to subtract, what to multiply by, kind (0 plain, 1 wrapped, 2 ball).

    A limited joint gives the share of its range (a ball joint: of its largest rotation), an unlimited hinge its angle
    wrapped to [-pi, pi) over 2 pi, and a slide its position in m.
    """
    model, rows = simulation.model, []
    for joint in (joint for joints in simulation.limb_joints for joint in joints):
        low, high = model.jnt_range[joint]
        address, kind = model.jnt_qposadr[joint], model.jnt_type[joint]
        if kind == mujoco.mjtJoint.mjJNT_SLIDE:
            rows.append((address, 0.0, 1.0, 0))
        elif model.jnt_limited[joint]:
            ball = kind == mujoco.mjtJoint.mjJNT_BALL
            rows.append((address, low, 1 / (high - low) if high > low else 0.0, 2 * ball))
        else:
            rows.append((address, 0.0, 1 / _TAU, 2 if kind == mujoco.mjtJoint.mjJNT_BALL else 1))
    return np.array(rows, dtype=float).reshape(-1, 4)


def _joint_range(simulation: Simulation, joint: int) -> tuple[float, float]:
    model = simulation.model
    if not model.jnt_limited[joint]:
        return 0.0, 1.0
    low, high = model.jnt_range[joint]
    if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE:
        return float(low), float(high)
    return (180 + np.degrees(low)) / 360, (180 + np.degrees(high)) / 360


def _limb_types(simulation: Simulation, *, legacy: bool) -> list[int]:
    """Index of every limb's type group, -1 where it has none."""
    groups = simulation.morphology.type_words
    words = [limb_type(groups, limb.name) if legacy else limb.type for limb in simulation.morphology.limbs]
    return [next((i for i, group in enumerate(groups) if word in group), -1) for word in words]


def _token_sources(
    simulation: Simulation, features: Mapping[str, slice], *, legacy: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where each token of a robot comes from.

    Args:
        simulation: The robot.
        features: Which features of a limb belong to a sensed quantity.
        legacy: Whether limb types are matched against body names whatever the family says.

    Returns:
        Index within its section of the source buffer, int (tokens,); the section, int (tokens,): 1 features of
        environment 0, -1 angles of environment 0, 0 constants; and the constants.
    """
    spec = simulation.tokens
    components = {quantity.name: quantity.components for quantity in quantities.sensed_quantities()}
    width = max(columns.stop for columns in features.values())
    types = _limb_types(simulation, legacy=legacy)
    first_joint = np.cumsum([0, *(len(joints) for joints in simulation.limb_joints)])
    seen = {"angle": [0] * len(types), "joint_range_low": [0] * len(types), "joint_range_high": [0] * len(types)}
    start: list[int] = []
    section: list[int] = []
    constants: list[float] = []
    for token, limb in zip(spec.sensors, spec.token_limb, strict=True):
        if token.quantity in features:
            place = features[token.quantity].start + components[token.quantity].index(token.component or "")
            start.append(limb * width + place)
            section.append(1)
            continue
        value = 0.0
        if token.quantity == "type":
            value = float(types[limb] == int(token.component or 0))
        elif simulation.limb_joints[limb]:
            ordinal = seen[token.quantity][limb]
            seen[token.quantity][limb] += 1
            if token.quantity == "angle":
                start.append(first_joint[limb] + ordinal)
                section.append(-1)
                continue
            joint_range = _joint_range(simulation, simulation.limb_joints[limb][ordinal])
            value = joint_range[token.quantity == "joint_range_high"]
        start.append(len(constants))
        section.append(0)
        constants.append(value)
    return np.array(start), np.array(section), np.array(constants)
