"""What the JSON files of a cell may hold, checked on reading."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from morphkit_rl.runs.schema import Count, Part

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,199}\z")]
"""Of a task, a split or a method, which is the name of a folder too."""


class CellPlan(Part):
    """`cell.json` of a matrix."""

    split: Name
    task: Name
    method: Name
    seed: Count
    format_version: Literal[1]
    steps: Count | None
    minutes: Annotated[float, Field(ge=0)] | None
    episodes: Count
    validation_only: Annotated[bool, Field(alias="validate")]
    train: dict[str, str]
    validation: dict[str, str]
    test: dict[str, str]
    cut: dict[str, str] = Field(default_factory=dict)
    config: dict[str, dict[str, Any]]


class CellTraining(Part):
    """`training.json` of a matrix."""

    steps: Count
    updates: Count
    elapsed_s: float


class _RobotResult(Part):
    robot: str
    role: Literal["train", "validation", "test"]
    mean: float
    returns: Annotated[list[float], Field(min_length=1)]
    lengths: list[Count]
    random_mean: float
    expert_return: float | None


class CellResult(CellTraining):
    """`result.json` of a matrix."""

    format_version: Literal[1]
    evaluated: str
    real_steps: Count | None
    diverged: Count | None
    training_return: float | None
    robots: list[_RobotResult]


class CellFailure(Part):
    """`failure.json` of a matrix."""

    message: str
    traceback: str
