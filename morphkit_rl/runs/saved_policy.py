"""What is left of a run when only its policy counts: a folder of a few hundred kB, without critics and replay.

Such a folder holds `config.json` and the robots' files as the run does, `policy.json` with what the arrays belong to,
`policy.safetensors` with actor and observation statistics, and what is said about it: `README.md`, `evaluation.json`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from morphkit.errors import CheckpointError, OutputError
from morphkit.utils.atomic_write import write_text
from morphkit.utils.plain_files import read_plain
from morphkit.utils.staging import staged_folder
from morphkit_rl.runs import checkpoint, run_folder, schema, zoo
from morphkit_rl.runs.policy_schema import Evaluation, PolicyState
from morphkit_rl.runs.run_folder import CONFIG, LATEST, POLICY, ROBOTS

ARRAYS, CARD, EVALUATION = "policy.safetensors", "README.md", "evaluation.json"
FORMAT_VERSION = 1
_STATE = ("method", "vocabulary", "quantities", "steps", "real_steps", "updates", "elapsed_s")


@dataclass(frozen=True)
class SavedPolicy:
    """A policy as it lies in a run folder or a policy folder.

    Attributes:
        folder: That folder.
        origin: The file of the arrays, for messages.
        settings: `config.json`.
        state: Method, vocabulary and quantities that the arrays belong to, and how long it was trained.
        arrays: Actor, observation statistics and standardization of embeddings.
    """

    folder: Path
    origin: Path
    settings: Mapping[str, Any]
    state: Mapping[str, Any]
    arrays: Mapping[str, np.ndarray]

    @property
    def robots(self) -> list[str]:
        """Names of the training robots."""
        return [robot["name"] for robot in self.settings["robots"]]


def load(target: str | Path, which: str = LATEST) -> SavedPolicy:
    """Read the policy of a run folder, of a policy folder, or the shipped one of `zoo:NAME`.

    Args:
        target: The folder or the name.
        which: `latest`, `best`, or the name of a checkpoint; a policy folder has the one that it was made from.

    Raises:
        UnknownNameError: No policy of that name ships.
        CheckpointError: There is none, or it is damaged.
    """
    folder = zoo.find(target)
    if (folder / POLICY).is_file():
        run_folder.require_run(folder)
        if which != LATEST:
            raise CheckpointError(f"{target}: has no checkpoint {which!r}; its policy is all that it holds")
        state = schema.read(folder / POLICY, PolicyState)
        origin, digest = folder / ARRAYS, state["sha256"]
    else:
        place, state = checkpoint.load_state(folder, which)
        origin, digest = place / ARRAYS, None  # which was looked at
        run_folder.require_run(folder)
    settings = schema.read(folder / CONFIG, schema.Config)
    arrays = checkpoint.load_arrays(origin, sha256=digest)
    return SavedPolicy(folder, origin, settings, {key: state[key] for key in _STATE}, arrays)


def save(policy: SavedPolicy, folder: Path, texts: Mapping[str, str] | None = None) -> None:
    """Write a policy folder in one step.

    Where the robots' files lay, and which folders they needed, is left out.

    Args:
        policy: The policy.
        folder: The folder, which must not exist.
        texts: Further files by name, such as `README.md`.

    Raises:
        OutputError: It exists, or cannot be written.
    """
    if folder.exists():
        raise OutputError(f"{folder}: exists; choose another folder, or remove it")
    parts = {
        part: [{**robot, "folder": None, "packages": {}} for robot in policy.settings.get(part, ())]
        for part in ("robots", "validation")
    }
    with staged_folder(folder) as stage:
        (stage / ROBOTS).mkdir()
        for robot in (*parts["robots"], *parts["validation"]):
            content = read_plain(policy.folder / ROBOTS / robot["source"])
            (stage / ROBOTS / robot["source"]).write_bytes(content)
        checkpoint.save_arrays(stage / ARRAYS, policy.arrays)
        state = {"format_version": FORMAT_VERSION, **policy.state, **checkpoint.describe(stage / ARRAYS)}
        for name, values in ((CONFIG, {**policy.settings, **parts}), (POLICY, state)):
            write_text(stage / name, json.dumps(values, indent=1) + "\n")
        for name, text in (texts or {}).items():
            write_text(stage / name, text)


def read_evaluation(folder: Path) -> dict[str, Any] | None:
    """What was measured of a policy when its folder was made; None where nothing was.

    Raises:
        CheckpointError: The file is damaged.
    """
    if not (folder / EVALUATION).is_file():
        return None
    return schema.read(folder / EVALUATION, Evaluation)


def read_card(folder: Path) -> str:
    """The model card.

    Raises:
        CheckpointError: There is none, or it is no text.
    """
    try:
        return read_plain(folder / CARD).decode()
    except (OSError, ValueError) as error:
        raise CheckpointError(f"{folder / CARD}: damaged or missing: {error}") from None
