"""The names that a run folder holds, and what of it may be trusted, overwritten or removed.

Run folders are shared. One is used only where it holds no links, and of what it holds only names that morphkit itself
makes are ever removed.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Collection
from pathlib import Path

from morphkit.errors import CheckpointError, OutputError
from morphkit.utils.atomic_write import temporary_names
from morphkit.utils.plain_files import require_plain
from morphkit.utils.staging import require_text

CONFIG, METRICS, CHECKPOINTS, REPLAY, ROBOTS = "config.json", "metrics.jsonl", "checkpoints", "replay", "robots"
LATEST, BEST = "latest", "best"
TRACKED = "tracked-as.txt"
POLICY, START = "policy.json", "start"

CHECKPOINT_NAME = re.compile(r"step-\d{12,20}-\d{10,20}(-again){0,9}", re.ASCII)
SEGMENT_NAME = re.compile(r"sweeps-\d{10,20}-\d{10,20}\.safetensors", re.ASCII)
ROBOT_NAME = re.compile(r"\d{3,6}(-[A-Za-z0-9_-]{1,48})?\.(urdf|xml)", re.ASCII)
TRACKED_NAME = re.compile(r"[A-Za-z0-9-]{1,40}-[0-9a-f]{8}", re.ASCII)
_STAGE_NAME = re.compile(rf"\.{CHECKPOINT_NAME.pattern}\.tmp", re.ASCII)
_SEGMENT_TEMPORARY = re.compile(r"\.sweeps-\d{10,20}-\d{10,20}\.[0-9a-f]{8}\.safetensors", re.ASCII)
_BEFORE_FILES = {CHECKPOINTS, REPLAY, ROBOTS}


def require_folder(run: Path) -> None:
    """Refuse what is no folder, or one that holds links.

    Raises:
        CheckpointError: There is no folder, or it is a link or holds one.
    """
    require_plain(run, CheckpointError)
    if not run.is_dir():
        raise CheckpointError(f"{run}: no such run folder")


def require_run(run: Path) -> None:
    """Refuse what is no run folder, or one that holds links.

    Raises:
        CheckpointError: There is no folder, or it is no run, or it is a link or holds one.
    """
    require_folder(run)
    if not (run / CONFIG).is_file():
        raise CheckpointError(f"{run}: not a run folder: it has no {CONFIG}")


def create_run(run: Path) -> None:
    """Make the run folder, also where one was left before its first file.

    Raises:
        OutputError: It cannot be written, is a link, holds files already, or has a name that is no UTF-8 text.
    """
    require_text(run)
    require_plain(run, OutputError)
    if run.exists() and not _is_unused(run):
        is_run = (run / CONFIG).is_file()
        hint = "continue it with --resume, or choose another folder" if is_run else "choose another folder"
        raise OutputError(f"{run}: exists and is not empty; {hint}")
    try:
        for name in (CHECKPOINTS, REPLAY, ROBOTS):
            (run / name).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{run}: cannot make the run folder: {error.strerror}") from None


def checkpoint_names(run: Path) -> list[str]:
    """Names of the checkpoints that there are, oldest first."""
    folder = run / CHECKPOINTS
    return sorted(each.name for each in folder.iterdir() if CHECKPOINT_NAME.fullmatch(each.name) and each.is_dir())


def clear_checkpoints(run: Path, keep: Collection[str]) -> None:
    """Remove all checkpoints but some, and what failed ones left."""
    for old in (run / CHECKPOINTS).iterdir():
        ours = CHECKPOINT_NAME.fullmatch(old.name) or _STAGE_NAME.fullmatch(old.name)
        if ours and old.name not in keep and old.is_dir() and not old.is_symlink():
            shutil.rmtree(old, ignore_errors=True)
        elif any(temporary_names(run / CHECKPOINTS / name).fullmatch(old.name) for name in (LATEST, BEST)):
            old.unlink(missing_ok=True)


def clear_segments(run: Path, keep: Collection[str]) -> None:
    """Remove all replay segments but some, and what failed ones left."""
    for old in (run / REPLAY).iterdir():
        ours = SEGMENT_NAME.fullmatch(old.name) or _SEGMENT_TEMPORARY.fullmatch(old.name)
        if ours and old.name not in keep and not old.is_dir():
            old.unlink(missing_ok=True)


def clear_temporaries(run: Path) -> None:
    """Remove the temporary files that a killed process left in the run folder itself."""
    for old in run.iterdir():
        made = any(temporary_names(run / name).fullmatch(old.name) for name in (CONFIG, METRICS, TRACKED, "owner.json"))
        if made and not old.is_dir():
            old.unlink(missing_ok=True)


def _is_unused(run: Path) -> bool:
    """Whether a folder is empty but for the folders that are made in it before any file."""
    if not run.is_dir():
        return False
    entries = list(run.iterdir())
    return all(e.name in _BEFORE_FILES and e.is_dir() and not any(e.iterdir()) for e in entries)
