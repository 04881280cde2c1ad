"""Tasks in worker processes that live on between tasks: one that crashes or hangs is one failed task, not the end."""

from __future__ import annotations

import contextlib
import faulthandler
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.context import BaseContext
from pathlib import Path
from typing import Any, Generic, TypeVar

from morphkit.errors import MorphkitError
from morphkit.utils.process_limits import ADVICE, Limits, is_want_of_memory

TIMEOUT_S = 300.0
_AHEAD = 4
T = TypeVar("T")
R = TypeVar("R")


@dataclass(frozen=True, slots=True)
class Failure:
    """What a task gives that could not be done; `reason` is for people."""

    reason: str


@dataclass(slots=True)
class _Worker(Generic[T]):
    process: Any
    connection: Connection
    task: tuple[int, T] | None = None
    deadline: float = 0.0


def run(
    setup: Callable[[], Callable[[T], R]],
    tasks: Iterable[T],
    *,
    jobs: int = 1,
    timeout_s: float = TIMEOUT_S,
    limits: Limits | None = None,
) -> Iterator[tuple[T, R | Failure]]:
    """Do tasks in `jobs` processes and yield each with its result, in the order of `tasks` whatever `jobs` is.

    Tasks are taken lazily, a few ahead of the results, so that memory stays flat. What the processes print is
    swallowed. On Linux processes are forked, unless the caller has threads. Elsewhere they start afresh: `setup` must
    be picklable, and a script that calls this needs its `if __name__ == "__main__":`.

    Args:
        setup: Called once a process; returns what does a task. Tasks and results must be picklable.
        tasks: The tasks.
        jobs: Number of processes.
        timeout_s: Longest time that a task may take, s.
        limits: Memory of a process, and processor time of each of its tasks; None for no limits.

    Yields:
        Task and result, or a `Failure`: it raised a `MorphkitError` or another exception, its process died, or it took
        too long. Such a process is replaced.
    """
    pool = _Pool(setup, jobs, timeout_s, limits)
    done: dict[int, R | Failure] = {}
    order: deque[tuple[int, T]] = deque()
    numbered = enumerate(tasks)
    try:
        while True:
            while len(order) < _AHEAD * jobs and (upcoming := next(numbered, None)) is not None:
                order.append(upcoming)
                pool.waiting.append(upcoming)
            if not order:
                return
            pool.assign()
            if order[0][0] in done:
                number, task = order.popleft()
                yield task, done.pop(number)
            else:
                done.update(pool.collect())
    finally:
        pool.stop()


class _Pool(Generic[T, R]):
    def __init__(
        self, setup: Callable[[], Callable[[T], R]], jobs: int, timeout_s: float, limits: Limits | None
    ) -> None:
        self._setup, self._jobs, self._timeout_s, self._limits = setup, jobs, timeout_s, limits
        self._context = _context()
        self._workers: list[_Worker[T]] = []
        self.waiting: deque[tuple[int, T]] = deque()

    def assign(self) -> None:
        """Give every idle worker a task; start workers while there are fewer than tasks."""
        for worker in self._workers:
            if worker.task is None and self.waiting:
                self._give(worker)
        while self.waiting and len(self._workers) < self._jobs:
            self._workers.append(self._start())
            self._give(self._workers[-1])

    def collect(self) -> Iterator[tuple[int, R | Failure]]:
        """Wait until a task is done or has failed; yield number and result of those that are."""
        busy = [worker for worker in self._workers if worker.task is not None]
        left = min(worker.deadline for worker in busy) - time.monotonic()
        ready = wait([worker.connection for worker in busy], timeout=max(0.0, left))
        for worker in busy:
            assert worker.task is not None
            if worker.connection in ready:
                try:
                    result = worker.connection.recv()
                except (EOFError, OSError):
                    result = Failure(self._cause_of_death(worker))
                except ValueError as error:  # MuJoCo cuts models short where memory does not suffice to send them.
                    result = Failure(f"what the simulator gave cannot be read ({error}){self._perhaps_memory()}")
                yield worker.task[0], result
                worker.task = None
            elif time.monotonic() >= worker.deadline:
                self._end(worker)
                yield worker.task[0], Failure(f"it took longer than {self._timeout_s:g} s")

    def stop(self) -> None:
        """End all workers."""
        for worker in list(self._workers):
            self._end(worker)

    def _start(self) -> _Worker[T]:
        ours, theirs = self._context.Pipe()
        inherited = [ours, *(worker.connection for worker in self._workers)]
        forked = self._context.get_start_method() == "fork"
        process = self._context.Process(  # type: ignore[attr-defined]
            target=_serve, args=(theirs, inherited if forked else [], self._setup, self._limits), daemon=True
        )
        process.start()
        theirs.close()
        return _Worker(process, ours)

    def _give(self, worker: _Worker[T]) -> None:
        worker.task = self.waiting.popleft()
        worker.deadline = time.monotonic() + self._timeout_s
        # A worker that died meanwhile is noticed when its result is collected.
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            worker.connection.send(worker.task[1])

    def _cause_of_death(self, worker: _Worker[T]) -> str:
        worker.process.join()
        code = worker.process.exitcode
        self._end(worker)
        if self._limits is not None and code == -signal.SIGXCPU:
            return f"it took more than {self._limits.seconds:.3g} s of processor time; {ADVICE}"
        how = f"exit code {code}" if code is None or code >= 0 else signal.Signals(-code).name
        said = f"the simulator {'crashed' if code is not None and code < 0 else 'ended the process'} ({how})"
        return said if code == -signal.SIGSEGV else f"{said}{self._perhaps_memory()}"

    def _perhaps_memory(self) -> str:
        if self._limits is None:
            return ""
        return f", perhaps because it needs more than {self._limits.memory / 2**30:.1f} GiB of memory; {ADVICE}"

    def _end(self, worker: _Worker[T]) -> None:
        worker.process.kill()
        worker.process.join()
        worker.connection.close()
        self._workers.remove(worker)


def _context() -> BaseContext:
    """Fork where that is safe, since it costs no start-up time; a fresh interpreter elsewhere."""
    alone = sys.platform == "linux" and threading.active_count() == 1
    return multiprocessing.get_context("fork" if alone else "spawn")


def _serve(
    connection: Connection,
    inherited: list[Connection],
    setup: Callable[[], Callable[[T], R]],
    limits: Limits | None,
) -> None:
    """The life of a worker: until the other end of its connection is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends its workers
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    for other in inherited:
        other.close()
    faulthandler.disable()  # the parent says that a worker crashed
    nowhere = Path(os.devnull).open("w")  # noqa: SIM115 - for the life of the process
    os.dup2(nowhere.fileno(), 1)  # what the simulator's C code prints
    os.dup2(nowhere.fileno(), 2)
    sys.stdout = sys.stderr = nowhere
    if limits is not None:
        limits.bound_memory()
    handle = setup()
    while True:
        try:
            task = connection.recv()
        except EOFError:
            return
        if limits is not None:
            limits.bound_next_task()
        connection.send(_attempt(handle, task, limits))


def _attempt(handle: Callable[[T], R], task: T, limits: Limits | None) -> R | Failure:
    try:
        return handle(task)
    except Exception as error:  # whatever it is, it concerns this task only
        if limits is not None and is_want_of_memory(error):
            return Failure(f"it needs more than {limits.memory / 2**30:.1f} GiB of memory; {ADVICE}")
        if isinstance(error, MorphkitError):
            return Failure(" ".join(str(error).split()))
        return Failure(f"{type(error).__name__}: {' '.join(str(error).split())}")
