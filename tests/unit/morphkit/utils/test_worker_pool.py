from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import count, islice
from multiprocessing import connection
from multiprocessing.connection import Connection
from pathlib import Path
from types import SimpleNamespace

import pytest

from morphkit.errors import AblationError
from morphkit.utils import worker_pool
from morphkit.utils.process_limits import Limits
from morphkit.utils.worker_pool import Failure, run


@pytest.fixture(autouse=True)
def forked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fork even while there are threads of a test runner: what the tests hand over cannot be pickled."""
    monkeypatch.setattr(worker_pool, "_context", lambda: multiprocessing.get_context("fork"))


def misbehave(hanging: Path) -> Callable[[str], str]:
    def act(task: str) -> str:
        if task == "crash":
            os.kill(os.getpid(), signal.SIGSEGV)
        if task == "exit":
            os._exit(3)
        if task == "hang":
            hanging.touch()
            time.sleep(600)
        if task == "mistake":
            raise AblationError("no such\n  limb")
        if task == "bug":
            raise ZeroDivisionError("division by zero")
        print("noise", flush=True)
        return task + "!"

    return act


@pytest.fixture
def hanging(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A file that a hanging task makes; time passes only when nothing else is being done."""
    file, now = tmp_path / "hanging", 0.0

    def wait(connections: list[Connection], timeout: float) -> list[object]:
        nonlocal now
        while not (ready := connection.wait(connections, 0.01)):
            if len(connections) == 1 and file.exists():
                file.unlink()
                now += timeout
                break
        return ready

    monkeypatch.setattr(worker_pool, "wait", wait)
    monkeypatch.setattr(worker_pool, "time", SimpleNamespace(monotonic=lambda: now))
    return file


@pytest.mark.parametrize("jobs", [1, 3])
def test_a_failed_task_is_one_failed_task(jobs, capfd, hanging):
    tasks = ["a", "crash", "b", "exit", "mistake", "crash", "bug", "c", "hang", "d"]
    results = list(run(partial(misbehave, hanging), tasks, jobs=jobs, timeout_s=1.0))
    assert results == [
        ("a", "a!"),
        ("crash", Failure("the simulator crashed (SIGSEGV)")),
        ("b", "b!"),
        ("exit", Failure("the simulator ended the process (exit code 3)")),
        ("mistake", Failure("no such limb")),
        ("crash", Failure("the simulator crashed (SIGSEGV)")),
        ("bug", Failure("ZeroDivisionError: division by zero")),
        ("c", "c!"),
        ("hang", Failure("it took longer than 1 s")),
        ("d", "d!"),
    ]
    assert capfd.readouterr().out == ""


def test_a_task_has_as_long_as_it_is_given(tmp_path):
    (result,) = run(partial(misbehave, tmp_path / "hanging"), ["hang"], timeout_s=0.1)
    assert result == ("hang", Failure("it took longer than 0.1 s"))


def test_workers_live_on_between_tasks():
    processes = {result for _, result in run(lambda: lambda task: os.getpid(), range(20), jobs=2)}
    assert len(processes) <= 2
    assert os.getpid() not in processes


def test_tasks_are_taken_a_few_ahead_only():
    taken: list[int] = []

    def endless() -> Iterator[int]:
        for number in count():
            taken.append(number)
            yield number

    results = list(islice(run(lambda: lambda task: task * task, endless(), jobs=2), 10))
    assert [result for _, result in results] == [number * number for number in range(10)]
    assert len(taken) < 30


def test_no_process_is_left_behind():
    running = run(lambda: lambda task: task, range(10), jobs=2)
    next(running)
    assert multiprocessing.active_children()
    running.close()
    assert not multiprocessing.active_children()


def square() -> Callable[[int], int]:
    return lambda task: task * task


def test_a_fresh_interpreter_works_too(monkeypatch):
    monkeypatch.setattr(worker_pool, "_context", lambda: multiprocessing.get_context("spawn"))
    assert list(run(square, [2, 3])) == [(2, 4), (3, 9)]


class Torn:
    """What cannot be read again, as a model that MuJoCo has cut short."""

    def __reduce__(self) -> tuple[object, ...]:
        return int, ("no model",)


def test_a_result_that_cannot_be_read_again_is_a_failure_of_its_task() -> None:
    def setup() -> Callable[[str], object]:
        return lambda task: Torn() if task == "torn" else task

    said = "what the simulator gave cannot be read (invalid literal for int() with base 10: 'no model')"
    assert dict(run(setup, ["torn", "whole"])) == {"torn": Failure(said), "whole": "whole"}
    ((_, limited),) = run(setup, ["torn"], limits=Limits(60, 2**31))
    assert isinstance(limited, Failure)
    assert limited.reason.startswith(f"{said}, perhaps because it needs more than 2.0 GiB of memory; ")
