"""What a command prints, and what no command may ever print."""

from __future__ import annotations

import contextlib
import json
import tempfile
import unicodedata
import warnings
from collections.abc import Sequence
from pathlib import Path

from morphkit_cli.main import run


def printed_by(command: Sequence[str]) -> tuple[int, str]:
    """Exit code and output of a command in this process; what it prints is looked at by `refuse_raw`."""
    with tempfile.TemporaryDirectory() as top:
        places = Path(top) / "out", Path(top) / "err"
        with contextlib.ExitStack() as block:
            out, err = (block.enter_context(place.open("w", encoding="utf-8")) for place in places)
            block.enter_context(contextlib.redirect_stdout(out))
            block.enter_context(contextlib.redirect_stderr(err))
            block.enter_context(warnings.catch_warnings(action="ignore"))
            code = run(list(command))
        stdout, stderr = (place.read_text("utf-8", errors="surrogateescape") for place in places)
    assert code in (0, 1, 2), (code, stderr)
    assert code != 2 or stderr.strip(), "an error without words"
    assert "Traceback" not in stderr, stderr
    refuse_raw(stdout + stderr, command)
    if stdout and code == 0 and command[-1] in ("--json", "json", "sarif"):
        json.loads(stdout)
    return code, stdout + stderr


def refuse_raw(printed: str, command: object = "") -> None:
    """Refuse control characters, hidden ones and such that change the direction of text, and forged lines."""
    raw = {each for each in printed if each != "\n" and unicodedata.category(each) in ("Cc", "Cf", "Cs", "Zl", "Zp")}
    assert not raw, (command, raw)
    assert not [line for line in printed.splitlines() if line.startswith("error: forged")], command
