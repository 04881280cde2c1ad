"""How much of a robot a policy knows, before anything runs: its texts, its size, and what the policy may be worth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from morphkit.description import Description
from morphkit.errors import MorphkitError
from morphkit.tokens.spec import ActuatorToken, SensorToken, TokenSpec
from morphkit_rl.algorithms.policy import Policy
from morphkit_rl.config.methods import find_method
from morphkit_rl.envs.robot import Robot
from morphkit_rl.evaluation.calibration import FEWEST_TRAINED, Prediction, actuated_masses, limb_masses, predict
from morphkit_rl.models.vocabulary import Vocabulary
from morphkit_rl.runs import run_settings, saved_policy


@dataclass(frozen=True)
class TextMatch:
    """A token's text and the nearest text of training.

    Attributes:
        token: Name of the token.
        text: Its text.
        trained: Whether training had it.
        nearest: The nearest text of training, itself where training had it.
        cosine: How near that is, of the embeddings as the policy reads them; 1 for the same.
    """

    token: str
    text: str
    trained: bool
    nearest: str
    cosine: float


@dataclass(frozen=True)
class LimbMatch:
    """A limb and how much of it training had.

    Attributes:
        limb: Name of the limb.
        tokens: Its tokens.
        trained: How many of their texts training had.
        farthest: The token whose text is least near to one of training.
    """

    limb: str
    tokens: int
    trained: int
    farthest: TextMatch


@dataclass(frozen=True)
class Outside:
    """A property that lies outside of what training had.

    Attributes:
        what: The property, with its unit.
        value: That of the robot.
        low: Least among the training bodies.
        high: Greatest among them.
    """

    what: str
    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Coverage:
    """How much of a robot a policy knows.

    Attributes:
        robot: Name of the robot.
        reads_names: Whether the policy's method reads names at all.
        mirrored: Whether the policy acts for it as for its mirror image, which training knew better
            (`augment.mirror_unseen`); texts are those of the image then.
        texts: Every token.
        limbs: Every limb.
        rests: Limbs that the policy does not act by, since training had none of their texts (`augment.rest_unseen`).
        outside: What is unlike the training bodies.
        prediction: Expected normalized return; None without calibration.
        notes: What could not be said, and why.
    """

    robot: str
    reads_names: bool
    mirrored: bool
    texts: tuple[TextMatch, ...]
    limbs: tuple[LimbMatch, ...]
    rests: tuple[str, ...]
    outside: tuple[Outside, ...]
    prediction: Prediction | None
    notes: tuple[str, ...]


def coverage(target: str | Path, description: Description, *, encoder: str | None = None, **options: Any) -> Coverage:
    """Compare a robot with the bodies that a policy was trained on.

    Args:
        target: A run folder, a policy folder, or `zoo:NAME`.
        description: The robot.
        encoder: Text encoder in place of the policy's own; see `Policy.load`.
        options: `task` and `base` of `Policy.prepare`.

    Raises:
        CheckpointError: There is no such policy, or it is damaged.
        ConfigError: The text encoder needs trust, or the robot has no actuators.
    """
    policy = Policy.load(target, encoder=encoder)
    (robot,) = policy.prepare([description], **options)
    folder = saved_policy.load(target).folder
    matches = _match(policy, robot)
    notes = []
    outside: list[Outside] = []
    try:
        bodies = policy.prepare(run_settings.load(folder).robots)
        outside = _outside(robot, bodies)
    except MorphkitError as error:
        notes.append(f"sizes cannot be compared, since a training body cannot be read: {error}")
    evaluation = saved_policy.read_evaluation(folder)
    prediction = None
    if evaluation is None:
        notes.append("no prediction: nothing was measured of this policy (an entry of the zoo has measured returns)")
    else:
        rows = [*evaluation["robots"], *evaluation.get("calibration", ())]
        prediction = predict(actuated_masses(robot, policy.reads(robot.spec)), rows)
        if prediction is None:
            few = sum(row["trained_on"] for row in rows) < FEWEST_TRAINED
            why = "fewer than three training bodies were measured" if few else "the policy fails on its training bodies"
            notes.append(f"no prediction: {why}")
    return Coverage(
        robot=robot.name,
        reads_names=find_method(policy.config.model.method).reads_names != "none",
        mirrored=policy.reads(robot.spec) is not robot.spec,
        texts=tuple(matches),
        limbs=tuple(_limbs(robot, matches)),
        rests=policy.rests(robot.spec),
        outside=tuple(outside),
        prediction=prediction,
        notes=tuple(notes),
    )


def _match(policy: Policy, robot: Robot) -> list[TextMatch]:
    """Every token with the nearest text of training."""
    known = list((policy.vocabulary or Vocabulary()).texts)
    tokens = _tokens(policy.reads(robot.spec))
    texts = [token.text for token in tokens]
    near = _cosines(policy.embedder(texts), policy.embedder(known))
    best = near.argmax(1)
    found = []
    for number, token in enumerate(tokens):
        trained = token.text in known
        nearest = token.text if trained else known[best[number]]
        cosine = 1.0 if trained else float(near[number, best[number]])
        found.append(TextMatch(token.name, token.text, trained, nearest, cosine))
    return found


def _cosines(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(rows of one, rows of other) cosine of the angle between embeddings; 0 with one that is zero."""
    a, b = (rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-9) for rows in (one, other))
    return np.asarray(a @ b.T)


def _tokens(spec: TokenSpec) -> list[SensorToken | ActuatorToken]:
    return [*spec.sensors, *spec.actuators]


def _limbs(robot: Robot, matches: Sequence[TextMatch]) -> list[LimbMatch]:
    owners = [token.limb for token in _tokens(robot.spec)]
    found = []
    for limb in robot.spec.limbs:
        own = [match for match, owner in zip(matches, owners, strict=True) if owner == limb.name]
        if own:
            farthest = min(own, key=lambda match: match.cosine)
            found.append(LimbMatch(limb.name, len(own), sum(match.trained for match in own), farthest))
    return found


def _sizes(robot: Robot) -> dict[str, float]:
    """Properties of a body by name, with their units."""
    model, simulation = robot.simulation.model, robot.simulation
    joints = [joint for joints in simulation.limb_joints for joint in joints if model.jnt_limited[joint]]
    hinges = [joint for joint in joints if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE]
    widths = np.degrees([model.jnt_range[joint][1] - model.jnt_range[joint][0] for joint in hinges] or [0.0])
    masses = limb_masses(robot)
    return {
        "limbs": float(len(robot.spec.limbs)),
        "actuators in all": float(len(robot.spec.actuators)),
        "mass in kg": float(masses.sum()),
        "mass of the lightest limb in kg": float(masses.min()),
        "mass of the heaviest limb in kg": float(masses.max()),
        "start height in m": float(_start_height(robot)),
        "narrowest joint range in degrees": float(widths.min()),
        "widest joint range in degrees": float(widths.max()),
    }


def _start_height(robot: Robot) -> float:
    data = mujoco.MjData(robot.simulation.model)
    mujoco.mj_kinematics(robot.simulation.model, data)
    return float(data.xpos[robot.simulation.limb_body[0], 2])


def _outside(robot: Robot, bodies: Sequence[Robot]) -> list[Outside]:
    own, known = _sizes(robot), [_sizes(body) for body in bodies]
    found = []
    for what, value in own.items():
        low, high = min(sizes[what] for sizes in known), max(sizes[what] for sizes in known)
        slack = 1e-6 * max(abs(low), abs(high), 1.0)
        if not low - slack <= value <= high + slack:
            found.append(Outside(what, value, low, high))
    return found
