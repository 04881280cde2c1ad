"""The process that expands xacro files, forked from this one: what it imports takes longer than most files."""

from __future__ import annotations

import io
import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from types import SimpleNamespace
from typing import Any
from unittest import mock

from morphkit.formats import xacro, xacro_process


def forked() -> AbstractContextManager[object]:
    """While the block runs, xacro files are expanded in forked processes."""
    names = SimpleNamespace(Popen=ForkedProcess, PIPE=subprocess.PIPE, DEVNULL=subprocess.DEVNULL)
    return mock.patch.object(xacro, "subprocess", names)


class ForkedProcess:
    """Takes the place of `subprocess.Popen` in `morphkit.formats.xacro`; the child confines itself as ever."""

    def __init__(self, command: Sequence[str], *, env: Mapping[str, str] | None, **pipes: Any) -> None:
        import xacro  # noqa: F401 - for all children at once

        assert command[-1] == xacro_process.__name__
        (read, self._write), (self._read, write) = os.pipe(), os.pipe()
        self._pid = os.fork()
        if not self._pid:
            _serve(read, write, (self._write, self._read), env)
        os.close(read)
        os.close(write)
        self.stdin, self.stdout = os.fdopen(self._write, "wb"), os.fdopen(self._read, "rb")
        self.returncode: int | None = None

    def kill(self) -> None:
        """Kill it where it lives."""
        if self.returncode is None:
            os.kill(self._pid, signal.SIGKILL)

    def wait(self) -> int:
        """Wait for its end."""
        if self.returncode is None:
            self.returncode = os.waitstatus_to_exitcode(os.waitpid(self._pid, 0)[1])
        return self.returncode

    def __enter__(self) -> ForkedProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self.stdout.close()
        self.wait()


def _serve(read: int, write: int, others: Sequence[int], env: Mapping[str, str] | None) -> None:
    try:
        for descriptor in others:
            os.close(descriptor)
        os.dup2(read, 0)
        os.dup2(write, 1)
        os.closerange(3, 4096)
        sys.stdout = sys.stderr = io.StringIO()  # which a test may have led into a file that is closed now
        if env is not None:
            os.environ.clear()
            os.environ.update(env)
        xacro_process.main()
    finally:
        os._exit(0)
