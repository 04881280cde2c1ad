"""The schema of the JSON that a policy folder holds besides a run's `config.json`."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from morphkit_rl.runs.schema import Count, Part, Sha256, VocabularyEntry


class PolicyState(Part):
    """`policy.json`: what the arrays of a policy folder belong to, and their size and digest."""

    format_version: Literal[1]
    method: str
    vocabulary: VocabularyEntry
    quantities: list[str]
    steps: Count
    real_steps: Count
    updates: Count
    elapsed_s: Annotated[float, Field(ge=0)]
    size: Count
    sha256: Sha256


class _Measured(Part):
    robot: str
    trained_on: bool
    returns: Annotated[list[float], Field(min_length=1)]
    random_mean: float
    expert_return: float | None
    actuators: dict[str, Annotated[float, Field(ge=0)]]


class Evaluation(Part):
    """`evaluation.json`: what a policy is worth on bodies of training and on held-out ones.

    `calibration` holds held-out bodies that were measured to predict others by.
    """

    episodes: Count
    seed: Count
    robots: list[_Measured]
    calibration: list[_Measured] = Field(default_factory=list)
