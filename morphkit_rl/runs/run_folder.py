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
from morphkit_rl.runs.lock import OWNER

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
_IN_STAGE = r"\.start-[a-z0-9_]{8}\.morphkit/.+"
_BEFORE_CONFIG = re.compile(
    rf"\.lock|\.config\.[0-9a-f]{{8}}\.json|(start/)?robots/{ROBOT_NAME.pattern}|{_IN_STAGE}"
    r"|robots/\.[A-Za-z0-9_-]{1,40}\.[0-9a-f]{8}\.(urdf|xml)"
    r"|start/(config|policy|evaluation)\.json|start/policy\.safetensors|start/README\.md",
    re.ASCII,
)
"""Files that are written before `config.json`, and that a process leaves which is killed in between."""


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
    """Make the run folder, also where one was left before its `config.json`.

    Raises:
        OutputError: It cannot be written, is a link, holds files already, or has a name that is no UTF-8 text.
    """
    require_text(run)
    _require_unused(run)
    try:
        for name in (CHECKPOINTS, REPLAY, ROBOTS):
            (run / name).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{run}: cannot make the run folder: {error.strerror}") from None


def clear_unfinished(run: Path) -> None:
    """Remove what a process left that was killed before `config.json`; the folder has to be locked.

    Raises:
        OutputError: Another process has made a run of it meanwhile.
    """
    _require_unused(run)
    for path in run.rglob("*"):
        place = path.relative_to(run).as_posix()
        if path.is_file() and _BEFORE_CONFIG.fullmatch(place) and not re.match(rf"\.lock|{_IN_STAGE}", place):
            path.unlink()
    for folder in (run / START / ROBOTS, run / START):
        if folder.is_dir():
            folder.rmdir()


def remove_new(run: Path) -> None:
    """Remove a run that this process made and has not trained: all that is in it is ours."""
    shutil.rmtree(run, ignore_errors=True)


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


def clear_temporaries(folder: Path, names: Collection[str] = (CONFIG, METRICS, TRACKED, OWNER)) -> None:
    """Remove the temporary files that a killed process left of the files `names` in a folder itself."""
    for old in folder.iterdir():
        made = any(temporary_names(folder / name).fullmatch(old.name) for name in names)
        if made and not old.is_dir():
            old.unlink(missing_ok=True)


def _require_unused(run: Path) -> None:
    require_plain(run, OutputError)
    if run.exists() and not _is_unused(run):
        is_run = (run / CONFIG).is_file()
        hint = "continue it with --resume, or choose another folder" if is_run else "choose another folder"
        raise OutputError(f"{run}: exists and is not empty; {hint}")


def _is_unused(run: Path) -> bool:
    """Whether a folder holds nothing but what is made in it before `config.json`."""
    if not run.is_dir():
        return False
    files = [path.relative_to(run).as_posix() for path in run.rglob("*") if not path.is_dir()]
    own = {CHECKPOINTS, REPLAY, ROBOTS, START}
    folders = [path.name in own or path.name.startswith(f".{START}-") for path in run.iterdir() if path.is_dir()]
    return all(folders) and all(map(_BEFORE_CONFIG.fullmatch, files))
