"""Ctrl-C between two pieces of work instead of within one."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType, TracebackType
from typing import Any


class Interrupts:
    """While this context is open, the first Ctrl-C only sets `wanted`; the second interrupts at once.

    Outside the main thread, where Python takes no signals, it changes nothing.

    Attributes:
        wanted: Whether Ctrl-C was pressed.
    """

    def __init__(self) -> None:
        self.wanted = False
        self._immediate = False
        self._before: Any = None

    def __enter__(self) -> Interrupts:
        if threading.current_thread() is threading.main_thread():
            self._before = signal.signal(signal.SIGINT, self._handle)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)

    @contextmanager
    def immediate(self) -> Iterator[None]:
        """Within: Ctrl-C raises KeyboardInterrupt at once, for work that may be cut short."""
        self._immediate = True
        try:
            yield
        finally:
            self._immediate = False

    def _handle(self, signum: int, frame: FrameType | None) -> None:
        if self._immediate or self.wanted:
            raise KeyboardInterrupt
        self.wanted = True
