from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator
from itertools import count, islice

import pytest

from morphkit import workers
from morphkit.errors import AblationError
from morphkit.workers import Failure, run


@pytest.fixture(autouse=True)
def forked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fork even beside the threads of a test runner: what the tests hand over cannot be pickled."""
    monkeypatch.setattr(workers, "_context", lambda: multiprocessing.get_context("fork"))


def misbehave() -> Callable[[str], str]:
    def act(task: str) -> str:
        if task == "crash":
            os.kill(os.getpid(), signal.SIGSEGV)
        if task == "exit":
            os._exit(3)
        if task == "hang":
            time.sleep(60)
        if task == "mistake":
            raise AblationError("no such\n  limb")
        if task == "bug":
            raise ZeroDivisionError("division by zero")
        print("noise", flush=True)
        return task + "!"

    return act


@pytest.mark.parametrize("jobs", [1, 3])
def test_a_failed_task_is_one_failed_task(jobs, capfd):
    tasks = ["a", "crash", "b", "exit", "mistake", "crash", "bug", "c", "hang", "d"]
    results = list(run(misbehave, tasks, jobs=jobs, timeout_s=1.0))
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
    monkeypatch.setattr(workers, "_context", lambda: multiprocessing.get_context("spawn"))
    assert list(run(square, [2, 3])) == [(2, 4), (3, 9)]
