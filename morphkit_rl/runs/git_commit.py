"""Which commit of the sources runs."""

from __future__ import annotations

import subprocess
from pathlib import Path


def git_commit(file: Path = Path(__file__)) -> str | None:
    """Commit of the source tree that `file` is part of; None where there is none.

    A package that was installed into somebody's checkout is no part of it: git must know the file.
    """
    git = ["git", "-C", str(file.parent)]
    try:
        for command in (["ls-files", "--error-unmatch", file.name], ["rev-parse", "HEAD"]):
            done = subprocess.run([*git, *command], capture_output=True, text=True, check=True, timeout=10)
        return done.stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return None
